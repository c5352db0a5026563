"""Which arguments of a command line are for ROS; imports nothing that takes time."""

from __future__ import annotations

from collections.abc import Sequence


def split_ros_arguments(command_line: Sequence[str]) -> tuple[list[str], list[str]]:
    """Sort a command line as rcl does.

    Args:
        command_line: With stretches for ROS, each from `--ros-args` to `--` or to the end.

    Returns:
        The program's own arguments and those for ROS, each in order and without the marks around
        the stretches; a `--` outside of them is the program's own.
    """
    own: list[str] = []
    for_ros: list[str] = []
    is_for_ros = False
    for argument in command_line:
        if argument == "--ros-args":
            is_for_ros = True
        elif is_for_ros and argument == "--":
            is_for_ros = False
        else:
            (for_ros if is_for_ros else own).append(argument)
    return own, for_ros
