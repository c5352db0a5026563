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
    DETECTOR_PARAMETERS,
    TRACKER_ARGUMENTS,
    LaunchArguments,
    argument,
    shared_arguments,
    tracker_nodes,
    tracker_overrides,
)
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters


def start_tracker(context: LaunchContext) -> list[Node]:
    """The tracker with the given arguments, and a console on request."""
    given = LaunchArguments(context)
    parameters = tracker_overrides(given, *DETECTOR_PARAMETERS)
    if labels := given.words("labels"):
        parameters["detector.labels"] = labels
    if given.text("score_above"):
        declared = declarations(TrackerParameters)
        parameters["detector.score_above"] = given.parameter(
            "score_above", declared["detector.score_above"]
        )
    topics = {"image": given.text("image"), "detections": given.text("detections")}
    return tracker_nodes(given, parameters, topics)


def generate_launch_description() -> LaunchDescription:
    """Arguments and the tracker; an empty argument keeps the node's default."""
    return LaunchDescription(
        [
            *shared_arguments("image", "detections"),
            argument(
                "labels", "Labels of the detections to use, such as person,car; empty for all."
            ),
            argument("score_above", "Minimum score of detections."),
            argument("max_targets", "Maximum number of targets.", default="32"),
            *shared_arguments("built_in_detector", "built_in_detector_rate"),
            *shared_arguments(*TRACKER_ARGUMENTS),
            OpaqueFunction(function=start_tracker),
        ]
    )
