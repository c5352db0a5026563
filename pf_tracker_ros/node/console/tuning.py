"""Conversion of the tracker's parameters for the page, and back.

Names, values, types and ranges come from the node. Groups, activity and the values of presets come
from the declarations in this package.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterDescriptor, ParameterType, ParameterValue
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python

from pf_tracker_ros.node.console.json_conversions import Json
from pf_tracker_ros.node.console.requests import is_number
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameter_files import COMMON_PARAMETER_PREFIXES, section_lines
from pf_tracker_ros.parameters import ParameterError, declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters

_NODE = declarations(NodeParameters)
_TRACKER = declarations(TrackerParameters)
_DECLARED = _NODE | _TRACKER
_DEFAULTS = {name: one.default for name, one in _DECLARED.items()}
_ORDER = {name: place for place, name in enumerate(_DECLARED)}
_KINDS = {
    ParameterType.PARAMETER_BOOL: "bool",
    ParameterType.PARAMETER_INTEGER: "int",
    ParameterType.PARAMETER_DOUBLE: "float",
    ParameterType.PARAMETER_STRING: "text",
    ParameterType.PARAMETER_DOUBLE_ARRAY: "numbers",
    ParameterType.PARAMETER_STRING_ARRAY: "texts",
}
_LARGEST_INTEGER = 2**63
_INACTIVE = "Without effect at present"


def tunable_names(names: Sequence[str]) -> list[str]:
    """The names without those common to all nodes, in the order of docs/parameters.md."""
    known = [name for name in names if not name.startswith(COMMON_PARAMETER_PREFIXES)]
    return sorted(known, key=lambda name: (_ORDER.get(name, len(_ORDER)), name))


def parameters_to_json(
    descriptors: Sequence[ParameterDescriptor], values: Sequence[ParameterValue]
) -> list[Json]:
    """The parameters as the page shows them.

    Args:
        descriptors: Of the node.
        values: Of the node, in the same order.
    """
    plain = {
        descriptor.name: _plain(value)
        for descriptor, value in zip(descriptors, values, strict=True)
        if value.type != ParameterType.PARAMETER_NOT_SET
        or descriptor.type == ParameterType.PARAMETER_DOUBLE_ARRAY
    }
    defaults = _preset_values(plain)
    shown = [
        {
            "name": descriptor.name,
            "group": _group(descriptor.name, _DEFAULTS | defaults | plain),
            "kind": _KINDS.get(descriptor.type, "text"),
            "description": descriptor.description,
            "constraints": descriptor.additional_constraints,
            "range": _range(descriptor),
            "choices": list(one.choices) if (one := _DECLARED.get(descriptor.name)) else [],
            "read_only": descriptor.read_only,
            "value": plain[descriptor.name],
            "default": defaults.get(descriptor.name),
        }
        for descriptor in descriptors
        if descriptor.name in plain
    ]
    return sorted(shown, key=lambda one: one["group"] == _INACTIVE)


def parameter_from_json(known: Json, value: Any) -> Parameter:
    """A value from the page as a ROS parameter; the node validates it.

    Args:
        known: The parameter, as from `parameters_to_json`.
        value: From JSON.

    Raises:
        ValueError: A ROS parameter cannot hold the value.
    """
    problem = f"parameter '{known['name']}'"
    values, kind = value if isinstance(value, list) else [value], None
    if not all(_is_sendable(one) for one in values if isinstance(one, str)):
        raise ValueError(f"{problem}: a text has to be UTF-8 without null characters")
    try:
        if known["kind"] == "texts" and isinstance(value, list):
            kind, value = RosParameter.Type.STRING_ARRAY, [str(one) for one in value]
        elif isinstance(value, list) and all(is_number(one) for one in value):
            kind, value = RosParameter.Type.DOUBLE_ARRAY, [float(one) for one in value]
        elif known["kind"] == "float" and is_number(value):
            value = float(value)
        elif isinstance(value, int) and abs(value) >= _LARGEST_INTEGER:
            raise OverflowError
    except OverflowError:
        raise ValueError(f"{problem}: the number does not fit into 64 bits") from None
    if kind is None and not isinstance(value, bool | int | float | str):
        raise ValueError(f"{problem} cannot be set to {value!r}")
    return RosParameter(known["name"], kind, value).to_parameter_msg()


def _is_sendable(text: str) -> bool:
    """Whether a text is UTF-8 without null characters."""
    try:
        return "\0" not in text and bool(text.encode() or not text)
    except UnicodeEncodeError:
        return False


def parameter_file(node: str, known: Sequence[Json]) -> str:
    """A ROS parameter file with the preset and each value that differs from it.

    Args:
        node: Fully qualified name of the tracker's node.
        known: The parameters, as from `parameters_to_json`.
    """
    values = {}
    for one in known:
        differs = one["default"] is not None and one["value"] != one["default"]
        if one["name"] == "preset" or (differs and not one["read_only"]):
            values[one["name"]] = one["value"]
    return "\n".join(section_lines(node, values)) + "\n"


def _preset_values(current: Mapping[str, Any]) -> dict[str, Any]:
    """The values of the present preset, without any change."""
    values = dict(_DEFAULTS)
    with contextlib.suppress(ParameterError):
        values |= preset_parameters(str(current.get("preset")), int(current.get("max_targets", 1)))
    values["max_targets"] = _DEFAULTS["max_targets"]
    if "preset" in current:
        values["preset"] = current["preset"]
    return {
        name: list(value) if isinstance(value, tuple) else value for name, value in values.items()
    }


def _group(name: str, values: Mapping[str, Any]) -> str:
    if name in _NODE:
        return "The node"
    if name not in _TRACKER:
        return "Others"
    if not _TRACKER[name].is_active(values):
        return _INACTIVE
    if not _TRACKER[name].condition:
        return "The tracker"
    return name.partition(".")[0].replace("_", " ").capitalize()


def _range(descriptor: ParameterDescriptor) -> list[float] | None:
    for one in (*descriptor.floating_point_range, *descriptor.integer_range):
        return [one.from_value, one.to_value]
    return None


def _plain(value: ParameterValue) -> Any:
    plain = parameter_value_to_python(value)
    if plain is None:
        # An empty list of numbers is sent as no value.
        return []
    return plain if isinstance(plain, bool | int | float | str) else list(plain)
