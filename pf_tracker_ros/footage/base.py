"""The interface of all footage: frames in order, each with a stamp."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.stamps import NANOSECONDS

# Stamp of the first frame of footage without stamps, nanoseconds; see `frame_stamp`.
FIRST_STAMP = NANOSECONDS
# Frames per second of footage without stamps and without a rate.
DEFAULT_FRAME_RATE = 25.0


class FootageError(ValueError):
    """A source that cannot be read; the message has the reason and what is accepted."""


class PartialFootageError(FootageError):
    """A source was read to its end, but frames are missing or damaged; raised after the others."""


class Footage(Protocol):
    """A source of frames: a video, a folder of images, a sequence folder or a bag.

    It only reads. The command `track` adds access by index and sidecar files in its recordings.

    Attributes:
        name: Short name for messages and tables.
        frame_count: Number of frames, None if unknown.
        nominal_interval: Seconds from one frame to the next.
        ground_truth: (frames, 4) boxes x, y, width, height in pixels, (x, y) the top-left corner
            counted from 0; a row of NaN where the target is absent. None without ground truth.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def frame_count(self) -> int | None: ...  # noqa: D102
    @property
    def nominal_interval(self) -> float: ...  # noqa: D102
    @property
    def ground_truth(self) -> NDArray[np.float64] | None: ...  # noqa: D102

    def frames(self) -> Iterator[Frame]:
        """Read the frames in order; each call starts from the first.

        Yields:
            Frames with rising stamps. Size and type may change, as with a camera.

        Raises:
            FootageError: A frame cannot be read.
            PartialFootageError: After the last frame, if others are missing or damaged.
        """
        ...


def frame_stamp(index: int, interval: float) -> int:
    """Stamp of a frame in nanoseconds, for footage without stamps.

    The first frame is at 1 s, because a stamp of 0 means "no stamp" in ROS.

    Args:
        index: Position of the frame, counted from 0.
        interval: Seconds from one frame to the next.
    """
    return FIRST_STAMP + round(index * interval * NANOSECONDS)


def describe_image(image: NDArray[Any]) -> str:
    """Size, channels and type of an image, for messages."""
    channels = 1 if image.ndim == 2 else image.shape[2]
    return f"{image.shape[1]}x{image.shape[0]}, {channels} channel(s) of {image.dtype}"
