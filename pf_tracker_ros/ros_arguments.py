"""Splits a command line into the program's and ROS' arguments; imports only light modules."""

from __future__ import annotations

from collections.abc import Sequence


def split_ros_arguments(command_line: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split a command line by rcl's rules.

    Args:
        command_line: Arguments. Those from `--ros-args` to `--` or to the end are for ROS.

    Returns:
        The program's own arguments and those for ROS, without the delimiters. A `--` outside of
        ROS arguments is the program's own.
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
