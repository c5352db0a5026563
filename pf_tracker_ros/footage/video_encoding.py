"""Videos that browsers play.

1. With PyAV, the codec is H.264, or VP9 where its FFmpeg has no H.264 encoder. Browsers play both.
2. Without PyAV, OpenCV writes H.264 where its FFmpeg can, as that of Ubuntu, else MPEG-4 Part 2,
   which needs a video player.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.footage.base import FootageError
from pf_tracker_ros.opencv import no_native_errors

# Frame rates that MP4 supports, hertz.
_FRAME_RATE_RANGE = (0.1, 1000.0)
# Largest denominator of a frame rate.
_CLOCK_RATE = 90_000
# Seconds between frames that a player can seek to without decoding others.
_KEY_FRAME_INTERVAL = 1.0
# Of ITU-T H.273: BT.709, and the limited range of video.
_BT709, _LIMITED_RANGE = 1, 1


class _Codec(NamedTuple):
    """An encoder of FFmpeg with its options, for boxes with sharp edges."""

    name: str
    options: Mapping[str, str]


_CODECS = (
    # Without frames that are out of order, so that players seek exactly.
    _Codec("libx264", {"preset": "veryfast", "crf": "21", "bf": "0"}),
    _Codec(
        "libvpx-vp9",
        {"deadline": "realtime", "cpu-used": "8", "row-mt": "1", "crf": "32", "b": "0"},
    ),
)
# Codes of H.264 and MPEG-4 Part 2 for OpenCV. Its VP9 encoder takes 200 ms for an image of
# 1280 x 720 pixels.
_OPENCV_CODES = ("avc1", "mp4v")


def playable_rate(frame_rate: float) -> float:
    """The nearest frame rate that a video can have, hertz."""
    return float(np.clip(frame_rate, *_FRAME_RATE_RANGE))


def open_encoder(path: Path, frame_rate: float, size: tuple[int, int]) -> VideoEncoder:
    """Open a new MP4 file.

    Args:
        path: Of the file.
        frame_rate: Hertz; see `playable_rate`.
        size: Width and height of the images, pixels.

    Raises:
        FootageError: OpenCV cannot write the file.
    """
    codec, rate = _pyav_codec(), playable_rate(frame_rate)
    return PyavEncoder(path, codec, rate, size) if codec else OpencvEncoder(path, rate, size)


class PyavEncoder:
    """FFmpeg by PyAV. The index comes first, so that a browser plays while it loads.

    Attributes:
        is_for_browsers: Whether browsers play it.

    Args:
        path: Of the file.
        codec: The encoder.
        rate: Hertz.
        size: Width and height of the images, pixels.
    """

    is_for_browsers = True

    def __init__(self, path: Path, codec: _Codec, rate: float, size: tuple[int, int]) -> None:
        import av

        exact_rate = Fraction(rate).limit_denominator(_CLOCK_RATE)
        # With a prefix, no file name is taken for a network address.
        name = f"file:{path.absolute()}"
        self._container = av.open(name, "w", format="mp4", options={"movflags": "+faststart"})
        # Its type depends on the codec's name.
        stream: Any = self._container.add_stream(
            codec.name, exact_rate, options=dict(codec.options)
        )
        # Browsers decode 4:2:0, which needs an even size.
        stream.width, stream.height = (side + side % 2 for side in size)
        stream.pix_fmt = "yuv420p"
        context = stream.codec_context
        context.gop_size = max(1, round(_KEY_FRAME_INTERVAL * rate))
        context.color_primaries = context.color_trc = context.colorspace = _BT709
        context.color_range = _LIMITED_RANGE
        self._stream = stream
        self._frame_of = av.VideoFrame.from_ndarray
        self._time_base = 1 / exact_rate
        self._count = 0
        self._is_open = True

    def write(self, image: NDArray[Any]) -> None:
        """Write an image, (H, W, 3) uint8 BGR.

        Raises:
            OSError: The file cannot be written.
        """
        odd = image.shape[0] % 2, image.shape[1] % 2
        if any(odd):
            border = (0, odd[0], 0, odd[1])
            image = cv2.copyMakeBorder(image, *border, borderType=cv2.BORDER_REPLICATE)
        frame = self._frame_of(image, format="bgr24").reformat(
            format="yuv420p", dst_colorspace=_BT709, dst_color_range=_LIMITED_RANGE
        )
        frame.pts, frame.time_base = self._count, self._time_base
        self._count += 1
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        """Complete the file; raises OSError if it cannot be written."""
        if not self._is_open:
            return
        self._is_open = False
        try:
            self._container.mux(self._stream.encode(None))
        finally:
            self._container.close()


class OpencvEncoder:
    """OpenCV with the encoders that its FFmpeg has. It does not report a full disk.

    Attributes:
        is_for_browsers: Whether browsers play it.

    Args:
        path: Of the file.
        rate: Hertz.
        size: Width and height of the images, pixels.

    Raises:
        FootageError: It has none for MP4.
    """

    def __init__(self, path: Path, rate: float, size: tuple[int, int]) -> None:
        for code in _OPENCV_CODES:
            # FFmpeg prints a line for an encoder that it lacks.
            with no_native_errors():
                self._writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), rate, size)
            self.is_for_browsers = code != _OPENCV_CODES[-1]
            if self._writer.isOpened():
                return
        raise FootageError(f"OpenCV cannot write {path.name}: its build has no MP4 encoder")

    def write(self, image: NDArray[Any]) -> None:
        """Write an image, (H, W, 3) uint8 BGR."""
        self._writer.write(image)

    def close(self) -> None:
        """Complete the file."""
        self._writer.release()


VideoEncoder: TypeAlias = PyavEncoder | OpencvEncoder
"""An open video file."""


@functools.cache
def _pyav_codec() -> _Codec | None:
    """The first codec that PyAV can encode; None without PyAV."""
    try:
        import av
    except ImportError:
        return None
    return next((codec for codec in _CODECS if codec.name in av.codecs_available), None)
