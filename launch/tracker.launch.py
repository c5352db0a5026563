"""Start the tracker on a camera's images.

For example, for a target drawn as a box in the first frame::

    ros2 launch pf_tracker_ros tracker.launch.py image:=/camera/image_raw \
        target_box:="[62, 31, 53, 70]"
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from pf_tracker_ros.launching import PACKAGE, Given, argument
from pf_tracker_ros.tracking.presets import PRESETS

TEXTS = ("image_reliability", "image_transport")


def start_tracker(context: LaunchContext) -> list[Node]:
    """The tracker node with what was given, and a console; the rest is for their own defaults."""
    given = Given(context)
    parameters = {"use_sim_time": given.flag("use_sim_time")}
    for name in TEXTS:
        if given.text(name):
            parameters[name] = ParameterValue(given.text(name), value_type=str)
    if preset := given.choice("preset", PRESETS):
        parameters["preset"] = preset
    if not given.flag("autostart"):
        parameters["autostart"] = False
    if given.text("seed"):
        parameters["seed"] = given.number("seed", int)
    if box := given.box("target_box"):
        parameters["target_box"] = box
    of_both = {
        "package": PACKAGE,
        "namespace": given.text("namespace") or None,
        "remappings": [("image", given.text("image"))],
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
            argument("namespace", "Namespace of the node, one for each of several cameras."),
            argument("preset", "Preset, such as default or li2007; taken whole, over the file."),
            argument("params_file", "ROS parameter file, such as a copy of one in config/."),
            argument(
                "target_box",
                "Box to track from the first image on, [x, y, width, height] in pixels; without it "
                "the tracker waits for a target on ~/target.",
            ),
            argument("image_reliability", "auto, best_effort or reliable."),
            argument(
                "image_transport", "raw, or compressed for JPEG and PNG on <image>/compressed."
            ),
            argument("seed", "Seeds all randomness."),
            argument(
                "autostart",
                "Start tracking at once; false leaves it to a lifecycle manager.",
                default="true",
            ),
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
