"""The last frames, for a target that was drawn on one of them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.stamps import NANOSECONDS

# How long an operator may take to draw a target, with some reserve for the way there and back.
_REACH = NANOSECONDS * 11 // 5
# Of frames that are too many to be kept in full, the last one in each such time is kept.
_SPACING = NANOSECONDS // 10
# Share of the memory that these may take; what is left is for the newest frames.
_SHARE = 0.55


@dataclass(frozen=True, eq=False)
class ReducedFrame:
    """A frame that is kept in less memory.

    Attributes:
        stamp: When it was taken, in nanoseconds.
        pixels: The image, reduced.
        shape: Of the image before.
        reduction: Image pixels to one of the reduced ones along each axis.
    """

    stamp: int
    pixels: NDArray[Any]
    shape: tuple[int, ...]
    reduction: int

    @classmethod
    def of(cls, frame: Frame, reduction: int) -> ReducedFrame:
        """Reduce a frame; by a power of 2, halved again and again, which is fast."""
        pixels, shape = frame.image, frame.image.shape
        height, width = (length - length % reduction for length in shape[:2])
        pixels = pixels[:height, :width]
        for _ in range(reduction.bit_length() - 1):
            height, width = height // 2, width // 2
            pixels = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
        return cls(frame.stamp, pixels, shape, reduction)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the image before, pixels."""
        return self.shape[1], self.shape[0]

    @property
    def image(self) -> NDArray[Any]:
        """An image of the size and kind of the one before, made anew at each call."""
        height, width = (length * self.reduction for length in self.pixels.shape[:2])
        image = cv2.resize(self.pixels, (width, height), interpolation=cv2.INTER_LINEAR)
        below, beside = self.shape[0] - height, self.shape[1] - width
        if below or beside:
            image = cv2.copyMakeBorder(image, 0, below, 0, beside, cv2.BORDER_REPLICATE)
        return image


PastFrame = Frame | ReducedFrame


class FrameHistory:
    """Frames of one size and kind in the order of their stamps, bounded in number and bytes.

    The newest are kept in full. Where memory does not suffice for those of about two seconds, older
    ones are thinned out to ten in a second, and reduced as far as that takes.

    Args:
        frames: Most frames that are kept.
        megabytes: Most memory that their images hold, in units of 10^6 bytes.

    Attributes:
        dropped_until: Stamp of the last frame that was dropped for the bounds with all before it,
            or because those after it are of another size or kind; 0 if none was.
    """

    def __init__(self, frames: int = 0, megabytes: float = 0.0) -> None:
        self._full: deque[Frame] = deque()
        # All of them older than those in full.
        self._thinned: deque[PastFrame] = deque()
        self._bytes = 0
        self.dropped_until = 0
        self.limit(frames, megabytes)

    def limit(self, frames: int, megabytes: float) -> None:
        """Change the bounds; the oldest frames beyond them are thinned out, or dropped."""
        self._most_frames = frames
        self._most_bytes = megabytes * 1e6
        self._trim()

    def add(self, image: NDArray[np.generic], stamp: int) -> None:
        """Keep a frame.

        Those before are dropped if they are of another size or kind, or if time has gone back. A
        frame without a stamp (0) is not kept, because nobody could name it, and of two with one
        stamp the first is.
        """
        if stamp == 0:
            return
        if self._full:
            last = self._full[-1]
            fits = (last.image.shape, last.image.dtype) == (image.shape, image.dtype)
            if fits and stamp == last.stamp:
                return
            if stamp <= last.stamp:
                self.clear()
            elif not fits:
                self.clear()
                self.dropped_until = last.stamp
        self._full.append(Frame(image, stamp))
        self._bytes += _held_bytes(image)
        while self._thinned and stamp - self._thinned[0].stamp > _REACH:
            self._drop_oldest()
        self._trim()

    def since(self, stamp: int) -> list[PastFrame]:
        """The frames from the one nearest to `stamp` on; none if all are before it."""
        frames = [*self._thinned, *self._full]
        first = next((i for i, frame in enumerate(frames) if frame.stamp >= stamp), len(frames))
        if 0 < first < len(frames):
            before, after = stamp - frames[first - 1].stamp, frames[first].stamp - stamp
            first -= before < after
        return frames[first:]

    @property
    def stamps(self) -> list[int]:
        """The stamps of the frames that are kept."""
        return [frame.stamp for frame in (*self._thinned, *self._full)]

    def clear(self) -> None:
        """Forget all frames."""
        self._full.clear()
        self._thinned.clear()
        self._bytes = 0
        self.dropped_until = 0

    def _trim(self) -> None:
        while len(self._thinned) + len(self._full) > self._most_frames:
            self._drop_oldest()
        while self._bytes > self._most_bytes:
            if len(self._full) > 1:
                self._thin_out()
            else:
                self._drop_oldest()

    def _drop_oldest(self) -> None:
        dropped = (self._thinned or self._full).popleft()
        self._bytes -= _bytes_of(dropped)
        self.dropped_until = dropped.stamp

    def _thin_out(self) -> None:
        """Keep the oldest frame in full only if it is the last of its time, and then reduced."""
        frame = self._full.popleft()
        self._bytes -= _bytes_of(frame)
        if frame.stamp // _SPACING != self._full[0].stamp // _SPACING:
            reduction = self._reduction(frame.image)
            thinned = ReducedFrame.of(frame, reduction) if reduction > 1 else frame
            self._thinned.append(thinned)
            self._bytes += _bytes_of(thinned)
        elif not self._thinned:
            self.dropped_until = frame.stamp

    def _reduction(self, image: NDArray[np.generic]) -> int:
        """The power of 2 by which frames are reduced so that all that are thinned out fit."""
        held = _held_bytes(image)
        room = min(_SHARE * self._most_bytes, self._most_bytes - held)
        reduction = 1
        while held * (_REACH / _SPACING) > room * reduction**2:
            if 2 * reduction > min(image.shape[:2]):
                break
            reduction *= 2
        return reduction


def _bytes_of(frame: PastFrame) -> int:
    return frame.pixels.nbytes if isinstance(frame, ReducedFrame) else _held_bytes(frame.image)


def _held_bytes(image: NDArray[np.generic]) -> int:
    """The memory that lives as long as the image: a view holds all of what it is a view of."""
    owner: Any = image
    while isinstance(owner, np.ndarray) and owner.base is not None:
        owner = owner.base
    return memoryview(owner).nbytes
