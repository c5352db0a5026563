"""Start the tracker on a camera's images, with a detector that starts and corrects targets.

For example, with a YOLO that detects people and cars a few times a second::

    ros2 launch pf_tracker_ros detector.launch.py image:=/camera/image_raw \
        detections:=/yolo/detections labels:=person,car

Or with the built-in detector of people, without another node::

    ros2 launch pf_tracker_ros detector.launch.py image:=/camera/image_raw \
        built_in_detector:=people
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from pf_tracker_ros.launching import (
    TRACKER_ARGUMENTS,
    LaunchArguments,
    argument,
    detector_overrides,
    shared_arguments,
    tracker_nodes,
)


def start_tracker(context: LaunchContext) -> list[Node]:
    """The tracker with the given arguments, and a console on request."""
    given = LaunchArguments(context)
    parameters = detector_overrides(given)
    topics = {"image": given.text("image"), "detections": given.text("detections")}
    return tracker_nodes(given, parameters, topics)


def generate_launch_description() -> LaunchDescription:
    """Arguments and the tracker; an empty argument keeps the node's default."""
    return LaunchDescription(
        [
            *shared_arguments("image", "detections", "labels", "score_above"),
            argument("max_targets", "Maximum number of targets.", default="32"),
            *shared_arguments("built_in_detector", "built_in_detector_rate"),
            *shared_arguments(*TRACKER_ARGUMENTS),
            OpaqueFunction(function=start_tracker),
        ]
    )
