"""Shared by the command lines of all executables; imports only light modules."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NoReturn


class Parser(argparse.ArgumentParser):
    """Argument parser with one-line errors and unwrapped description and epilog.

    Args:
        prog: Name of the program.
        **further: As for `argparse.ArgumentParser`.
    """

    def __init__(self, prog: str, **further: Any) -> None:
        formatter = argparse.RawDescriptionHelpFormatter
        super().__init__(prog=prog, formatter_class=formatter, **further)

    def error(self, message: str) -> NoReturn:
        """Print the error and end the program with exit code 2."""
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def print_error(command: str, message: object) -> None:
    """Print an error of a command on standard error, in one line."""
    print(f"{command}: error: {' '.join(str(message).split())}", file=sys.stderr)


def missing_package(package: str, extra: str) -> str:
    """How to install a package of one of this package's extras; empty if it is installed."""
    try:
        import_module(package)
    except ImportError:
        name = "pyyaml" if package == "yaml" else package
        return f"{name} is not installed: pip install {name}, or '.[{extra}]' in the sources"
    return ""


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
