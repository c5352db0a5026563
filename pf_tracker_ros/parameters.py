"""Declared parameters: the one place where a tunable exists.

A group of tunables is a frozen dataclass whose fields are made by `declared`, which takes the
default, the description, the unit and the range. Groups nest: the field `particles` of the group
`filter` has the full name `filter.particles`. From the declarations follow the checks at start-up
and at run time, the ROS descriptors, the preset files and the table in `docs/parameters.md`.

Some tunables choose a part by its name, such as the motion model. What only that part reads is
declared beside it by `chosen`, and exists while the part is chosen.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import typing
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

Group = TypeVar("Group")

_METADATA_KEY = "declaration"
_CHOSEN_KEY = "chosen"
_TYPE_NAMES = {
    bool: "bool",
    int: "int",
    float: "float",
    str: "string",
    tuple[float, ...]: "list of floats",
    tuple[str, ...]: "list of strings",
}
# Of a value, in a message.
_LONGEST_QUOTE = 200
_ELEMENTS = {tuple[float, ...]: float, tuple[str, ...]: str}


class ParameterError(ValueError):
    """A parameter that does not exist, or a value that it does not allow."""


@dataclass(frozen=True)
class Declaration:
    """One tunable: its full name, type, default, range and what it is for.

    Attributes:
        name: Full name, groups separated by dots.
        type: `bool`, `int`, `float`, `str`, `tuple[float, ...]` or `tuple[str, ...]`.
        default: Value when nothing else is given.
        description: One sentence: what it does, and when to change it.
        unit: Unit of the value, empty where it has none.
        minimum: Smallest allowed number, inclusive; of each element for a list; -inf for others.
        maximum: Largest allowed number, inclusive; of each element for a list; inf for others.
        choices: Allowed strings; empty allows any. A list of strings holds each at most once.
        lengths: Allowed lengths of a list; empty allows any.
        read_only: Whether it is fixed once the tracker or node has started.
        only_with: What else must be chosen for it to exist, for example
            "motion.model 'affine'"; empty where it always does.
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
    only_with: str = ""

    @property
    def type_name(self) -> str:
        """The type as a user would write it, for example `list of floats`."""
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
            return "any string" if self.type is str else "any strings"
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
        """The element of a list, or a value that is none, in its type."""
        if element_type in (int, float):
            return self._number(element, element_type, value)
        if not isinstance(element, element_type):
            raise self._refusal(value)
        if self.choices and element not in self.choices:
            raise self._refusal(value)
        return element_type(element)

    def _number(self, element: Any, number_type: type, value: Any) -> Any:
        kind = getattr(getattr(element, "dtype", None), "kind", "")
        if kind and getattr(element, "ndim", 1) == 0:
            # NumPy's scalars register as neither int nor bool; times and texts are no numbers.
            convert = {"i": int, "u": int, "f": float}.get(kind)
            if convert is None:
                raise self._refusal(value)
            element = convert(element)
        integral = isinstance(element, int) and not isinstance(element, bool)
        if not integral and not (number_type is float and isinstance(element, float)):
            raise self._refusal(value)
        # What is not a number is in no range.
        if not self.minimum <= element <= self.maximum:
            raise self._refusal(value)
        return number_type(element)

    def _refusal(self, value: Any) -> ParameterError:
        return ParameterError(
            f"parameter '{self.name}' is {quoted(value)}; allowed: {self.type_name}, {self.allowed}"
        )


def quoted(value: Any) -> str:
    """A value as a message quotes it, cut where it is long."""
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
    lengths: Sequence[int] = (),
    read_only: bool = False,
) -> Any:
    """Declare one tunable as a field of a frozen dataclass; arguments as in `Declaration`.

    Choices may be a collection that still grows, such as a `Registry`.

    Raises:
        TypeError: A number without both ends of its range; the range keeps out NaN and infinity.
    """
    # An empty list may be one of texts; `declarations` knows.
    numeric = (
        isinstance(default, int | float | tuple) and not isinstance(default, bool) and default != ()
    )
    if numeric and not choices and not (math.isfinite(minimum) and math.isfinite(maximum)):
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
                "lengths": tuple(lengths),
                "read_only": read_only,
            }
        },
    )


