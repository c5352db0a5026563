"""Declared parameters: every tunable exists in one place.

1. `declared` makes a tunable: a dataclass field with default, description, unit and range.
2. `group` nests groups, which are frozen dataclasses: the field `particles` of the group `filter`
   has the full name `filter.particles`.
3. A tunable may select a part of a registry by name, such as the motion model. `parts` declares the
   tunables of all its parts. They always exist; each description names the selection it needs.
4. `declarations` lists them. The checks at start-up and at run time, the ROS descriptors, the
   preset files and the table in `docs/parameters.md` are derived from this list.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import typing
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, TypeVar

from pf_tracker_ros.registry import Registry

Group = TypeVar("Group")

_METADATA_KEY = "declaration"
_CONDITION_KEY = "condition"
_PARTS_KEY = "parts"
_TYPE_NAMES = {
    bool: "bool",
    int: "int",
    float: "float",
    str: "string",
    tuple[float, ...]: "list of floats",
    tuple[str, ...]: "list of strings",
}
# Characters of a value quoted in a message.
_LONGEST_QUOTE = 200
_ELEMENTS = {tuple[float, ...]: float, tuple[str, ...]: str}


class ParameterError(ValueError):
    """An unknown parameter, or a value that is not allowed."""


class Condition(NamedTuple):
    """Condition under which a tunable is active.

    Attributes:
        selector: Full name of another tunable.
        choices: Values of the selector, or elements of a list, for which the condition holds.
    """

    selector: str
    choices: tuple[str, ...]


@dataclass(frozen=True)
class Declaration:
    """One tunable: its full name, type, default, range and purpose.

    Attributes:
        name: Full name, groups separated by dots.
        type: `bool`, `int`, `float`, `str`, `tuple[float, ...]` or `tuple[str, ...]`.
        default: Default value.
        description: Purpose, when to change it, and its condition.
        unit: Unit of the value, empty for none.
        minimum: Smallest allowed number, inclusive; of each element for a list; -inf for others.
        maximum: Largest allowed number, inclusive; of each element for a list; inf for others.
        choices: Allowed strings; empty allows any. A list of strings holds each at most once.
        allows_empty: Whether a string may be empty.
        lengths: Allowed lengths of a list; empty allows any.
        read_only: Whether it is fixed once the tracker or node has started.
        condition: Condition under which it is active; None for always.
    """

    name: str
    type: Any
    default: Any
    description: str
    unit: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()
    allows_empty: bool = True
    lengths: tuple[int, ...] = ()
    read_only: bool = False
    condition: Condition | None = None

    @property
    def type_name(self) -> str:
        """The type in words, for example `list of floats`."""
        return _TYPE_NAMES[self.type]

    @property
    def allowed(self) -> str:
        """The allowed values in words, for error messages and tables."""
        if self.choices:
            listed = _listed(self.choices)
            return f"each at most once, {listed}" if self.type == tuple[str, ...] else listed
        if self.type is bool:
            return "true or false"
        if self.type in (str, tuple[str, ...]):
            text = "any string" if self.type is str else "any strings"
            return text if self.allows_empty else f"{text} that is not empty"
        text = f"{self.minimum:.10g} to {self.maximum:.10g}"
        if self.lengths:
            lengths = " or ".join(str(length) for length in self.lengths)
            return f"{lengths} numbers, each {text}"
        return text

    def is_active(self, values: Mapping[str, Any]) -> bool:
        """Whether its condition holds, given full name to value of every tunable."""
        if self.condition is None:
            return True
        value = values[self.condition.selector]
        selected = value if isinstance(value, (list, tuple)) else (value,)
        return not set(self.condition.choices).isdisjoint(selected)

    def validate(self, value: Any) -> Any:
        """Return `value` in the declared type.

        Args:
            value: The value to check; an int passes for a float, a list for a tuple.

        Returns:
            The value converted to `type`.

        Raises:
            ParameterError: The value has the wrong type or is not allowed; the message names the
                parameter, the value and the allowed values.
        """
        if self.type in _ELEMENTS:
            if not isinstance(value, (list, tuple)):
                raise self._refusal(value)
            converted = tuple(self._element(one, _ELEMENTS[self.type], value) for one in value)
            is_repeated = self.choices and len(set(converted)) < len(converted)
            if is_repeated or (self.lengths and len(converted) not in self.lengths):
                raise self._refusal(value)
            return converted
        return self._element(value, self.type, value)

    def _element(self, element: Any, element_type: type, value: Any) -> Any:
        """An element of a list, or a scalar value, converted to its type."""
        if element_type in (int, float):
            return self._number(element, element_type, value)
        if not isinstance(element, element_type):
            raise self._refusal(value)
        if self.choices and element not in self.choices:
            raise self._refusal(value)
        if not self.allows_empty and not element:
            raise self._refusal(value)
        return element_type(element)

    def _number(self, element: Any, number_type: type, value: Any) -> Any:
        kind = getattr(getattr(element, "dtype", None), "kind", "")
        if kind and getattr(element, "ndim", 1) == 0:
            # NumPy's scalars are neither int nor bool; its times and texts are no numbers.
            convert = {"i": int, "u": int, "f": float}.get(kind)
            if convert is None:
                raise self._refusal(value)
            element = convert(element)
        integral = isinstance(element, int) and not isinstance(element, bool)
        if not integral and not (number_type is float and isinstance(element, float)):
            raise self._refusal(value)
        # NaN is in no range.
        if not self.minimum <= element <= self.maximum:
            raise self._refusal(value)
        return number_type(element)

    def _refusal(self, value: Any) -> ParameterError:
        return ParameterError(
            f"parameter '{self.name}' is {quoted(value)}; allowed: {self.type_name}, {self.allowed}"
        )


def quoted(value: Any) -> str:
    """A value quoted for a message, shortened to 200 characters."""
    text = repr(value)
    return text if len(text) <= _LONGEST_QUOTE else f"{text[:_LONGEST_QUOTE]}..."


def declared(
    default: Any,
    description: str,
    *,
    unit: str = "",
    minimum: float = -math.inf,
    maximum: float = math.inf,
    choices: Collection[str] = (),
    allows_empty: bool = True,
    lengths: Sequence[int] = (),
    read_only: bool = False,
    only_with: Sequence[str] = (),
) -> Any:
    """Declare one tunable as a field of a frozen dataclass; arguments as in `Declaration`.

    `choices` may be a collection that still grows, such as a `Registry`. `only_with` is the
    condition: name of the selector relative to the enclosing group, and choices.

    Raises:
        TypeError: A number without a finite range, which excludes NaN and infinity.
    """
    # An empty list may hold strings; `declarations` checks the type.
    numeric = (
        isinstance(default, int | float | tuple) and not isinstance(default, bool) and default != ()
    )
    if numeric and choices == () and not (math.isfinite(minimum) and math.isfinite(maximum)):
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
                "choices": choices,
                "allows_empty": allows_empty,
                "lengths": tuple(lengths),
                "read_only": read_only,
            },
            _CONDITION_KEY: only_with,
        },
    )


def group(
    group_type: type[Group], *, only_with: Sequence[str] | Callable[[], Sequence[str]] = ()
) -> Group:
    """Declare a nested group of tunables as a field of a frozen dataclass.

    Args:
        group_type: Class of the group.
        only_with: As for `declared`, for all its tunables; or a function returning that.
    """
    return dataclasses.field(default_factory=group_type, metadata={_CONDITION_KEY: only_with})


def parts(by: str, registry: Registry[Any]) -> Any:
    """Declare the tunables of every part of a registry, as a field.

    The field's value is a dictionary, part name to group.

    Args:
        by: Name of the selector, declared before this field in the same group.
        registry: Registry of the parts.
    """
    return dataclasses.field(
        default_factory=lambda: {name: registry.parameters_of(name)() for name in registry},
        metadata={_PARTS_KEY: (by, registry)},
    )


def declarations(group_type: type) -> dict[str, Declaration]:
    """All tunables of a group, in order of declaration.

    A selector with a single choice is omitted.

    Args:
        group_type: A frozen dataclass whose fields were made by `declared`, `group` and `parts`.

    Returns:
        Full name to declaration.

    Raises:
        TypeError: A field was not made by these functions, or parts declare one name differently.
    """
    found: dict[str, Declaration] = {}
    for one in _walk(group_type, "", None):
        found[one.name] = _shared(found[one.name], one) if one.name in found else one
    return {name: _with_condition_described(one, found) for name, one in found.items()}


def check_declaration(declaration: Declaration) -> None:
    """Check a declaration of another package.

    Raises:
        ParameterError: The default is not allowed.
        TypeError: The type is none of those of `Declaration`, a text is no text, or a range is
            beyond 64 bits.
    """
    if declaration.type not in _TYPE_NAMES:
        raise TypeError(
            f"the type of '{declaration.name}' is {quoted(declaration.type)}; allowed: "
            f"{', '.join(_TYPE_NAMES.values())}"
        )
    for text in (declaration.description, declaration.unit):
        if not isinstance(text, str):
            raise TypeError(f"'{declaration.name}' is described by {quoted(text)}; allowed: a text")
        text.encode()
    limits = (declaration.minimum, declaration.maximum)
    if declaration.type is int and max(map(abs, limits)) >= 1 << 63:
        raise TypeError(f"the range of '{declaration.name}' is not within 64 bits")
    declaration.validate(declaration.default)


def build(group_type: type[Group], values: Mapping[str, Any]) -> Group:
    """Build a group from full names and values; other tunables keep their defaults.

    Args:
        group_type: As for `declarations`.
        values: Full name to value.

    Returns:
        The group, every value checked.

    Raises:
        ParameterError: A name is not declared, or a value is not allowed.
    """
    known = declarations(group_type)
    for name in values:
        if name not in known:
            raise ParameterError(why_unknown(group_type, name))
    checked = {name: one.validate(values.get(name, one.default)) for name, one in known.items()}
    return typing.cast(Group, _assemble(group_type, checked, prefix=""))


def why_unknown(group_type: type, name: str) -> str:
    """Error message for an unknown name, with the closest or all known names."""
    known = declarations(group_type)
    close = difflib.get_close_matches(str(name), known, n=1)
    guess = f"did you mean '{close[0]}'?" if close else f"there are: {', '.join(known)}"
    return f"no parameter '{name}'; {guess}"


def flatten(values: Any, prefix: str = "") -> dict[str, Any]:
    """Full name to value for every tunable of a built group: the inverse of `build`."""
    flat: dict[str, Any] = {}
    for field in dataclasses.fields(values):
        value = getattr(values, field.name)
        name = prefix + field.name
        if _METADATA_KEY in field.metadata:
            if len(_choices(field)) != 1:
                flat[name] = value
        elif _PARTS_KEY in field.metadata:
            for part, (own_prefix, _) in _parts(field, prefix).items():
                flat.update(flatten(value[part], own_prefix))
        else:
            flat.update(flatten(value, prefix=f"{name}."))
    return flat


@cache
def _types(group_type: type) -> Mapping[str, Any]:
    return typing.get_type_hints(group_type)


def _walk(group_type: type, prefix: str, condition: Condition | None) -> Iterator[Declaration]:
    """Yield every tunable of a group; a tunable shared by parts appears once for each part."""
    types = _types(group_type)
    for field in dataclasses.fields(group_type):
        name = prefix + field.name
        only_with = field.metadata.get(_CONDITION_KEY, ())
        selector, *choices = (only_with() if callable(only_with) else only_with) or ("",)
        own = Condition(prefix + selector, tuple(choices)) if selector else condition
        if _METADATA_KEY in field.metadata:
            if len(_choices(field)) != 1:
                yield _declaration(name, types[field.name], field, own)
        elif _PARTS_KEY in field.metadata:
            by = prefix + field.metadata[_PARTS_KEY][0]
            for part, (own_prefix, of_part) in _parts(field, prefix).items():
                yield from _walk(of_part, own_prefix, Condition(by, (part,)))
        elif dataclasses.is_dataclass(types[field.name]):
            yield from _walk(types[field.name], f"{name}.", own)
        else:
            raise TypeError(
                f"{group_type.__name__}.{field.name} is no tunable; make it by `declared`, with "
                "description and range"
            )


def _declaration(
    name: str, value_type: Any, field: dataclasses.Field[Any], condition: Condition | None
) -> Declaration:
    declaration = Declaration(name=name, type=value_type, **field.metadata[_METADATA_KEY])
    is_bounded = math.isfinite(declaration.minimum) and math.isfinite(declaration.maximum)
    if _ELEMENTS.get(value_type, value_type) in (int, float) and not is_bounded:
        raise TypeError(f"a number needs a range: {declaration.description}")
    return dataclasses.replace(declaration, choices=_choices(field), condition=condition)


def _shared(known: Declaration, other: Declaration) -> Declaration:
    """Add a part to a tunable that several parts declare."""
    mine, theirs = known.condition, other.condition
    if not mine or not theirs or dataclasses.replace(other, condition=mine) != known:
        among = ", ".join(choice for one in (mine, theirs) if one for choice in one.choices)
        raise TypeError(
            f"'{known.name}' is declared differently for {among}; declare it alike, or rename one"
        )
    choices = mine.choices + theirs.choices
    return dataclasses.replace(known, condition=mine._replace(choices=choices))


def _with_condition_described(
    declaration: Declaration, known: Mapping[str, Declaration]
) -> Declaration:
    """Add the condition to the description; drop a condition that always holds."""
    if declaration.condition is None:
        return declaration
    name, choices = declaration.condition
    if name not in known or set(choices) == set(known[name].choices):
        return dataclasses.replace(declaration, condition=None)
    verb = "is" if known[name].type is str else "contains"
    description = f"{declaration.description} Used only if '{name}' {verb} {_listed(choices)}."
    return dataclasses.replace(declaration, description=description)


def _parts(field: dataclasses.Field[Any], prefix: str) -> dict[str, tuple[str, type]]:
    """Name of each part to the prefix of its tunables, and their group."""
    _, registry = field.metadata[_PARTS_KEY]
    return {
        name: (prefix + registry.prefix.format(part=name), registry.parameters_of(name))
        for name in registry
    }


def _choices(field: dataclasses.Field[Any]) -> tuple[str, ...]:
    return tuple(field.metadata[_METADATA_KEY]["choices"])


def _listed(choices: Sequence[str]) -> str:
    return " or ".join(f"'{choice}'" for choice in choices)


def _assemble(group_type: Any, checked: Mapping[str, Any], prefix: str) -> Any:
    types = _types(group_type)
    arguments: dict[str, Any] = {}
    for field in dataclasses.fields(group_type):
        name = prefix + field.name
        if _METADATA_KEY in field.metadata:
            if name in checked:
                arguments[field.name] = checked[name]
        elif _PARTS_KEY in field.metadata:
            arguments[field.name] = {
                part: _assemble(of_part, checked, own_prefix)
                for part, (own_prefix, of_part) in _parts(field, prefix).items()
            }
        else:
            arguments[field.name] = _assemble(types[field.name], checked, prefix=f"{name}.")
    return group_type(**arguments)
