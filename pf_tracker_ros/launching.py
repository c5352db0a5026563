"""What the launch files share; needs the ROS packages launch and launch_ros."""

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

from pf_tracker_ros.node.console.console_parameters import ConsoleParameters
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import Declaration, ParameterError, declarations

PACKAGE = "pf_tracker_ros"
# Arguments that are parameters of the tracker and have the names of these.
TRACKER_PARAMETERS = ("preset", "image_reliability", "image_transport", "seed")
_LOG_LEVELS = "debug, info, warn, error, fatal"

# Description and default of the arguments of every launch file that starts a tracker first of all.
_SHARED = {
    "image": ("Topic of the images.", "image"),
    "namespace": ("Namespace of the node, one for each of several cameras.", ""),
    "preset": ("Preset, such as default or li2007; taken whole, over the file.", ""),
    "params_file": ("ROS parameter file, such as a copy of one in config/.", ""),
    "image_reliability": ("auto, best_effort or reliable.", ""),
    "image_transport": ("raw, or compressed for JPEG and PNG on <image>/compressed.", ""),
    "seed": ("Seeds all randomness.", ""),
    "console": (
        "Serve the page that shows and drives the tracker on the loopback.",
        "false",
    ),
    "console_port": ("Port of that page, another one for each console; 8642 without it.", ""),
    "use_sim_time": ("Take the time from /clock.", "false"),
    "large_images": (
        "Use the Fast DDS profile for large images; the publisher of the images needs it too.",
        "false",
    ),
    "log_level": ("debug, info, warn, error or fatal.", ""),
}

_FLAGS = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}


class LaunchArguments:
    """The arguments of a launch file as they were given, or their defaults.

    Args:
        context: Of the launch that is under way.
    """

    def __init__(self, context: LaunchContext) -> None:
        self._context = context

    def text(self, name: str) -> str:
        """An argument as it is."""
        return str(LaunchConfiguration(name).perform(self._context))

    def flag(self, name: str) -> bool:
        """An argument that is true or false, in any case of its letters.

        Raises:
            ValueError: It is neither.
        """
        text = self.text(name)
        if text.lower() not in _FLAGS:
            raise ValueError(f"argument {name}:={text}; allowed: true or false")
        return _FLAGS[text.lower()]

    def parameter(self, name: str, declaration: Declaration) -> Any:
        """An argument that is a parameter of a node, one number or one word.

        Args:
            name: Of the argument.
            declaration: Of the parameter.

        Raises:
            ValueError: The parameter cannot have it.
        """
        text, kind = self.text(name), declaration.type
        try:
            value = declaration.validate(kind(text))
        except ParameterError as error:
            _, _, allowed = str(error).rpartition("allowed: ")
            allowed = ", ".join(declaration.choices) or allowed
            raise ValueError(f"argument {name}:={text}; allowed: {allowed}") from None
        except ValueError:
            raise ValueError(
                f"argument {name}:={text}; allowed: a number, {kind.__name__}"
            ) from None
        return ParameterValue(value, value_type=str) if kind is str else value

    def file(self, name: str) -> list[str]:
        """An argument that is the path of a file; empty is no file.

        Raises:
            ValueError: There is no such file.
        """
        text = self.text(name)
        if text and not Path(text).expanduser().is_file():
            raise ValueError(f"argument {name}:={text}; there is no such file")
        return [str(Path(text).expanduser())] if text else []

    def box(self, name: str) -> list[float]:
        """An argument that is four numbers, with or without brackets; empty is no box.

        Raises:
            ValueError: It is something else.
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
        """An argument that is a list of words, with or without brackets; empty is no word."""
        words = (part.strip(" '\"") for part in self.text(name).strip("[] ").split(","))
        return [word for word in words if word]

    def log_arguments(self) -> list[str]:
        """The command line that sets the argument `log_level`, if it was given.

        Raises:
            ValueError: It is no level, nor LOGGER:=LEVEL.
        """
        level = self.text("log_level")
        if level and level.rpartition(":=")[2].lower() not in _LOG_LEVELS.split(", "):
            raise ValueError(f"argument log_level:={level}; allowed: {_LOG_LEVELS}")
        return ["--ros-args", "--log-level", level] if level else []

    def environment(self) -> dict[str, str]:
        """The environment that the argument `large_images` asks for."""
        if not self.flag("large_images"):
            return {}
        profile = Path(get_package_share_directory(PACKAGE)) / "config/fastdds_large_images.xml"
        return {"FASTRTPS_DEFAULT_PROFILES_FILE": str(profile)}

    def common_node_options(self) -> dict[str, Any]:
        """What every node is started with, as keywords of `launch_ros.actions.Node`."""
        return {
            "package": PACKAGE,
            "namespace": self.text("namespace") or None,
            "additional_env": self.environment(),
            "output": "screen",
            "emulate_tty": True,
        }


def argument(name: str, description: str, default: str = "") -> DeclareLaunchArgument:
    """An argument that may be left out."""
    return DeclareLaunchArgument(name, default_value=default, description=description)


def shared_arguments(*names: str) -> list[DeclareLaunchArgument]:
    """Arguments that say the same in several launch files."""
    return [argument(name, *_SHARED[name]) for name in names]


def tracker_parameters(given: LaunchArguments) -> dict[str, Any]:
    """Parameters that every launch file with a tracker sets; what is not given is left out.

    Args:
        given: The arguments.

    Raises:
        ValueError: One of them is not allowed.
    """
    parameters: dict[str, Any] = {"use_sim_time": given.flag("use_sim_time")}
    declared = declarations(NodeParameters)
    for name in TRACKER_PARAMETERS:
        if given.text(name):
            parameters[name] = given.parameter(name, declared[name])
    return parameters


def tracker_nodes(
    given: LaunchArguments, parameters: Mapping[str, Any], remappings: Mapping[str, str]
) -> list[Node]:
    """The tracker, and a console where it is asked for.

    Args:
        given: The arguments.
        parameters: Of the tracker, over those of the file.
        remappings: Name in the nodes to topic.

    Raises:
        ValueError: One of the arguments is not allowed.
    """
    of_both = given.common_node_options() | {
        "remappings": [*remappings.items()],
        "arguments": given.log_arguments(),
    }
    # What comes later wins, so an argument wins over the file.
    all_parameters = [*given.file("params_file"), dict(parameters)]
    nodes = [Node(executable="tracker", name="pf_tracker", parameters=all_parameters, **of_both)]
    if given.flag("console"):
        port = {}
        if given.text("console_port"):
            declared = declarations(ConsoleParameters)["port"]
            port = {"port": given.parameter("console_port", declared)}
        nodes.append(Node(executable="console", name="console", parameters=[port], **of_both))
    return nodes
