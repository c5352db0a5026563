"""Video files, read in order from the start, as seeking in compressed video is not exact."""

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

# FFmpeg's decoder of texts, which it may also choose by the file name.
_TERMINAL_CODEC = int.from_bytes(b"ansi", "little")


class VideoFootage:
    """The frames of a video file, or a range of them.

    Stamps are index x interval instead of the container's, so that all decoders agree. The
    constructor decodes the first frame, to report errors early.

    Args:
        path: The file.
        first_frame: First frame to read, counted from 0.
        frame_count: Required number of frames from there; None reads to the end.
        frame_rate: Frames per second if the file has no rate.

    Raises:
        FootageError: The file cannot be read, or OpenCV cannot decode it.
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
                raise FootageError(f"video {path}: no frame can be decoded")
        finally:
            capture.release()
        rate_is_known = math.isfinite(rate) and 0.01 <= rate <= 10_000
        self.nominal_interval = 1.0 / (rate if rate_is_known else frame_rate)
        self.name = path.stem
        declared = int(count) - first_frame if math.isfinite(count) and count > 0 else None
        self.frame_count = frame_count if frame_count is not None else declared

    def frames(self) -> Iterator[Frame]:
        """Read the frames in order; see `Footage.frames`."""
        capture = self._open()
        try:
            for _ in range(self._first_frame):
                if not capture.grab():
                    raise self._too_short(0)
            index = 0
            while self._required_count is None or index < self._required_count:
                is_decoded, image = capture.read()
                if not is_decoded:
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
        expected = "some frames" if count is None else counted(count, "frame")
        return FootageError(
            f"video {self._path}: {expected} expected from frame {self._first_frame} "
            f"(counted from 0), only {frames_read} could be decoded"
        )