def group(group_type: type[Group]) -> Group:
    """Declare a nested group of tunables as a field of a frozen dataclass."""
    return dataclasses.field(default_factory=group_type)


# Under which name each chosen group stands, "" for that of the group around it, to its type.
Groups = Mapping[str, type]


def chosen(by: str, groups: Callable[[Any], Groups]) -> Any:
    """Declare the tunables that exist only with some values of another one, as a field.

    The field holds the built groups by the same names.

    Args:
        by: The other one's name, counted from the group around the field.
        groups: From its value to the groups that it brings.
    """
    return dataclasses.field(
        default_factory=dict, metadata={_CHOSEN_KEY: {"by": by, "groups": groups}}
    )


def declarations(
    group_type: type, values: Mapping[str, Any] | None = None, prefix: str = ""
) -> dict[str, Declaration]:
    """All tunables that there are with some values, in order of declaration.

    A choice among one is none, and not listed.

    Args:
        group_type: A frozen dataclass whose fields were made by `declared`, `group` and `chosen`.
        values: Full name to value, which tells what is chosen; the default of what is not named.
        prefix: Put in front of each name, with its dot.

    Returns:
        Full name to declaration.

    Raises:
        ParameterError: A value that chooses is not allowed.
    """
    types = _types(group_type)
    found: dict[str, Declaration] = {}
    for field in dataclasses.fields(group_type):
        name = prefix + field.name
        if _METADATA_KEY in field.metadata:
            declaration = _declaration(name, types[field.name], field)
            if len(declaration.choices) != 1:
                found[name] = declaration
        elif _CHOSEN_KEY in field.metadata:
            chooser = found[prefix + field.metadata[_CHOSEN_KEY]["by"]]
            value = chooser.validate((values or {}).get(chooser.name, chooser.default))
            for own, of_part in field.metadata[_CHOSEN_KEY]["groups"](value).items():
                found.update(declarations(of_part, values, _extended(prefix, own)))
        elif dataclasses.is_dataclass(types[field.name]):
            found.update(declarations(types[field.name], values, prefix=f"{name}."))
        else:
            raise TypeError(
                f"{group_type.__name__}.{field.name} is no tunable; make it by `declared`, with "
                "its description and its range"
            )
    return found


def all_declarations(group_type: type) -> dict[str, Declaration]:
    """All tunables that can be, whatever is chosen; `only_with` says with what.

    Args:
        group_type: As for `declarations`.
    """
    found = declarations(group_type)
    needs: dict[str, str] = {}
    for chooser in choosers(group_type).values():
        choices, takes_several = chooser.choices, chooser.type == tuple[str, ...]
        there = {
            choice: declarations(group_type, {chooser.name: (choice,) if takes_several else choice})
            for choice in choices
        }
        for of_choice in there.values():
            found |= {name: one for name, one in of_choice.items() if name not in found}
        for name in found:
            bringing = [choice for choice in choices if name in there[choice]]
            if 0 < len(bringing) < len(choices):
                needs[name] = f"{chooser.name} {_listed(bringing)}"
        if not takes_several:
            continue
        together = declarations(group_type, {chooser.name: choices})
        for choice in choices:
            others = [other for other in choices if other != choice]
            without = declarations(group_type, {chooser.name: others})
            for name in together.keys() - without.keys() - there[choice].keys():
                found[name] = together[name]
                needs[name] = f"{chooser.name} {_listed([choice])} and another"
    return {
        name: dataclasses.replace(declaration, only_with=needs.get(name, ""))
        for name, declaration in found.items()
    }


def choosers(group_type: type) -> dict[str, Declaration]:
    """The tunables that decide which others there are; they are always there.

    Args:
        group_type: As for `declarations`.

    Returns:
        Full name to declaration.
    """
    return {declaration.name: declaration for declaration in _choosers(group_type)}


