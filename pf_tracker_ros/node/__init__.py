"""The ROS nodes, and the conversion between ROS and the library."""

from importlib.util import find_spec

if find_spec("rclpy") is None:
    raise ModuleNotFoundError(
        "rclpy is not installed: source an installed ROS 2, or run pip install '.[ros]' in this "
        "virtual environment"
    )
