"""ROS parameter files, as far as they can be understood without ROS."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import ParameterError, declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.yaml_files import YamlError, read_yaml

COMMON_PARAMETER_PREFIXES = ("use_sim_time", "start_type_description_service", "qos_overrides.")
"""How the names of parameters begin that every node, or each of its endpoints, has."""

_NODE_NAME = "pf_tracker"
_TRACKER = declarations(TrackerParameters)
_NODE = {name: one for name, one in declarations(NodeParameters).items() if name not in _TRACKER}
# rcl's wildcards for parts of a node's name: any one, and any number of them.
_WILDCARDS = {"*": "/[^/]+", "**": "(?:/[^/]+)*"}


@dataclass(frozen=True)
class TrackerSettings:
    """What a parameter file says of the tracker itself, and not of the node around it.

    Attributes:
        preset: Name of the preset, None where the file gives none.
        seed: None where it gives none.
        parameters: Full name to value of what is given beside the preset. Whether such a parameter
            exists, and takes that value, is for the tracker to judge.
        other_node: The name above them, where no node of the tracker's usual name would take them.
    """

    preset: str | None = None
    seed: int | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    other_node: str = ""


def read_parameter_file(path: Path | str) -> TrackerSettings:
    """Read what a ROS parameter file says of the tracker, such as one that the console gives.

    Its sections for a node `pf_tracker` in any namespace are taken, a later one over an earlier
    one; where there is only one section, whatever node it is for.

    Args:
        path: The file.

    Raises:
        ParameterError: It cannot be read, or has no parameters of a tracker.
    """
    path = Path(path)
    try:
        document = read_yaml(path, "parameter file")
    except YamlError as error:
        raise ParameterError(str(error)) from error
    values: dict[str, Any] = {}
    sections = _sections_of_a_tracker(path, document)
    for _, section in sections:
        values |= _flat(section, "")
    others = [name for name, _ in sections if not _is_usual(name)]
    given = {name: _judged(path, name, values[name]) for name in _NODE if name in values}
    return TrackerSettings(
        given.get("preset"),
        given.get("seed"),
        {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in values.items()
            if name not in _NODE and not name.startswith(COMMON_PARAMETER_PREFIXES)
        },
        "".join(others),
    )


def parameter_names_for(document: Any, node_name: str) -> Iterator[str]:
    """The full names of the parameters that a file gives a node, some of them several times.

    Args:
        document: Content of the file.
        node_name: Fully qualified name of the node.
    """
    for pattern, parameters in _sections(document, ""):
        if matches_node(pattern, node_name):
            yield from _flat(parameters, "")


def node_patterns(document: Any) -> list[str]:
    """The patterns of node names that a file has parameters for, in its order."""
    return list(dict.fromkeys(pattern for pattern, _ in _sections(document, "")))


def matches_node(pattern: str, node_name: str) -> bool:
    """Whether a node's fully qualified name is one that rcl's pattern of names is for."""
    parts = pattern.strip("/").split("/")
    expression = "".join(_WILDCARDS.get(part, "/" + re.escape(part)) for part in parts)
    return re.fullmatch(expression, node_name) is not None


def _is_usual(name: str) -> bool:
    """Whether a pattern of names is for trackers of the usual name, in any namespace."""
    return name.rpartition("/")[2] in (*_WILDCARDS, _NODE_NAME)


def _sections_of_a_tracker(path: Path, document: Any) -> list[tuple[str, Any]]:
    """Patterns of names and their parameters; only one where it is not a tracker's usual name."""
    sections = list(_sections(document, ""))
    if not sections:
        raise ParameterError(
            f"{path} is no ROS parameter file: it has no ros__parameters below the name of a node"
        )
    if len(sections) == 1:
        return sections
    found = [(name, section) for name, section in sections if _is_usual(name)]
    if not found:
        nodes = ", ".join(name for name, _ in sections)
        raise ParameterError(f"{path} has parameters of {nodes}; allowed: of {_NODE_NAME}")
    return found


def _judged(path: Path, name: str, value: Any) -> Any:
    if isinstance(value, list):
        value = tuple(value)
    try:
        return _NODE[name].validate(value)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None


def _sections(document: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Pattern of node names, and the parameters of those nodes."""
    for key, value in _items(document):
        if key == "ros__parameters":
            yield prefix, value
        else:
            yield from _sections(value, f"{prefix}/{key.strip('/')}")


def _flat(parameters: Any, prefix: str) -> dict[str, Any]:
    """Full name to value."""
    flat: dict[str, Any] = {}
    for key, value in _items(parameters):
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = value
    return flat


def _items(mapping: Any) -> Iterable[tuple[str, Any]]:
    if isinstance(mapping, dict):
        return ((str(key), value) for key, value in mapping.items())
    return ()