def build(group_type: type[Group], values: Mapping[str, Any]) -> Group:
    """Build a group from full names and values; what is not named keeps its default.

    Args:
        group_type: A frozen dataclass whose fields were made by `declared`, `group` and `chosen`.
        values: Full name to value.

    Returns:
        The group, every value checked.

    Raises:
        ParameterError: A name is not declared with these values, or a value is not allowed.
    """
    known = declarations(group_type, values)
    for name in values:
        if name not in known:
            raise ParameterError(why_unknown(group_type, name, values))
    checked = {name: one.validate(values.get(name, one.default)) for name, one in known.items()}
    return typing.cast(Group, _assemble(group_type, checked, prefix=""))


def change(
    group_type: type, before: Mapping[str, Any], changes: Mapping[str, Any]
) -> dict[str, Any]:
    """Values after a change: what the change no longer lets exist is left out.

    Args:
        group_type: As for `build`.
        before: Full name to value.
        changes: Full name to value.

    Raises:
        ParameterError: A value that chooses is not allowed.
    """
    known = declarations(group_type, {**before, **changes})
    return {name: value for name, value in before.items() if name in known} | dict(changes)


def why_unknown(group_type: type, name: str, values: Mapping[str, Any]) -> str:
    """Why there is no tunable of a name with these values, and what to do, as a sentence."""
    every = all_declarations(group_type)
    here = declarations(group_type, values)
    if name in every:
        return f"no parameter '{name}' here; it needs {every[name].only_with}"
    close = difflib.get_close_matches(str(name), every, n=1)
    guess = f"did you mean '{close[0]}'?" if close else f"there are: {', '.join(here)}"
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
        elif _CHOSEN_KEY in field.metadata:
            for own, part in value.items():
                flat.update(flatten(part, _extended(prefix, own)))
        else:
            flat.update(flatten(value, prefix=f"{name}."))
    return flat


@cache
def _types(group_type: type) -> Mapping[str, Any]:
    return typing.get_type_hints(group_type)


def _declaration(name: str, value_type: Any, field: dataclasses.Field[Any]) -> Declaration:
    declaration = Declaration(name=name, type=value_type, **field.metadata[_METADATA_KEY])
    is_bounded = math.isfinite(declaration.minimum) and math.isfinite(declaration.maximum)
    if _ELEMENTS.get(value_type, value_type) in (int, float) and not is_bounded:
        raise TypeError(f"a number needs a range: {declaration.description}")
    return dataclasses.replace(declaration, choices=_choices(field))


def _choices(field: dataclasses.Field[Any]) -> tuple[str, ...]:
    return tuple(field.metadata[_METADATA_KEY]["choices"])


def _listed(choices: Sequence[str]) -> str:
    return " or ".join(f"'{choice}'" for choice in choices)


def _choosers(group_type: type, prefix: str = "") -> Iterator[Declaration]:
    types = _types(group_type)
    known = declarations(group_type, prefix=prefix)
    for field in dataclasses.fields(group_type):
        if _CHOSEN_KEY in field.metadata:
            yield known[prefix + field.metadata[_CHOSEN_KEY]["by"]]
        elif _METADATA_KEY not in field.metadata:
            yield from _choosers(types[field.name], f"{prefix}{field.name}.")


def _extended(prefix: str, own: str) -> str:
    return f"{prefix}{own}." if own else prefix


def _assemble(group_type: Any, checked: Mapping[str, Any], prefix: str) -> Any:
    types = _types(group_type)
    arguments: dict[str, Any] = {}
    for field in dataclasses.fields(group_type):
        name = prefix + field.name
        if _METADATA_KEY in field.metadata:
            if name in checked:
                arguments[field.name] = checked[name]
        elif _CHOSEN_KEY in field.metadata:
            groups = field.metadata[_CHOSEN_KEY]["groups"]
            arguments[field.name] = {
                own: _assemble(of_part, checked, _extended(prefix, own))
                for own, of_part in groups(
                    checked[prefix + field.metadata[_CHOSEN_KEY]["by"]]
                ).items()
            }
        else:
            arguments[field.name] = _assemble(types[field.name], checked, prefix=f"{name}.")
    return group_type(**arguments)
