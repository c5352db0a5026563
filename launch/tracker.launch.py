"""Start the tracker on a camera's images.

For example, for a target drawn as a box in the first frame::

    ros2 launch pf_tracker_ros tracker.launch.py image:=/camera/image_raw \
        target_box:="[42, 188, 44, 132]"
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from pf_tracker_ros.launching import (
    TRACKER_ARGUMENTS,
    LaunchArguments,
    argument,
    shared_arguments,
    tracker_nodes,
    tracker_overrides,
)


def start_tracker(context: LaunchContext) -> list[Node]:
    """The tracker with the given arguments, and a console on request."""
    given = LaunchArguments(context)
    parameters = tracker_overrides(given)
    if not given.flag("autostart"):
        parameters["autostart"] = False
    if box := given.box("target_box"):
        parameters["target_box"] = box
    return tracker_nodes(given, parameters, {"image": given.text("image")})


def generate_launch_description() -> LaunchDescription:
    """Arguments and the tracker; an empty argument keeps the node's default."""
    return LaunchDescription(
        [
            *shared_arguments("image", "target_box", *TRACKER_ARGUMENTS),
            argument(
                "autostart",
                "Activate the node at start-up; false waits for a lifecycle manager.",
                default="true",
            ),
            OpaqueFunction(function=start_tracker),
        ]
    )
