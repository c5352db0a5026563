"""Frames of a recording in any order, as JPEG for a page."""

from __future__ import annotations

import threading
from collections.abc import Generator
from dataclasses import dataclass

from pf_tracker_ros.overlay import draw_overlay, encode_jpeg
from pf_tracker_ros.recordings.recording import CameraRecording, RecordedFrame, Recording


@dataclass(frozen=True)
class EncodedFrame:
    """A frame as JPEG.

    Attributes:
        frame: The frame with its image.
        jpeg: The encoded image, with the same aspect ratio.
    """

    frame: RecordedFrame
    jpeg: bytes

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the image, pixels."""
        assert self.frame.image is not None
        return self.frame.image.shape[1], self.frame.image.shape[0]


class SeekableFrames:
    """Random access to the frames of a recording; reading an earlier frame restarts it.

    A camera has one frame, a picture; each higher number takes a new one.

    Args:
        recording: The recording.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._frames: Generator[RecordedFrame, None, None] | None = None
        self._next = 0
        # The picture of a camera.
        self._shown: EncodedFrame | None = None
        self._is_closing = False
        self._lock = threading.Lock()

    def find(self, number: int) -> EncodedFrame:
        """A frame, or the next one after it with an image.

        Args:
            number: Counted from 0.

        Raises:
            LookupError: There is none.
            FootageError: The recording cannot be read that far.
        """
        with self._lock:
            if isinstance(self._recording, CameraRecording):
                return self._picture(self._recording, is_new=number > 0)
            if self._frames is None or number < self._next:
                self._restart()
            assert self._frames is not None
            for frame in self._frames:
                self._next = frame.index + 1
                if self._is_closing:
                    break
                if frame.index >= number and frame.image is not None:
                    return EncodedFrame(frame, _jpeg(frame))
            self._restart()
            raise LookupError(f"there is no image in frame {number} or after it")

    def _picture(self, camera: CameraRecording, *, is_new: bool) -> EncodedFrame:
        if is_new or self._shown is None:
            frame = camera.take()
            self._shown = EncodedFrame(frame, _jpeg(frame))
        return self._shown

    def close(self) -> None:
        """Close the recording, also during `find`."""
        self._is_closing = True
        with self._lock:
            if self._frames is not None:
                self._frames.close()

    def _restart(self) -> None:
        if self._frames is not None:
            self._frames.close()
        self._frames, self._next = self._recording.frames(), 0


def _jpeg(frame: RecordedFrame) -> bytes:
    assert frame.image is not None
    return encode_jpeg(draw_overlay(frame.image, None))
