"""Declared parameters: the one place where a tunable exists.

A group of tunables is a frozen dataclass whose fields are made by `declared`, which takes the
default, the description, the unit and the range. Groups nest: the field `particles` of the group
`filter` has the full name `filter.particles`. From the declarations follow the checks at start-up
and at run time, the ROS descriptors, the preset files and the table in `docs/parameters.md`.
"""

from __future__ import annotations

import dataclasses
import math
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

Group = TypeVar("Group")

_METADATA_KEY = "declaration"
_TYPE_NAMES = {
    bool: "bool",
    int: "int",
    float: "float",
    str: "string",
    tuple[float, ...]: "list of floats",
}


class ParameterError(ValueError):
    """A parameter that does not exist, or a value that it does not allow."""


@dataclass(frozen=True)
class Declaration:
    """One tunable: its full name, type, default, range and what it is for.

    Attributes:
        name: Full name, groups separated by dots.
        type: `bool`, `int`, `float`, `str` or `tuple[float, ...]`.
        default: Value when nothing else is given.
        description: One sentence: what it does, and when to change it.
        unit: Unit of the value, empty where it has none.
        minimum: Smallest allowed number, inclusive; of each element for a list; -inf for others.
        maximum: Largest allowed number, inclusive; of each element for a list; inf for others.
        choices: Allowed strings; empty allows any.
        lengths: Allowed lengths of a list; empty allows any.
        read_only: Whether it is fixed once the tracker or node has started.
    """

    name: str
    type: Any
    default: Any
    description: str
    unit: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()
    lengths: tuple[int, ...] = ()
    read_only: bool = False

    @property
    def type_name(self) -> str:
        """The type as a user would write it, for example `list of floats`."""
        return _TYPE_NAMES[self.type]

    @property
    def allowed(self) -> str:
        """The allowed values in words, for error messages and tables."""
        if self.choices:
            return " or ".join(f"'{choice}'" for choice in self.choices)
        if self.type is bool:
            return "true or false"
        if self.type is str:
            return "any string"
        text = f"{self.minimum:.10g} to {self.maximum:.10g}"
        if self.lengths:
            lengths = " or ".join(str(length) for length in self.lengths)
            return f"{lengths} numbers, each {text}"
        return text

    def validate(self, value: Any) -> Any:
        """Return `value` in the declared type.

        Args:
            value: The value to check; an int passes for a float, a list for a tuple.

        Returns:
            The value converted to `type`.

        Raises:
            ParameterError: The value has another type or is not allowed; the message names the
                parameter, the value and what is allowed.
        """
        if self.type == tuple[float, ...]:
            if isinstance(value, str) or not isinstance(value, Sequence):
                raise self._refusal(value)
            converted: Any = tuple(self._number(element, float, value) for element in value)
            if self.lengths and len(converted) not in self.lengths:
                raise self._refusal(value)
            return converted
        if self.type in (int, float):
            return self._number(value, self.type, value)
        if not isinstance(value, self.type) or (self.choices and value not in self.choices):
            raise self._refusal(value)
        return value

    def _number(self, element: Any, number_type: type, value: Any) -> Any:
        integral = isinstance(element, int) and not isinstance(element, bool)
        # NumPy's scalars register as neither int nor bool but convert exactly through item().
        if hasattr(element, "item") and getattr(element, "ndim", 1) == 0:
            return self._number(element.item(), number_type, value)
        if not integral and not (number_type is float and isinstance(element, float)):
            raise self._refusal(value)
        if not math.isfinite(element) or not self.minimum <= element <= self.maximum:
            raise self._refusal(value)
        return number_type(element)

    def _refusal(self, value: Any) -> ParameterError:
        return ParameterError(
            f"parameter '{self.name}' is {value!r}; allowed: {self.type_name}, {self.allowed}"
        )


def declared(
    default: Any,
    description: str,
    *,
    unit: str = "",
    minimum: float = -math.inf,
    maximum: float = math.inf,
    choices: Sequence[str] = (),
    lengths: Sequence[int] = (),
    read_only: bool = False,
) -> Any:
    """Declare one tunable as a field of a frozen dataclass; arguments as in `Declaration`.

    Raises:
        TypeError: A number without both ends of its range; the range keeps out NaN and infinity.
    """
    numeric = isinstance(default, int | float | tuple) and not isinstance(default, bool)
    if numeric and not (math.isfinite(minimum) and math.isfinite(maximum)):
        raise TypeError(f"a number needs a range: {description}")
    return dataclasses.field(
        default=default,
        metadata={
            _METADATA_KEY: {
                "default": default,
                "description": description,
                "unit": unit,
                "minimum": minimum,
                "maximum": maximum,
                "choices": tuple(choices),
                "lengths": tuple(lengths),
                "read_only": read_only,
            }
        },
    )


def group(group_type: type[Group]) -> Group:
    """Declare a nested group of tunables as a field of a frozen dataclass."""
    return dataclasses.field(default_factory=group_type)


def declarations(group_type: type, prefix: str = "") -> dict[str, Declaration]:
    """All tunables of a group and of the groups inside it, in order of declaration.

    Args:
        group_type: A frozen dataclass whose fields were made by `declared` and `group`.
        prefix: Put in front of each name, with its dot.

    Returns:
        Full name to declaration.
    """
    types = typing.get_type_hints(group_type)
    found: dict[str, Declaration] = {}
    for field in dataclasses.fields(group_type):
        name = prefix + field.name
        if _METADATA_KEY in field.metadata:
            found[name] = Declaration(
                name=name, type=types[field.name], **field.metadata[_METADATA_KEY]
            )
        else:
            found.update(declarations(types[field.name], prefix=f"{name}."))
    return found


def build(group_type: type[Group], values: Mapping[str, Any]) -> Group:
    """Build a group from full names and values; what is not named keeps its default.

    Args:
        group_type: A frozen dataclass whose fields were made by `declared` and `group`.
        values: Full name to value.

    Returns:
        The group, every value checked.

    Raises:
        ParameterError: A name is not declared or a value is not allowed.
    """
    known = declarations(group_type)
    for name in values:
        if name not in known:
            raise ParameterError(f"no parameter '{name}'; there are: {', '.join(known)}")
    checked = {name: known[name].validate(value) for name, value in values.items()}
    return typing.cast(Group, _assemble(group_type, checked, prefix=""))


def _assemble(group_type: Any, checked: Mapping[str, Any], prefix: str) -> Any:
    types = typing.get_type_hints(group_type)
    arguments = {}
    for field in dataclasses.fields(group_type):
        name = prefix + field.name
        if _METADATA_KEY not in field.metadata:
            arguments[field.name] = _assemble(types[field.name], checked, prefix=f"{name}.")
        elif name in checked:
            arguments[field.name] = checked[name]
    return group_type(**arguments)


def flatten(values: Any, prefix: str = "") -> dict[str, Any]:
    """Full name to value for every tunable of a built group: the inverse of `build`."""
    flat: dict[str, Any] = {}
    for field in dataclasses.fields(values):
        value = getattr(values, field.name)
        name = prefix + field.name
        if _METADATA_KEY in field.metadata:
            flat[name] = value
        else:
            flat.update(flatten(value, prefix=f"{name}."))
    return flat
