"""Decoders of video files: PyAV, or OpenCV where PyAV is not installed.

Both use FFmpeg's libraries and give the same images and times. Only PyAV has access to the errors
of decoding, and to the list of frames in the file, by which a damaged file differs from one that
an editor has cut without encoding it again: such a file keeps frames that are not to be shown.
"""

from __future__ import annotations

import functools
from collections.abc import Generator
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from numpy.typing import NDArray

from pf_tracker_ros.footage.base import FootageError

if TYPE_CHECKING:
    from pf_tracker_ros.footage.video_decoding_opencv import OpencvVideo
    from pf_tracker_ros.footage.video_decoding_pyav import PyavVideo

Video: TypeAlias = "PyavVideo | OpencvVideo"
"""An opened video."""

_PYAV_VERSION = 17
A_TEXT = "it is a text or a playlist"
"""Reason of `not_a_video`."""


class Picture(NamedTuple):
    """A decoded frame.

    Attributes:
        image: (H, W, 3) uint8 BGR, rotated for display; None if it was not asked for.
        time: In the container's time, seconds; None if it has none.
    """

    image: NDArray[Any] | None
    time: Fraction | None


Pictures: TypeAlias = Generator[Picture, None, None]


def open_video(path: Path) -> Video:
    """Open a video file.

    Args:
        path: Of a regular file that is no text.

    Raises:
        FootageError: It is no video.
    """
    if has_pyav():
        from pf_tracker_ros.footage.video_decoding_pyav import PyavVideo

        return PyavVideo(path)
    from pf_tracker_ros.footage.video_decoding_opencv import OpencvVideo

    return OpencvVideo(path)


@functools.cache
def has_pyav() -> bool:
    """Whether PyAV is installed, in a version with the index of a file."""
    try:
        import av
    except ImportError:
        return False
    return int(av.__version__.partition(".")[0]) >= _PYAV_VERSION


def not_a_video(path: Path, reason: str) -> FootageError:
    """The error for a file without a video."""
    return FootageError(
        f"{path} is not a video that can be decoded: {reason}; accepted are video files (mp4, avi, "
        "mkv, ...), folders of images, sequence folders and bags"
    )
