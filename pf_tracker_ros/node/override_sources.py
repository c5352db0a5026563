"""In which order parameters were given at start-up: rcl hands them over merged.

A preset replaces the values of the parameter files before it, and of those alone: what the command
line names by `-p` is meant beside it, and a file behind it comes over it. (A launch file's
dictionary of parameters reaches the node as a file, behind those that the launch file names.)
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from pf_tracker_ros.ros_arguments import split_ros_arguments

_FILE_OPTIONS = ("--params-file",)
_VALUE_OPTIONS = ("-p", "--param")
# rcl's wildcards for parts of a node's name: any one, and any number of them.
_WILDCARDS = {"*": "/[^/]+", "**": "(?:/[^/]+)*"}


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
            if not node or re.fullmatch(_expression(node), node_name):
                yield _Source({name}, is_file=False)


def _names_in_file(path: Path, node_name: str) -> Iterator[str]:
    # A pipe is empty once rcl has read it, and opening it again may never end.
    if not path.is_file():
        return
    # rcl has read the file before, so whatever cannot be read here does not concern parameters.
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError):
        return
    for pattern, parameters in _sections(document, ""):
        if re.fullmatch(_expression(pattern), node_name):
            yield from _flat_names(parameters, "")


def _sections(document: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Pattern of node names, and the parameters of those nodes."""
    for key, value in _items(document):
        if key == "ros__parameters":
            yield prefix, value
        else:
            yield from _sections(value, f"{prefix}/{key.strip('/')}")


def _flat_names(parameters: Any, prefix: str) -> Iterator[str]:
    for key, value in _items(parameters):
        if isinstance(value, dict):
            yield from _flat_names(value, f"{prefix}{key}.")
        else:
            yield prefix + key


def _items(mapping: Any) -> Iterable[tuple[str, Any]]:
    if isinstance(mapping, dict):
        return ((str(key), value) for key, value in mapping.items())
    return ()


def _expression(pattern: str) -> str:
    parts = pattern.strip("/").split("/")
    return "".join(_WILDCARDS.get(part, "/" + re.escape(part)) for part in parts)
