"""The last frames, for a target that was drawn on one of them."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames import Frame


class FrameHistory:
    """Frames of one size and kind in the order of their stamps, bounded in number and bytes.

    Args:
        frames: Most frames that are kept.
        megabytes: Most memory that their images hold, in units of 10^6 bytes.

    Attributes:
        dropped_until: Stamp of the last frame that was dropped for the bounds, or because those
            after it are of another size or kind; 0 if none was.
    """

    def __init__(self, frames: int = 0, megabytes: float = 0.0) -> None:
        self._frames: deque[Frame] = deque()
        self._bytes = 0
        self.dropped_until = 0
        self.limit(frames, megabytes)

    def limit(self, frames: int, megabytes: float) -> None:
        """Change the bounds; the oldest frames beyond them are dropped."""
        self._most_frames = frames
        self._most_bytes = megabytes * 1e6
        self._trim()

    def add(self, image: NDArray[np.generic], stamp: int) -> None:
        """Keep a frame.

        Those before are dropped if they are of another size or kind, or if time has gone back. A
        frame without a stamp (0) is not kept, because nobody could name it.
        """
        if stamp == 0:
            return
        if self._frames:
            last = self._frames[-1]
            if stamp <= last.stamp:
                self.clear()
            elif (last.image.shape, last.image.dtype) != (image.shape, image.dtype):
                self.clear()
                self.dropped_until = last.stamp
        self._frames.append(Frame(image, stamp))
        self._bytes += _held_bytes(image)
        self._trim()

    def since(self, stamp: int) -> list[Frame]:
        """The frames from the first whose stamp is not before `stamp`."""
        return [frame for frame in self._frames if frame.stamp >= stamp]

    @property
    def stamps(self) -> list[int]:
        """The stamps of the frames that are kept."""
        return [frame.stamp for frame in self._frames]

    def clear(self) -> None:
        """Forget all frames."""
        self._frames.clear()
        self._bytes = 0
        self.dropped_until = 0

    def _trim(self) -> None:
        while self._frames and (
            len(self._frames) > self._most_frames or self._bytes > self._most_bytes
        ):
            dropped = self._frames.popleft()
            self._bytes -= _held_bytes(dropped.image)
            self.dropped_until = dropped.stamp


def _held_bytes(image: NDArray[np.generic]) -> int:
    """The memory that lives as long as the image: a view holds all of what it is a view of."""
    owner: Any = image
    while isinstance(owner, np.ndarray) and owner.base is not None:
        owner = owner.base
    return memoryview(owner).nbytes
