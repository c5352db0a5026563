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
from typing import NamedTuple

from pf_tracker_ros.parameter_files import applies, names_for, patterns_of
from pf_tracker_ros.ros_arguments import split_ros_arguments
from pf_tracker_ros.yaml_files import YamlError, read_yaml

_FILE_OPTIONS = ("--params-file",)
_VALUE_OPTIONS = ("-p", "--param")


def files_superseded_by(name: str, node_name: str, command_line: Sequence[str]) -> set[str]:
    """What parameter files give only before `name` is given for the last time.

    Args:
        name: Of the parameter.
        node_name: Fully qualified name of the node.
        command_line: With the arguments between `--ros-args` and `--`.

    Returns:
        Full names of parameters that the command line does not give by `-p`; none if `name` was not
        given. Of a file that is no regular one, which rcl alone could read, nothing is known.
    """
    sources = list(_sources(node_name, command_line))
    last = max((index for index, source in enumerate(sources) if name in source.names), default=0)
    kept = {one for source in sources[last:] for one in source.names}
    kept |= {one for source in sources if not source.is_file for one in source.names}
    return {one for source in sources[:last] for one in source.names} - kept


def files_for_others(node_name: str, command_line: Sequence[str]) -> Iterator[str]:
    """What is to be told of each parameter file that gives a node nothing, as rcl tells nothing.

    Args:
        node_name: Fully qualified name of the node.
        command_line: As for `files_superseded_by`.
    """
    for path in dict.fromkeys(_files(command_line)):
        with contextlib.suppress(YamlError):
            patterns = patterns_of(read_yaml(path, "parameter file"))
            if patterns and not any(applies(pattern, node_name) for pattern in patterns):
                yield (
                    f"the parameter file {path} gives {node_name} nothing: it is for "
                    f"{' and '.join(patterns)}; {node_name} or /** has to stand above its "
                    "ros__parameters"
                )


def _files(command_line: Sequence[str]) -> Iterator[Path]:
    _, arguments = split_ros_arguments(command_line)
    for option, value in itertools.pairwise(arguments):
        if option in _FILE_OPTIONS:
            yield Path(value)


class _Source(NamedTuple):
    names: set[str]
    is_file: bool


def _sources(node_name: str, command_line: Sequence[str]) -> Iterator[_Source]:
    """The names of a node's parameters that each argument of the command line gives, in order."""
    _, arguments = split_ros_arguments(command_line)
    for option, value in itertools.pairwise(arguments):
        if option in _FILE_OPTIONS:
            yield _Source(set(_names_in_file(Path(value), node_name)), is_file=True)
        elif option in _VALUE_OPTIONS:
            # Of one node alone: node:name:=value.
            node, _, name = value.partition(":=")[0].rpartition(":")
            if not node or applies(node, node_name):
                yield _Source({name}, is_file=False)


def _names_in_file(path: Path, node_name: str) -> Iterator[str]:
    # rcl has read the file before, so whatever cannot be read here does not concern parameters; a
    # pipe is empty by then.
    with contextlib.suppress(YamlError):
        yield from names_for(read_yaml(path, "parameter file"), node_name)
