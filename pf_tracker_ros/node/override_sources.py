"""What gave the parameters at start-up, and in which order: rcl hands them over merged.

A preset replaces the values of the parameter files before it, and of those alone: what the command
line names by `-p` is meant beside it, and a file behind it comes over it. (A launch file's
dictionary of parameters reaches the node as a file, behind those that the launch file names.)
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

from pf_tracker_ros.parameter_files import matches_node, node_patterns, parameter_names_for
from pf_tracker_ros.ros_arguments import split_ros_arguments
from pf_tracker_ros.yaml_files import YamlError, read_yaml

_FILE_OPTIONS = ("--params-file",)
_VALUE_OPTIONS = ("-p", "--param")


def parameters_superseded_by(name: str, node_name: str, command_line: Sequence[str]) -> set[str]:
    """What parameter files give only before `name` is given for the last time.

    Args:
        name: Of the parameter.
        node_name: Fully qualified name of the node.
        command_line: With the arguments between `--ros-args` and `--`.

    Returns:
        Full names of parameters that the command line does not give by `-p`; none if `name` was not
        given. Of a file that is no regular one, which rcl alone could read, nothing is known.
    """
    # (names, whether a file gives them) of each argument, in order.
    sources: list[tuple[set[str], bool]] = []
    for option, value in _options(command_line):
        if option in _FILE_OPTIONS:
            # rcl has read the file before, so whatever cannot be read here does not concern
            # parameters; a pipe is empty by then.
            with contextlib.suppress(YamlError):
                document = read_yaml(Path(value), "parameter file")
                sources.append((set(parameter_names_for(document, node_name)), True))
        elif option in _VALUE_OPTIONS:
            # Of one node alone: node:name:=value.
            node, _, given = value.partition(":=")[0].rpartition(":")
            if not node or matches_node(node, node_name):
                sources.append(({given}, False))
    last = max((index for index, (names, _) in enumerate(sources) if name in names), default=0)
    before = {one for names, _ in sources[:last] for one in names}
    return before.difference(
        *(names for index, (names, is_file) in enumerate(sources) if index >= last or not is_file)
    )


def unmatched_file_warnings(node_name: str, command_line: Sequence[str]) -> Iterator[str]:
    """What is to be told of each parameter file that gives a node nothing, as rcl tells nothing.

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
                    f"the parameter file {path} gives {node_name} nothing: it is for "
                    f"{' and '.join(patterns)}; {node_name} or /** has to stand above its "
                    "ros__parameters"
                )


def _options(command_line: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Each argument for ROS with the one behind it."""
    return itertools.pairwise(split_ros_arguments(command_line)[1])
