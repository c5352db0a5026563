"""OpenCV: presence, thread count, log level and the output of its libraries.

OpenCV is no declared dependency. Several PyPI packages provide the same module `cv2` and exclude
each other, so the user chooses one.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

# OpenCV's LOG_LEVEL_ERROR.
_ERRORS_ALONE = 2


def require_opencv() -> None:
    """Check that OpenCV is installed, without importing it.

    Raises:
        ModuleNotFoundError: OpenCV is missing; the message names the packages.
    """
    if find_spec("cv2") is None:
        raise ModuleNotFoundError(
            "OpenCV is missing: pip install opencv-python-headless (or, with windows, "
            "opencv-python or opencv-contrib-python; with ROS from apt: apt install "
            "python3-opencv)",
            name="cv2",
        )


@contextmanager
def one_opencv_thread() -> Iterator[None]:
    """Limit OpenCV to one thread within a block.

    The tracker reads small image regions; more threads only occupy other cores.
    """
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


@contextmanager
def quiet_opencv() -> Iterator[None]:
    """Suppress OpenCV's warnings on standard error within a block.

    With a full disk, OpenCV warns about every frame of a video.
    """
    import cv2

    before = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(_ERRORS_ALONE)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(before)


@contextmanager
def no_native_errors() -> Iterator[None]:
    """Discard what native libraries print on standard error within a block."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
