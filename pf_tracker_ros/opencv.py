"""OpenCV, which the package needs and does not install: there are several packages of it.

Only one of them may be in an environment, as all bring the same module; which one is for the user
to choose, and installing another over it would replace it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

# OpenCV's LOG_LEVEL_ERROR.
_ERRORS_ALONE = 2


def require_opencv() -> None:
    """Make sure that there is an OpenCV, without importing it.

    Raises:
        ModuleNotFoundError: There is none; the message says how to get one.
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
    """Hold OpenCV to one thread for the length of a block.

    The tracker looks at small regions: more threads make it no faster and keep other cores busy.
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
    """Keep OpenCV's warnings off standard error for the length of a block.

    A disk that is full has it warn of every frame of a video.
    """
    import cv2

    before = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(_ERRORS_ALONE)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(before)
