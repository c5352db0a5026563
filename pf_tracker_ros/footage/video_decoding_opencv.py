"""Videos decoded by OpenCV, with the interface of `PyavVideo`."""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path

import cv2

from pf_tracker_ros.footage.base import FootageError
from pf_tracker_ros.footage.video_decoding import A_TEXT, Picture, Pictures, not_a_video
from pf_tracker_ros.plurals import counted

_TERMINAL_CODEC = int.from_bytes(b"ansi", "little")


class OpencvVideo:
    """A video file; see `PyavVideo`.

    Args:
        path: The file.

    Raises:
        FootageError: It is no video.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.damage = self.note = ""
        # Its number of frames is compared.
        self.has_frame_list = True
        capture = self._open()
        rate = capture.get(cv2.CAP_PROP_FPS)
        count = capture.get(cv2.CAP_PROP_FRAME_COUNT)
        capture.release()
        self.interval = 1.0 / rate if math.isfinite(rate) and rate > 0 else None
        self.frame_count = int(count) if math.isfinite(count) and count > 0 else None

    def pictures(self, first: int = 0) -> Pictures:
        """Decode the frames; see `PyavVideo.pictures`."""
        capture = self._open()
        try:
            index = 0
            while capture.grab():
                milliseconds = capture.get(cv2.CAP_PROP_POS_MSEC)
                # OpenCV returns 0 for an unknown time.
                is_timed = milliseconds > 0 or index == 0
                image = capture.retrieve()[1] if index >= first else None
                yield Picture(image, Fraction(milliseconds) / 1000 if is_timed else None)
                index += 1
        finally:
            capture.release()
        if self.frame_count is not None and index < self.frame_count:
            self.damage = (
                f"may be damaged: OpenCV read {index} of {counted(self.frame_count, 'frame')}; "
                "install PyAV (pip install av), which knows how many there are"
            )

    def _open(self) -> cv2.VideoCapture:
        # FFmpeg takes an absolute path for no network address.
        name = str(self._path.absolute())
        try:
            name.encode()
        except UnicodeEncodeError as error:
            raise FootageError(
                f"video {name!a}: OpenCV needs a file name in UTF-8; rename the file"
            ) from error
        capture = cv2.VideoCapture(name)
        if not capture.isOpened():
            raise not_a_video(self._path, "OpenCV cannot open it")
        if capture.get(cv2.CAP_PROP_FOURCC) == _TERMINAL_CODEC:
            capture.release()
            raise not_a_video(self._path, A_TEXT)
        return capture
