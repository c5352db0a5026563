"""Cameras of this machine (USB, by number) and of the network (RTSP). Needs OpenCV with FFmpeg.

A thread reads the camera all the time and keeps the newest picture, so that a slow reader skips
pictures instead of falling behind. The stamp of a picture is the time at which it was read.
"""

from __future__ import annotations

import re
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import cv2
from numpy.typing import NDArray

from pf_tracker_ros.footage.base import DEFAULT_FRAME_RATE, FootageError
from pf_tracker_ros.opencv import no_native_errors

_NETWORK_SCHEMES = ("rtsp", "rtsps")
_DEVICE = re.compile(r"(?:/dev/video)?(\d{1,4})")
# Seconds until a silent camera is an error.
_TIMEOUT = 10.0
# A camera adapts to the light in the first pictures.
_WARM_UP = 5
# A camera that states another frame rate does not know its own.
_FRAME_RATES = (1.0, 240.0)


class CameraImage(NamedTuple):
    """A picture of a camera.

    Attributes:
        image: (H, W, 3) uint8 BGR.
        stamp: When it was read, nanoseconds since 1970.
    """

    image: NDArray[Any]
    stamp: int


def is_camera(source: str) -> bool:
    """Whether a source is a camera: a number such as 0, /dev/video0, or an RTSP address.

    A number that is also the name of a file or folder is that.
    """
    if urlsplit(source).scheme in _NETWORK_SCHEMES:
        return True
    is_device = _DEVICE.fullmatch(source) is not None
    return is_device and not (Path(source).is_file() or Path(source).is_dir())


def camera_name(source: str) -> str:
    """A camera's name for messages and reports, without the password of its address."""
    parts = urlsplit(source)
    if parts.scheme in _NETWORK_SCHEMES:
        return parts._replace(netloc=parts.netloc.rpartition("@")[2], query="").geturl()
    device = _DEVICE.fullmatch(source)
    return f"camera {int(device[1])}" if device else source


class Camera:
    """An open camera.

    Attributes:
        name: As `camera_name`.
        interval: Seconds from one picture to the next, by the camera's own word.

    Args:
        source: See `is_camera`.

    Raises:
        FootageError: It cannot be opened.
    """

    def __init__(self, source: str) -> None:
        self.name = camera_name(source)
        device = _DEVICE.fullmatch(source)
        self._capture = self._open_device(int(device[1])) if device else self._open_address(source)
        rate = float(self._capture.get(cv2.CAP_PROP_FPS))
        slowest, fastest = _FRAME_RATES
        self.interval = 1.0 / (rate if slowest <= rate <= fastest else DEFAULT_FRAME_RATE)
        self._newest: CameraImage | None = None
        self._has_ended = False
        self._condition = threading.Condition()
        # As a daemon, it cannot keep the process from ending while the camera is silent.
        self._thread = threading.Thread(
            target=self._read, args=(_WARM_UP if device else 0,), name="camera", daemon=True
        )
        self._thread.start()

    def next(self) -> CameraImage:
        """Wait for a picture that is newer than the last one.

        Raises:
            FootageError: The camera sends no picture any more.
        """
        with self._condition:
            self._condition.wait_for(lambda: self._newest or self._has_ended, _TIMEOUT)
            picture, self._newest = self._newest, None
        if picture is None:
            raise FootageError(f"{self.name} sends no pictures; check its cable or network")
        return picture

    def close(self) -> None:
        """Close it."""
        self._has_ended = True
        self._thread.join(_TIMEOUT)

    def _open_device(self, number: int) -> cv2.VideoCapture:
        with no_native_errors():
            capture = cv2.VideoCapture(number)
            # Raw pictures of this size would not fit through a USB cable in time.
            capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
        if capture.isOpened():
            return capture
        found = sorted(path.name.removeprefix("video") for path in Path("/dev").glob("video*"))
        here = f"cameras here: {', '.join(found)}" if found else "this machine has no camera"
        raise FootageError(f"{self.name} cannot be opened; {here}")

    def _open_address(self, address: str) -> cv2.VideoCapture:
        milliseconds = round(1e3 * _TIMEOUT)
        limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, milliseconds]
        limits += [cv2.CAP_PROP_READ_TIMEOUT_MSEC, milliseconds]
        with no_native_errors():
            capture = cv2.VideoCapture(address, cv2.CAP_FFMPEG, limits)
        if capture.isOpened():
            return capture
        raise FootageError(
            f"{self.name} cannot be opened; check address, user and password, for example with a "
            "video player"
        )

    def _read(self, dropped: int) -> None:
        while not self._has_ended:
            is_read, image = self._capture.read()
            dropped -= 1
            with self._condition:
                if is_read and dropped < 0:
                    self._newest = CameraImage(image, time.time_ns())
                self._has_ended |= not is_read
                self._condition.notify()
        self._capture.release()
