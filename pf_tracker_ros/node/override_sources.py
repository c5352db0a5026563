"""In which order parameters were given at start-up: rcl hands them over merged.

Each `--params-file` is one source, and all `-p name:=value` together are the last one, as a user
means them: what is given beside a file comes over the file. (So does a launch file's dictionary of
parameters, which reaches the node as a file of its own behind those that it names.)
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

_FILE_OPTIONS = ("--params-file",)
_VALUE_OPTIONS = ("-p", "--param")
# rcl's wildcards for parts of a node's name: any one, and any number of them.
_WILDCARDS = {"*": "/[^/]+", "**": "(?:/[^/]+)*"}


def given_before(name: str, node_name: str, command_line: Sequence[str]) -> set[str]:
    """What was given at start-up before `name` was given for the last time, and not since.

    Args:
        name: Of the parameter.
        node_name: Fully qualified name of the node.
        command_line: With the arguments between `--ros-args` and `--`.

    Returns:
        Full names of parameters; none if `name` was not given, or by something else than the
        command line and its files.
    """
    sources = list(_sources(node_name, command_line))
    last = max((index for index, source in enumerate(sources) if name in source), default=0)
    return set().union(*sources[:last]) - set().union(*sources[last:])


def _sources(node_name: str, command_line: Sequence[str]) -> Iterator[set[str]]:
    """Full names of the parameters that each source gives to a node."""
    arguments = list(_ros_arguments(command_line))
    named: set[str] = set()
    for option, value in itertools.pairwise(arguments):
        if option in _FILE_OPTIONS:
            yield set(_names_in_file(Path(value), node_name))
        elif option in _VALUE_OPTIONS:
            # Of one node alone: node:name:=value.
            node, _, name = value.partition(":=")[0].rpartition(":")
            if not node or f"/{node_name}".endswith(f"/{node.strip('/')}"):
                named.add(name)
    yield named


def _ros_arguments(command_line: Sequence[str]) -> Iterator[str]:
    is_for_ros = False
    for argument in command_line:
        if argument in ("--ros-args", "--"):
            is_for_ros = argument == "--ros-args"
        elif is_for_ros:
            yield argument


def _names_in_file(path: Path, node_name: str) -> Iterator[str]:
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
