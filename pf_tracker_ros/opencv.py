"""OpenCV, which the package needs and does not install: there are several packages of it.

Only one of them may be in an environment, as all bring the same module; which one is for the user
to choose, and installing another over it would replace it.
"""

from importlib.util import find_spec


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
