"""Images of successive frames, in memory up to a limit and in a temporary file beyond it."""

from __future__ import annotations

import math
import tempfile
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.recordings.errors import DISK_FULL, RecordingError

_LIMIT = 256 * 2**20


class _Place(NamedTuple):
    """An image in the temporary file."""

    offset: int
    shape: tuple[int, ...]
    dtype: np.dtype[Any]


class FrameStore:
    """Images by frame; close it after use.

    Args:
        limit: Bytes of the images in memory.
    """

    def __init__(self, limit: int = _LIMIT) -> None:
        self._limit = limit
        self._images: dict[int, NDArray[Any] | _Place] = {}
        self._size = 0
        self._in_file = 0
        self._file: IO[bytes] | None = None

    def add(self, frame: int, image: NDArray[Any]) -> None:
        """Add an image.

        Raises:
            RecordingError: The temporary file cannot be written.
        """
        if self._size + image.nbytes <= self._limit:
            self._images[frame] = image
            self._size += image.nbytes
            return
        try:
            if self._file is None:
                # It has no name, and so never stays behind.
                self._file = tempfile.TemporaryFile(prefix="track_")  # noqa: SIM115
            offset = self._file.seek(0, 2)
            self._file.write(np.ascontiguousarray(image).data)
            self._file.flush()
        except OSError as error:
            raise RecordingError(
                f"the images between two keyframes do not fit into {tempfile.gettempdir()} "
                f"({error.strerror}); set TMPDIR to a folder with more space, or add keyframes in "
                f"between, before frame {frame}",
                DISK_FULL,
            ) from error
        self._images[frame] = _Place(offset, image.shape, image.dtype)
        self._in_file += 1

    def find(self, frame: int) -> NDArray[Any] | None:
        """The image of a frame, None if there is none."""
        stored = self._images.get(frame)
        if not isinstance(stored, _Place):
            return stored
        assert self._file is not None
        self._file.seek(stored.offset)
        size = stored.dtype.itemsize * math.prod(stored.shape)
        return np.frombuffer(self._file.read(size), stored.dtype).reshape(stored.shape)

    def discard(self, frame: int) -> None:
        """Remove the image of a frame, if there is one."""
        stored = self._images.pop(frame, None)
        if isinstance(stored, np.ndarray):
            self._size -= stored.nbytes
        elif stored is not None:
            self._in_file -= 1
            if not self._in_file and self._file is not None:
                self._file.truncate(0)

    def close(self) -> None:
        """Remove all images."""
        self._images.clear()
        if self._file is not None:
            self._file.close()
