"""Video files, read in order from the start: seeking in compressed video is not exact."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import cv2

from pf_tracker_ros.footage.access import check_file, unreadable
from pf_tracker_ros.footage.base import DEFAULT_FRAME_RATE, FootageError, frame_stamp
from pf_tracker_ros.footage.ground_truth import GROUND_TRUTH_FILES
from pf_tracker_ros.footage.text_files import is_text
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.plurals import counted

_ACCEPTED = (
    "accepted are video files (mp4, avi, mkv, ...), folders of images, sequence folders and bags"
)

# What FFmpeg decodes texts with; it goes by the name of a file as well as by its content.
_TERMINAL_CODEC = int.from_bytes(b"ansi", "little")


class VideoFootage:
    """The frames of a video file, or a stretch of them.

    The frame rate is the file's; stamps are index x interval, not the container's, so that they
    are the same with every decoder.

    The first frame is decoded at once, so that errors show.

    Args:
        path: The file.
        first_frame: Where to begin, counted from 0.
        frame_count: How many frames there must be from there; None reads to the end.
        frame_rate: Frames a second, used if the file does not tell.

    Raises:
        FootageError: The file cannot be read, or is not a video that OpenCV can decode.
    """

    ground_truth = None

    def __init__(
        self,
        path: Path,
        *,
        first_frame: int = 0,
        frame_count: int | None = None,
        frame_rate: float = DEFAULT_FRAME_RATE,
    ) -> None:
        check_file(path, "video")
        self._path = path
        self._first_frame = first_frame
        self._required_count = frame_count
        capture = self._open()
        try:
            rate = capture.get(cv2.CAP_PROP_FPS)
            count = capture.get(cv2.CAP_PROP_FRAME_COUNT)
            if not capture.grab():
                raise FootageError(f"video {path}: not one frame can be decoded")
        finally:
            capture.release()
        rate_is_known = math.isfinite(rate) and 0.01 <= rate <= 10_000
        self.nominal_interval = 1.0 / (rate if rate_is_known else frame_rate)
        self.name = path.stem
        announced = int(count) - first_frame if math.isfinite(count) and count > 0 else None
        self.frame_count = frame_count if frame_count is not None else announced

    def frames(self) -> Iterator[Frame]:
        """Read the frames in order; see `Footage.frames`."""
        capture = self._open()
        try:
            for _ in range(self._first_frame):
                if not capture.grab():
                    raise self._too_short(0)
            index = 0
            while self._required_count is None or index < self._required_count:
                decoded, image = capture.read()
                if not decoded:
                    if self._required_count is not None or index == 0:
                        raise self._too_short(index)
                    return
                yield Frame(image, frame_stamp(index, self.nominal_interval))
                index += 1
        finally:
            capture.release()

    def _open(self) -> cv2.VideoCapture:
        try:
            if is_text(self._path):
                raise self._is_text()
        except OSError as error:
            raise unreadable(self._path, "video", error) from error
        # An absolute path is never taken for the address of a stream.
        name = str(self._path.absolute())
        try:
            name.encode()
        except UnicodeEncodeError as error:
            raise FootageError(
                f"video {name!a} has a name that OpenCV cannot take; rename it, in UTF-8"
            ) from error
        capture = cv2.VideoCapture(name)
        if not capture.isOpened():
            raise FootageError(f"{self._path} is not a video that OpenCV can open; {_ACCEPTED}")
        if capture.get(cv2.CAP_PROP_FOURCC) == _TERMINAL_CODEC:
            capture.release()
            raise self._is_text()
        return capture

    def _is_text(self) -> FootageError:
        if self._path.name in GROUND_TRUTH_FILES:
            return FootageError(
                f"{self._path} is the ground truth of a sequence, not a video; give its folder, "
                f"{self._path.parent}"
            )
        return FootageError(
            f"{self._path} is not a video that OpenCV can open: it is a text or a playlist; "
            f"{_ACCEPTED}"
        )

    def _too_short(self, frames_read: int) -> FootageError:
        count = self._required_count
        wanted = "some frames" if count is None else counted(count, "frame")
        return FootageError(
            f"video {self._path}: {wanted} expected from frame {self._first_frame} "
            f"(counted from 0), only {frames_read} could be decoded"
        )
