"""The ROS side: the nodes, and what turns messages into arrays and estimates into messages."""

from importlib.util import find_spec

if find_spec("rclpy") is None:
    raise ModuleNotFoundError(
        "there is no rclpy: source a ROS 2 that is installed, or install one into this virtual "
        "environment with pip install '.[ros]'"
    )
