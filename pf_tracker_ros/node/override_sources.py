"""The order of parameters and parameter files on the command line, which rcl merges.

A preset replaces the values of parameter files before it. Values of `-p` and of later files stay.
A launch file's dictionary of parameters is a file, too, after those that the launch file names.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

from pf_tracker_ros.command_lines import split_ros_arguments
from pf_tracker_ros.parameter_files import matches_node, node_patterns, parameter_names_for
from pf_tracker_ros.yaml_files import YamlError, read_yaml

_FILE_OPTIONS = ("--params-file",)
_VALUE_OPTIONS = ("-p", "--param")


def parameters_superseded_by(name: str, node_name: str, command_line: Sequence[str]) -> set[str]:
    """Parameters that only files before the last occurrence of `name` set.

    Args:
        name: Name of the parameter.
        node_name: Fully qualified name of the node.
        command_line: With the arguments between `--ros-args` and `--`.

    Returns:
        Full names; none if `name` does not occur. Unreadable files, such as a pipe that rcl has
        read, are left out.
    """
    # (names, whether from a file) of each argument, in order.
    sources: list[tuple[set[str], bool]] = []
    for option, value in _options(command_line):
        if option in _FILE_OPTIONS:
            # rcl has read the file before, so an error here is none of its parameters.
            with contextlib.suppress(YamlError):
                document = read_yaml(Path(value), "parameter file")
                sources.append((set(parameter_names_for(document, node_name)), True))
        elif option in _VALUE_OPTIONS:
            # node:name:=value is for one node.
            node, _, given = value.partition(":=")[0].rpartition(":")
            if not node or matches_node(node, node_name):
                sources.append(({given}, False))
    last = max((index for index, (names, _) in enumerate(sources) if name in names), default=0)
    before = {one for names, _ in sources[:last] for one in names}
    return before.difference(
        *(names for index, (names, is_file) in enumerate(sources) if index >= last or not is_file)
    )


def unmatched_file_warnings(node_name: str, command_line: Sequence[str]) -> Iterator[str]:
    """Warnings of parameter files without parameters for the node, which rcl ignores silently.

    Args:
        node_name: Fully qualified name of the node.
        command_line: As for `parameters_superseded_by`.
    """
    for option, path in dict.fromkeys(_options(command_line)):
        if option not in _FILE_OPTIONS:
            continue
        with contextlib.suppress(YamlError):
            patterns = node_patterns(read_yaml(Path(path), "parameter file"))
            if patterns and not any(matches_node(pattern, node_name) for pattern in patterns):
                yield (
                    f"the parameter file {path} has nothing for {node_name}, only for "
                    f"{' and '.join(patterns)}; write {node_name} or /** above its ros__parameters"
                )


def _options(command_line: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Each ROS argument with the next one."""
    return itertools.pairwise(split_ros_arguments(command_line)[1])
