"""The annotated video: every frame with its overlay. A separate thread encodes it."""

from __future__ import annotations

import errno
import os
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.video_encoding import VideoEncoder, open_encoder
from pf_tracker_ros.recordings.errors import FAILED, UNREADABLE_SOURCE, RecordingError
from pf_tracker_ros.recordings.tracking import TrackedFrame

# Frames that wait for the encoder; more would only take memory.
_QUEUE_LENGTH = 8


class AnnotatedVideo:
    """Writes the overlay of every frame into an MP4 file.

    A frame that cannot be decoded repeats the previous one, so that frame n begins at n /
    `frame_rate`. An image of another size is scaled to fit the size of the first one.

    Attributes:
        note: Why browsers do not play it, as a sentence, or empty.

    Args:
        path: Of the new file.
        frame_rate: Hertz, see `playable_rate`.
    """

    def __init__(self, path: Path, frame_rate: float) -> None:
        self.note = ""
        self._path = path
        self._frame_rate = frame_rate
        self._frame_count = 0
        self._queue: deque[Future[None]] = deque()
        self._encoder: VideoEncoder | None = None
        self._problem = ""
        self._disk_error: OSError | None = None
        self._size = (0, 0)
        self._overlay: NDArray[Any] | None = None
        self._thread = ThreadPoolExecutor(1, "video")

    def write(self, tracked: TrackedFrame) -> None:
        """Queue a frame for the encoder.

        Raises:
            RecordingError: The file cannot be written.
        """
        if len(self._queue) == _QUEUE_LENGTH:
            self._queue.popleft().result()
        self._queue.append(self._thread.submit(self._encode, tracked))

    def close(self) -> None:
        """Complete the file.

        Raises:
            RecordingError: The file cannot be written, or no frame has an image.
            OSError: The disk is full.
        """
        try:
            for frame in self._queue:
                frame.result()
        finally:
            try:
                self.discard()
            except OSError as error:
                self._disk_error = self._disk_error or error
        if self._disk_error:
            raise self._disk_error
        if self._encoder is None:
            raise RecordingError(
                f"{self._path.name} was not written, because no frame has an image: "
                f"{self._problem}",
                UNREADABLE_SOURCE,
            )
        self._check_frame_count()

    def discard(self) -> None:
        """End the thread and close the file."""
        self._thread.shutdown(cancel_futures=True)
        if self._encoder is not None:
            self._encoder.close()

    def _encode(self, tracked: TrackedFrame) -> None:
        if tracked.frame.image is not None:
            self._overlay = self._scaled_to_fit(tracked.draw())
        if self._overlay is None:
            self._problem = self._problem or tracked.problem
            return
        self._frame_count += 1
        if self._disk_error is None:
            try:
                self._open().write(self._overlay)
            except OSError as error:
                # The other files may still have room.
                self._disk_error = error

    def _open(self) -> VideoEncoder:
        if self._encoder is None:
            try:
                self._encoder = open_encoder(self._path, self._frame_rate, self._size)
            except FootageError as error:
                raise RecordingError(str(error), FAILED) from error
            if not self._encoder.is_for_browsers:
                self.note = (
                    f"{self._path.name} is MPEG-4 Part 2, which browsers do not play; for H.264 "
                    "install PyAV (pip install av)"
                )
        return self._encoder

    def _scaled_to_fit(self, image: NDArray[Any]) -> NDArray[Any]:
        size = (image.shape[1], image.shape[0])
        if self._encoder is None:
            self._size = size
        if size == self._size:
            return image
        width, height = self._size
        scale = min(width / size[0], height / size[1])
        inner = max(1, round(size[0] * scale)), max(1, round(size[1] * scale))
        canvas = np.zeros((height, width, 3), np.uint8)
        left, top = (width - inner[0]) // 2, (height - inner[1]) // 2
        canvas[top : top + inner[1], left : left + inner[0]] = cv2.resize(
            image, inner, interpolation=cv2.INTER_AREA
        )
        return canvas

    def _check_frame_count(self) -> None:
        """Count the frames in the file, because OpenCV does not report a full disk."""
        readable = 0
        # FFmpeg would print an error about a file without an index.
        if _has_index(self._path):
            capture = cv2.VideoCapture(str(self._path))
            readable = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
            capture.release()
        if readable < self._frame_count:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._path))


def _has_index(path: Path) -> bool:
    """Whether an MP4 file has its index (ISO/IEC 14496-12, 4.2)."""
    with path.open("rb") as file:
        while len(head := file.read(8)) == 8:
            size, kind = int.from_bytes(head[:4], "big"), head[4:]
            if kind == b"moov":
                return True
            if size == 1:
                size = int.from_bytes(file.read(8), "big") - 8
            if size < 8:
                return False
            file.seek(size - 8, 1)
    return False
