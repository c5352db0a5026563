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
    LaunchArguments,
    argument,
    shared_arguments,
    tracker_nodes,
    tracker_overrides,
)
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters

# Arguments that are parameters of the tracker, by the same name.
EXTRA_TRACKER_PARAMETERS = ("max_targets", "built_in_detector", "built_in_detector_rate")


def start_tracker(context: LaunchContext) -> list[Node]:
    """The tracker with the given arguments, and a console on request."""
    given = LaunchArguments(context)
    parameters = tracker_overrides(given)
    declared = declarations(NodeParameters)
    for name in EXTRA_TRACKER_PARAMETERS:
        if given.text(name):
            parameters[name] = given.parameter(name, declared[name])
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
            *shared_arguments("image"),
            argument(
                "detections",
                "Topic of the detector, vision_msgs/Detection2DArray, stamped as its images.",
                default="detections",
            ),
            argument(
                "labels", "Labels of the detections to use, such as person,car; empty for all."
            ),
            argument("score_above", "Minimum score of detections."),
            argument("max_targets", "Maximum number of targets.", default="32"),
            argument("built_in_detector", "Detector within the tracker: none, people or motion."),
            argument("built_in_detector_rate", "Maximum rate of the built-in detector, Hz."),
            *shared_arguments("namespace", "preset", "params_file"),
            *shared_arguments("image_reliability", "image_transport", "seed"),
            *shared_arguments(
                "console", "console_port", "use_sim_time", "large_images", "log_level"
            ),
            OpaqueFunction(function=start_tracker),
        ]
    )
