"""Arguments are split by rcl's rules."""

import pytest
from rclpy.utilities import remove_ros_args

from pf_tracker_ros.command_lines import split_ros_arguments


@pytest.mark.parametrize(
    ("command_line", "own", "for_ros"),
    [
        ("", "", ""),
        ("a --b", "a --b", ""),
        ("a --ros-args", "a", ""),
        ("a --ros-args -p x:=1", "a", "-p x:=1"),
        ("a --ros-args -p x:=1 -- b", "a b", "-p x:=1"),
        ("--ros-args -p x:=1 -- b --ros-args -p y:=2", "b", "-p x:=1 -p y:=2"),
        ("--ros-args -p x:=1 --ros-args -p y:=2 -- b", "b", "-p x:=1 -p y:=2"),
        ("a -- b", "a -- b", ""),
        ("a --ros-args -- b -- c", "a b -- c", ""),
        ("a -- --ros-args -p x:=1", "a --", "-p x:=1"),
    ],
)
def test_arguments_are_split_as_in_rcl(command_line, own, for_ros):
    arguments = command_line.split()
    assert split_ros_arguments(arguments) == (own.split(), for_ros.split())
    # The first argument is the program's name to rclpy.
    assert remove_ros_args(["program", *arguments])[1:] == own.split()
