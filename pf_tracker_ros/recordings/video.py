"""The annotated video: every frame with its overlay, encoded in a thread of its own."""

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
# Frames that wait to be encoded; more would only hold memory.
_DEPTH = 8
# MP4 has no frame rates beyond these.
_RATES = (0.1, 1000.0)


class AnnotatedVideo:
    """Writes the overlay of every frame into an MP4 file.

    A frame that could not be decoded is the one before once more, so that the video keeps time; an
    image of another size than the first is fitted into it.

    Args:
        path: The file, made anew.
        frame_rate: Frames a second.
    """

    def __init__(self, path: Path, frame_rate: float) -> None:
        self._path = path
        self._rate = float(np.clip(frame_rate, *_RATES))
        self._count = 0
        self._waiting: deque[Future[None]] = deque()
        self._writer: cv2.VideoWriter | None = None
        self._problem = ""
        self._size = (0, 0)
        self._picture: NDArray[Any] | None = None
        self._thread = ThreadPoolExecutor(1, "video")

    def write(self, tracked: TrackedFrame) -> None:
        """Have a frame encoded.

        Raises:
            RecordingError: OpenCV cannot write the file.
        """
        if len(self._waiting) == _DEPTH:
            self._waiting.popleft().result()
        self._waiting.append(self._thread.submit(self._encode, tracked))

    def close(self) -> None:
        """Finish the file.

        Raises:
            RecordingError: OpenCV cannot write the file, or has written less than it was given, or
                no frame had an image.
            OSError: There is no room for it.
        """
        try:
            for frame in self._waiting:
                frame.result()
        finally:
            self.discard()
        if self._writer is None:
            raise RecordingError(
                f"there is no {self._path.name}, as no frame has an image: {self._problem}",
                UNREADABLE_SOURCE,
            )
        self._check()

    def discard(self) -> None:
        """Let the thread end and the file go, whatever it holds."""
        self._thread.shutdown(cancel_futures=True)
        if self._writer is not None:
            self._writer.release()

    def _encode(self, tracked: TrackedFrame) -> None:
        if tracked.frame.image is not None:
            self._picture = self._fitted(tracked.draw())
        if self._picture is not None:
            self._open().write(self._picture)
            self._count += 1
        else:
            self._problem = self._problem or tracked.problem

    def _open(self) -> cv2.VideoWriter:
        if self._writer is None:
            codec = cv2.VideoWriter.fourcc(*_CODEC)
            self._writer = cv2.VideoWriter(str(self._path), codec, self._rate, self._size)
            if not self._writer.isOpened():
                raise RecordingError(
                    f"OpenCV cannot write {self._path.name}: its build has no encoder for MP4",
                    FAILED,
                )
        return self._writer

    def _fitted(self, picture: NDArray[Any]) -> NDArray[Any]:
        size = (picture.shape[1], picture.shape[0])
        if self._writer is None:
            self._size = size
        if size == self._size:
            return picture
        width, height = self._size
        scale = min(width / size[0], height / size[1])
        inner = max(1, round(size[0] * scale)), max(1, round(size[1] * scale))
        canvas = np.zeros((height, width, 3), np.uint8)
        left, top = (width - inner[0]) // 2, (height - inner[1]) // 2
        canvas[top : top + inner[1], left : left + inner[0]] = cv2.resize(
            picture, inner, interpolation=cv2.INTER_AREA
        )
        return canvas

    def _check(self) -> None:
        """OpenCV says nothing of a disk that was full: count what can be read again."""
        found = 0
        # FFmpeg would complain of a file without an index by itself.
        if _has_index(self._path):
            capture = cv2.VideoCapture(str(self._path))
            found = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
            capture.release()
        if found < self._count:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._path))


def _has_index(path: Path) -> bool:
    """Whether an MP4 file has the part that is written last (ISO/IEC 14496-12, 4.2)."""
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
