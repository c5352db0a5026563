"""Start the tracker on a camera's images with a detector that starts and corrects its targets.

For example, on what a YOLO says of people and cars, a few times a second::

    ros2 launch pf_tracker_ros detector.launch.py image:=/camera/image_raw \
        detections:=/yolo/detections labels:=person,car

Or with the tracker's own detector of people, and no other node::

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

# Arguments that are parameters of the tracker and have the names of these.
EXTRA_TRACKER_PARAMETERS = ("max_targets", "built_in_detector", "built_in_detector_rate")


def start_tracker(context: LaunchContext) -> list[Node]:
    """The tracker node with what was given, and a console; the rest is for their own defaults."""
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
    """Arguments and the tracker; an empty argument leaves the node's own default in force."""
    return LaunchDescription(
        [
            *shared_arguments("image"),
            argument(
                "detections",
                "Topic of the detector, vision_msgs/Detection2DArray with the stamps of the "
                "images that it saw.",
                default="detections",
            ),
            argument(
                "labels", "Labels of the detections that count, such as person,car; empty: all."
            ),
            argument("score_above", "Detections of a lower score are left out."),
            argument("max_targets", "Most targets at a time.", default="32"),
            argument(
                "built_in_detector", "none, people or motion: a detector of the tracker's own."
            ),
            argument("built_in_detector_rate", "Most frames in a second that it looks at."),
            *shared_arguments("namespace", "preset", "params_file"),
            *shared_arguments("image_reliability", "image_transport", "seed"),
            *shared_arguments(
                "console", "console_port", "use_sim_time", "large_images", "log_level"
            ),
            OpaqueFunction(function=start_tracker),
        ]
    )
