"""ROS parameter files, read without ROS."""

from __future__ import annotations

import json
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
"""Name prefixes of the parameters that ROS declares in every node or for each endpoint."""

_NODE_NAME = "pf_tracker"
_TRACKER = declarations(TrackerParameters)
_NODE = {name: one for name, one in declarations(NodeParameters).items() if name not in _TRACKER}
# rcl's wildcards for one token of a node's name and for any number of tokens.
_WILDCARDS = {"*": "/[^/]+", "**": "(?:/[^/]+)*"}


@dataclass(frozen=True)
class TrackerSettings:
    """The tracker's own settings in a parameter file, without those of the node.

    Attributes:
        preset: Name of the preset, None if absent.
        seed: Seed, None if absent.
        parameters: Full name to value of the other tracker parameters, unchecked.
        other_node: Node name in the file if it does not match the tracker's default name, else
            empty.
    """

    preset: str | None = None
    seed: int | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    other_node: str = ""


def read_parameter_file(path: Path | str) -> TrackerSettings:
    """Read the tracker settings of a ROS parameter file, such as one saved by the console.

    The sections for a node `pf_tracker` in any namespace are merged, later ones last. A single
    section is read whatever its node.

    Raises:
        ParameterError: The file cannot be read, or has no tracker parameters.
    """
    path = Path(path)
    try:
        document = read_yaml(path, "parameter file")
    except YamlError as error:
        raise ParameterError(str(error)) from error
    values: dict[str, Any] = {}
    sections = _tracker_sections(path, document)
    for _, section in sections:
        values |= _flat(section, "")
    others = [name for name, _ in sections if not _is_tracker(name)]
    given = {name: _validated(path, name, values[name]) for name in _NODE if name in values}
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


def read_node_section(path: Path | str, node: str) -> tuple[dict[str, Any], list[str]]:
    """The parameters that a ROS parameter file sets in a node, in any namespace, unchecked.

    Args:
        path: The file.
        node: Name of the node, without namespace.

    Returns:
        Full name to value, empty if the file has no section for the node; and the patterns of all
        nodes in the file.

    Raises:
        ParameterError: The file cannot be read.
    """
    try:
        document = read_yaml(Path(path), "parameter file")
    except YamlError as error:
        raise ParameterError(str(error)) from error
    values: dict[str, Any] = {}
    for pattern, section in _sections(document, ""):
        if pattern.rpartition("/")[2] == node:
            values |= _flat(section, "")
    own = {
        name: value
        for name, value in values.items()
        if not name.startswith(COMMON_PARAMETER_PREFIXES)
    }
    return own, node_patterns(document)


def yaml_text(value: Any) -> str:
    """A value as YAML that ROS reads back with the same type."""
    if isinstance(value, tuple | list):
        return "[" + ", ".join(yaml_text(element) for element in value) + "]"
    if isinstance(value, float):
        text = repr(value)
        # Without a decimal point, YAML readers disagree on whether 1e-05 is a number.
        return text.replace("e", ".0e") if "e" in text and "." not in text else text
    return json.dumps(value)


def section_lines(node: str, values: Mapping[str, Any]) -> list[str]:
    """The lines of a ROS parameter file with the parameters of a node.

    Args:
        node: Pattern of its name, such as `/**`.
        values: Full name to value.
    """
    given = (f"    {name}: {yaml_text(value)}" for name, value in values.items())
    return [f"{node}:", "  ros__parameters:", *given]


def parameter_names_for(document: Any, node_name: str) -> Iterator[str]:
    """Full names of the parameters that a file sets in a node, with repetitions.

    Args:
        document: Content of the file.
        node_name: Fully qualified name of the node.
    """
    for pattern, parameters in _sections(document, ""):
        if matches_node(pattern, node_name):
            yield from _flat(parameters, "")


def node_patterns(document: Any) -> list[str]:
    """The file's patterns of node names, in order."""
    return list(dict.fromkeys(pattern for pattern, _ in _sections(document, "")))


def matches_node(pattern: str, node_name: str) -> bool:
    """Whether a fully qualified node name matches a pattern by rcl's rules."""
    parts = pattern.strip("/").split("/")
    expression = "".join(_WILDCARDS.get(part, "/" + re.escape(part)) for part in parts)
    return re.fullmatch(expression, node_name) is not None


def _is_tracker(pattern: str) -> bool:
    """Whether a pattern of node names matches the tracker's default name in a namespace."""
    return pattern.rpartition("/")[2] in (*_WILDCARDS, _NODE_NAME)


def _tracker_sections(path: Path, document: Any) -> list[tuple[str, Any]]:
    """Node patterns and parameters of the tracker's sections, or of the only section."""
    sections = list(_sections(document, ""))
    if not sections:
        raise ParameterError(
            f"{path} is no ROS parameter file: it has no ros__parameters below a node name"
        )
    if len(sections) == 1:
        return sections
    found = [(name, section) for name, section in sections if _is_tracker(name)]
    if not found:
        nodes = ", ".join(name for name, _ in sections)
        raise ParameterError(f"{path} has parameters of {nodes}; allowed: of {_NODE_NAME}")
    return found


def _validated(path: Path, name: str, value: Any) -> Any:
    if isinstance(value, list):
        value = tuple(value)
    try:
        return _NODE[name].validate(value)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None


def _sections(document: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield node patterns with their parameters."""
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
