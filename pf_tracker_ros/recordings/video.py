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

from pf_tracker_ros.recordings.errors import FAILED, UNREADABLE_SOURCE, RecordingError
from pf_tracker_ros.recordings.tracking import TrackedFrame

_CODEC = "mp4v"
# Frames that wait for the encoder; more would only take memory.
_QUEUE_LENGTH = 8
# Frame rates that MP4 supports, hertz.
_FRAME_RATE_RANGE = (0.1, 1000.0)


class AnnotatedVideo:
    """Writes the overlay of every frame into an MP4 file.

    A frame that cannot be decoded repeats the previous one, so that the video keeps its timing. An
    image of another size is scaled to fit the size of the first one.

    Args:
        path: Of the new file.
        frame_rate: Hertz.
    """

    def __init__(self, path: Path, frame_rate: float) -> None:
        self._path = path
        self._frame_rate = float(np.clip(frame_rate, *_FRAME_RATE_RANGE))
        self._frame_count = 0
        self._queue: deque[Future[None]] = deque()
        self._writer: cv2.VideoWriter | None = None
        self._problem = ""
        self._size = (0, 0)
        self._overlay: NDArray[Any] | None = None
        self._thread = ThreadPoolExecutor(1, "video")

    def write(self, tracked: TrackedFrame) -> None:
        """Queue a frame for the encoder.

        Raises:
            RecordingError: OpenCV cannot write the file.
        """
        if len(self._queue) == _QUEUE_LENGTH:
            self._queue.popleft().result()
        self._queue.append(self._thread.submit(self._encode, tracked))

    def close(self) -> None:
        """Complete the file.

        Raises:
            RecordingError: OpenCV cannot write the file, or no frame has an image.
            OSError: The disk is full.
        """
        try:
            for frame in self._queue:
                frame.result()
        finally:
            self.discard()
        if self._writer is None:
            raise RecordingError(
                f"{self._path.name} was not written, because no frame has an image: "
                f"{self._problem}",
                UNREADABLE_SOURCE,
            )
        self._check_frame_count()

    def discard(self) -> None:
        """End the thread and close the incomplete file."""
        self._thread.shutdown(cancel_futures=True)
        if self._writer is not None:
            self._writer.release()

    def _encode(self, tracked: TrackedFrame) -> None:
        if tracked.frame.image is not None:
            self._overlay = self._scaled_to_fit(tracked.draw())
        if self._overlay is not None:
            self._open().write(self._overlay)
            self._frame_count += 1
        else:
            self._problem = self._problem or tracked.problem

    def _open(self) -> cv2.VideoWriter:
        if self._writer is None:
            codec = cv2.VideoWriter.fourcc(*_CODEC)
            self._writer = cv2.VideoWriter(str(self._path), codec, self._frame_rate, self._size)
            if not self._writer.isOpened():
                raise RecordingError(
                    f"OpenCV cannot write {self._path.name}: its build has no MP4 encoder", FAILED
                )
        return self._writer

    def _scaled_to_fit(self, image: NDArray[Any]) -> NDArray[Any]:
        size = (image.shape[1], image.shape[0])
        if self._writer is None:
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
    """Whether an MP4 file has its index, which is written last (ISO/IEC 14496-12, 4.2)."""
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
