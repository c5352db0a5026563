"""Arguments and nodes shared by the launch files; needs the ROS packages launch and launch_ros."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.node.console.console_parameters import ConsoleParameters
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import Declaration, declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters

PACKAGE = "pf_tracker_ros"
# Launch arguments that are tracker parameters of the same names; those of a detector are not in
# every launch file.
TRACKER_PARAMETERS = ("preset", "image_reliability", "image_transport", "seed")
DETECTOR_PARAMETERS = ("max_targets", "built_in_detector", "built_in_detector_rate")
# Launch arguments that are localizer parameters, with an underscore for the dot of a name.
LOCALIZER_PARAMETERS = (
    "method",
    "fixed_frame",
    "camera_height",
    "camera_pitch",
    "camera_roll",
    "target_height",
    "target_height_sd",
    "depth_transport",
    "depth_tolerance",
    "min_confidence",
    "coast",
    "hold",
)
_LOG_LEVELS = "debug, info, warn, error, fatal"

# Name to description and default of the arguments that several launch files declare.
_SHARED = {
    "image": ("Topic of the images.", "image"),
    "namespace": ("Namespace of the node, one for each of several cameras.", ""),
    "preset": ("Preset, such as default or li2007; replaces the file's preset.", ""),
    "params_file": ("ROS parameter file, such as a copy of one in config/.", ""),
    "image_reliability": ("auto, best_effort or reliable.", ""),
    "image_transport": ("raw, or compressed for JPEG and PNG on <image>/compressed.", ""),
    "seed": ("Seed of the random number generators.", ""),
    "target_box": (
        "Box to track from the first image on, [x, y, width, height] in pixels; empty waits for a "
        "target.",
        "",
    ),
    "detections": (
        "Topic of a detector, vision_msgs/Detection2DArray, stamped as its images.",
        "detections",
    ),
    "labels": ("Labels of the detections to use, such as person,car; empty for all.", ""),
    "score_above": ("Minimum score of detections.", ""),
    "built_in_detector": ("Detector within the tracker: none, people or motion.", ""),
    "built_in_detector_rate": ("Maximum rate of the built-in detector, Hz.", ""),
    "console": ("Serve the console page on the loopback interface.", "false"),
    "console_port": ("Port of the console, a different one for each; default 8642.", ""),
    "use_sim_time": ("Take the time from /clock.", "false"),
    "large_images": (
        "Use the Fast DDS profile for large images; the image publisher needs it too.",
        "false",
    ),
    "log_level": ("debug, info, warn, error or fatal.", ""),
}

TRACKER_ARGUMENTS = (
    "namespace",
    "preset",
    "params_file",
    "image_reliability",
    "image_transport",
    "seed",
    "console",
    "console_port",
    "use_sim_time",
    "large_images",
    "log_level",
)
"""Shared arguments of every launch file that starts a tracker on a camera."""

_FLAGS = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}


class LaunchArguments:
    """Values of a launch file's arguments.

    Args:
        context: Context of the running launch.
    """

    def __init__(self, context: LaunchContext) -> None:
        self._context = context

    def text(self, name: str) -> str:
        """The argument as text."""
        return str(LaunchConfiguration(name).perform(self._context))

    def flag(self, name: str) -> bool:
        """The argument as a boolean, case-insensitive.

        Raises:
            ValueError: It is neither true nor false.
        """
        text = self.text(name)
        if text.lower() not in _FLAGS:
            raise ValueError(f"argument {name}:={text}; allowed: true or false")
        return _FLAGS[text.lower()]

    def parameter(self, name: str, declaration: Declaration) -> Any:
        """The argument as value of a scalar node parameter.

        Args:
            name: Name of the argument.
            declaration: Declaration of the parameter.

        Raises:
            ValueError: The parameter does not allow the value.
        """
        text, kind = self.text(name), declaration.type
        try:
            value = declaration.validate(kind(text))
        except ValueError:
            allowed = f"{declaration.type_name}, {declaration.allowed}"
            raise ValueError(
                f"argument {name}:={text}; allowed: {', '.join(declaration.choices) or allowed}"
            ) from None
        return ParameterValue(value, value_type=str) if kind is str else value

    def file(self, name: str) -> list[str]:
        """The argument as a path, in a list that is empty without one.

        Raises:
            ValueError: The file does not exist.
        """
        text = self.text(name)
        if text and not Path(text).expanduser().is_file():
            raise ValueError(f"argument {name}:={text}; the file does not exist")
        return [str(Path(text).expanduser())] if text else []

    def box(self, name: str) -> list[float]:
        """The argument as the four numbers of a box, brackets optional; empty for no box.

        Raises:
            ValueError: It is not a box.
        """
        text = self.text(name)
        try:
            numbers = [float(part) for part in text.strip("[] ").split(",") if part.strip()]
        except ValueError:
            numbers = [0.0]
        if len(numbers) not in (0, 4) or min(numbers[2:], default=1.0) <= 0.0:
            raise ValueError(
                f"argument {name}:={text}; allowed: [x, y, width, height] in pixels, width and "
                "height above 0"
            )
        return numbers

    def words(self, name: str) -> list[str]:
        """The argument as a list of words, brackets optional."""
        words = (part.strip(" '\"") for part in self.text(name).strip("[] ").split(","))
        return [word for word in words if word]

    def log_arguments(self) -> list[str]:
        """Command-line arguments of a node for the launch argument `log_level`.

        Raises:
            ValueError: It is neither LEVEL nor LOGGER:=LEVEL.
        """
        level = self.text("log_level")
        if level and level.rpartition(":=")[2].lower() not in _LOG_LEVELS.split(", "):
            raise ValueError(f"argument log_level:={level}; allowed: {_LOG_LEVELS}")
        return ["--ros-args", "--log-level", level] if level else []

    def environment(self) -> dict[str, str]:
        """Environment variables for the launch argument `large_images`."""
        if not self.flag("large_images"):
            return {}
        profile = Path(get_package_share_directory(PACKAGE)) / "config/fastdds_large_images.xml"
        return {"FASTRTPS_DEFAULT_PROFILES_FILE": str(profile)}

    def common_node_options(self) -> dict[str, Any]:
        """Keywords of `launch_ros.actions.Node` for every node."""
        return {
            "package": PACKAGE,
            "namespace": self.text("namespace") or None,
            "additional_env": self.environment(),
            "output": "screen",
            "emulate_tty": True,
        }


def argument(name: str, description: str, default: str = "") -> DeclareLaunchArgument:
    """Declare an optional launch argument."""
    return DeclareLaunchArgument(name, default_value=default, description=description)


def shared_arguments(*names: str) -> list[DeclareLaunchArgument]:
    """Declare some of the arguments that several launch files have."""
    return [argument(name, *_SHARED[name]) for name in names]


def tracker_overrides(given: LaunchArguments, *further: str) -> dict[str, Any]:
    """Tracker parameters that launch arguments set.

    Args:
        given: The launch arguments.
        *further: Names of arguments that are parameters, besides `TRACKER_PARAMETERS`.

    Raises:
        ValueError: An argument is not allowed.
    """
    parameters: dict[str, Any] = {"use_sim_time": given.flag("use_sim_time")}
    declared = declarations(NodeParameters)
    for name in (*TRACKER_PARAMETERS, *further):
        if given.text(name):
            parameters[name] = given.parameter(name, declared[name])
    return parameters


def detector_overrides(given: LaunchArguments) -> dict[str, Any]:
    """Tracker parameters that launch arguments set, with those of a detector.

    Args:
        given: The launch arguments.

    Raises:
        ValueError: An argument is not allowed.
    """
    parameters = tracker_overrides(given, *DETECTOR_PARAMETERS)
    if labels := given.words("labels"):
        parameters["detector.labels"] = labels
    name = "detector.score_above"
    if given.text("score_above"):
        parameters[name] = given.parameter("score_above", declarations(TrackerParameters)[name])
    return parameters


def tracker_nodes(
    given: LaunchArguments, parameters: Mapping[str, Any], remappings: Mapping[str, str]
) -> list[Node]:
    """The tracker, and the console if requested.

    Args:
        given: The launch arguments.
        parameters: Tracker parameters; they take precedence over the parameter file.
        remappings: Name in the nodes to topic.

    Raises:
        ValueError: An argument is not allowed.
    """
    options = given.common_node_options() | {
        "remappings": [*remappings.items()],
        "arguments": given.log_arguments(),
    }
    # Later entries take precedence.
    all_parameters = [*given.file("params_file"), dict(parameters)]
    nodes = [Node(executable="tracker", name="pf_tracker", parameters=all_parameters, **options)]
    if given.flag("console"):
        port = {}
        if given.text("console_port"):
            declared = declarations(ConsoleParameters)["port"]
            port = {"port": given.parameter("console_port", declared)}
        nodes.append(Node(executable="console", name="console", parameters=[port], **options))
    return nodes


def localizer_node(given: LaunchArguments) -> Node:
    """The localizer beside the tracker.

    Raises:
        ValueError: An argument is not allowed.
    """
    parameters: dict[str, Any] = {"use_sim_time": given.flag("use_sim_time")}
    parameters["rectified"] = given.flag("rectified")
    declared = {
        name.replace(".", "_"): one for name, one in declarations(LocalizerParameters).items()
    }
    for name in LOCALIZER_PARAMETERS:
        if given.text(name):
            parameters[declared[name].name] = given.parameter(name, declared[name])
    folder, slash, _ = given.text("image").rpartition("/")
    remappings = {
        "camera_info": given.text("camera_info") or f"{folder}{slash}camera_info",
        "depth": given.text("depth"),
        "odom": given.text("odom"),
        "imu": given.text("imu"),
    }
    return Node(
        executable="localizer",
        name="localizer",
        parameters=[parameters],
        remappings=[*remappings.items()],
        arguments=given.log_arguments(),
        **given.common_node_options(),
    )
