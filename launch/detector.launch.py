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
from launch_ros.parameter_descriptions import ParameterValue

from pf_tracker_ros.launching import PACKAGE, Given, argument
from pf_tracker_ros.node.tracker.node_parameters import NodeParameters
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.tracking.presets import PRESETS

TEXTS = ("image_reliability", "image_transport")


def start_tracker(context: LaunchContext) -> list[Node]:
    """The tracker node with what was given, and a console; the rest is for their own defaults."""
    given = Given(context)
    parameters = {"use_sim_time": given.flag("use_sim_time")}
    parameters["max_targets"] = given.number("max_targets", int)
    for name in TEXTS:
        if given.text(name):
            parameters[name] = ParameterValue(given.text(name), value_type=str)
    if preset := given.choice("preset", PRESETS):
        parameters["preset"] = preset
    detectors = declarations(NodeParameters)["built_in_detector"].choices
    if detector := given.choice("built_in_detector", detectors):
        parameters["built_in_detector"] = detector
    if labels := given.words("labels"):
        parameters["detector.labels"] = labels
    if given.text("score_above"):
        parameters["detector.score_above"] = given.number("score_above", float)
    if given.text("built_in_detector_rate"):
        parameters["built_in_detector_rate"] = given.number("built_in_detector_rate", float)
    if given.text("seed"):
        parameters["seed"] = given.number("seed", int)
    of_both = {
        "package": PACKAGE,
        "namespace": given.text("namespace") or None,
        "remappings": [
            ("image", given.text("image")),
            ("detections", given.text("detections")),
        ],
        "arguments": given.log_arguments(),
        "additional_env": given.environment(),
        "output": "screen",
        "emulate_tty": True,
    }
    # What comes later wins, so an argument wins over the file.
    all_parameters = [*given.file("params_file"), parameters]
    nodes = [Node(executable="tracker", name="pf_tracker", parameters=all_parameters, **of_both)]
    if given.flag("console"):
        nodes.append(Node(executable="console", name="console", **of_both))
    return nodes


def generate_launch_description() -> LaunchDescription:
    """Arguments and the tracker; an empty argument leaves the node's own default in force."""
    return LaunchDescription(
        [
            argument("image", "Topic of the images.", default="image"),
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
            argument("namespace", "Namespace of the node, one for each of several cameras."),
            argument("preset", "Preset, such as default or li2007; taken whole, over the file."),
            argument("params_file", "ROS parameter file, such as a copy of one in config/."),
            argument("image_reliability", "auto, best_effort or reliable."),
            argument(
                "image_transport", "raw, or compressed for JPEG and PNG on <image>/compressed."
            ),
            argument("seed", "Seeds all randomness."),
            argument(
                "console",
                "Serve the page that shows and drives the tracker on the loopback, port 8642.",
                default="false",
            ),
            argument("use_sim_time", "Take the time from /clock.", default="false"),
            argument(
                "large_images",
                "Use the Fast DDS profile for large images; the publisher of the images needs it "
                "too.",
                default="false",
            ),
            argument("log_level", "debug, info, warn, error or fatal."),
            OpaqueFunction(function=start_tracker),
        ]
    )
