"""What the launch files share; needs the ROS package launch."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration

PACKAGE = "pf_tracker_ros"

_FLAGS = {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}


class Given:
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

    def number(self, name: str, kind: type[Any]) -> Any:
        """An argument that is a number.

        Args:
            name: Of the argument.
            kind: `int` or `float`.

        Raises:
            ValueError: It is none.
        """
        text = self.text(name)
        try:
            return kind(text)
        except ValueError:
            raise ValueError(
                f"argument {name}:={text}; allowed: a number, {kind.__name__}"
            ) from None

    def file(self, name: str) -> list[str]:
        """An argument that is the path of a file; empty is no file.

        Raises:
            ValueError: There is no such file.
        """
        text = self.text(name)
        if text and not Path(text).expanduser().is_file():
            raise ValueError(f"argument {name}:={text}; there is no such file")
        return [str(Path(text).expanduser())] if text else []

    def choice(self, name: str, choices: Collection[str]) -> str:
        """An argument that is one of some words; empty is none of them.

        Raises:
            ValueError: It is something else.
        """
        text = self.text(name)
        if text and text not in choices:
            raise ValueError(f"argument {name}:={text}; allowed: {', '.join(choices)}")
        return text

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
        if len(numbers) not in (0, 4):
            raise ValueError(f"argument {name}:={text}; allowed: [x, y, width, height] in pixels")
        return numbers

    def words(self, name: str) -> list[str]:
        """An argument that is a list of words, with or without brackets; empty is no word."""
        words = (part.strip(" '\"") for part in self.text(name).strip("[] ").split(","))
        return [word for word in words if word]

    def log_arguments(self) -> list[str]:
        """The command line that sets the argument `log_level`, if it was given."""
        level = self.text("log_level")
        return ["--ros-args", "--log-level", level] if level else []

    def environment(self) -> dict[str, str]:
        """The environment that the argument `large_images` asks for."""
        if not self.flag("large_images"):
            return {}
        profile = Path(get_package_share_directory(PACKAGE)) / "config/fastdds_large_images.xml"
        return {"FASTRTPS_DEFAULT_PROFILES_FILE": str(profile)}


def argument(name: str, description: str, default: str = "") -> DeclareLaunchArgument:
    """An argument that may be left out."""
    return DeclareLaunchArgument(name, default_value=default, description=description)
