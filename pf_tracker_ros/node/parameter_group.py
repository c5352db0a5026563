"""A group of declared parameters on a node: which there are, and with which values."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from rclpy.parameter import Parameter

from pf_tracker_ros.node.ros_parameters import checked_value
from pf_tracker_ros.parameters import (
    Declaration,
    ParameterError,
    all_declarations,
    choosers,
    declarations,
    why_unknown,
)

Values = Mapping[str, Any]


class Reading(NamedTuple):
    """The parameters of a group after some have been given.

    Attributes:
        there: Full name to declaration, of each parameter that there is.
        values: Full name to value, of the same; what was given wrongly has the value that it has
            where nothing is given.
        taken: Full names of what was given rightly.
        wrong: Full name to the reason, of what was given wrongly.
    """

    there: dict[str, Declaration]
    values: dict[str, Any]
    taken: set[str]
    wrong: dict[str, str]


@dataclass(frozen=True)
class ParameterGroup:
    """Which parameters of a group there are on a node, and their values.

    Attributes:
        group_type: A frozen dataclass as `declarations` takes it.
        keeps_read_only: Whether what is declared read-only is so on the node.
        usual: From the values of the groups before to full name to value, where that is another
            than the declared default; may name what is not there.
        renewed_by: Full name of a parameter of a group before: when it is set, all of this group
            begin anew from `usual`. Empty for none.
        kept: Full names of those that do not.
    """

    group_type: type
    keeps_read_only: bool
    usual: Callable[[Values], Values]
    renewed_by: str
    kept: Collection[str] = ()

    @cached_property
    def every(self) -> dict[str, Declaration]:
        """Full name to declaration of all parameters that can be."""
        return all_declarations(self.group_type)

    @cached_property
    def choosers(self) -> dict[str, Declaration]:
        """Full name to declaration of the parameters that decide which others there are."""
        return choosers(self.group_type)

    def why_unknown(self, name: str, values: Values) -> str:
        """See `pf_tracker_ros.parameters.why_unknown`."""
        return why_unknown(self.group_type, name, values)

    def read(self, given: Mapping[str, Parameter], before: Values, others: Values) -> Reading:
        """The parameters that there are when some are given.

        Args:
            given: Full name to ROS parameter; may name what is not there.
            before: Full name to the value that stays where none is given.
            others: Full name to value, of the groups before.
        """
        values = {**self.usual(others), **before}
        taken: set[str] = set()
        wrong: dict[str, str] = {}

        def take(declaration: Declaration) -> None:
            name = declaration.name
            try:
                if name in given:
                    values[name] = checked_value(declaration, given[name])
                    taken.add(name)
                else:
                    values[name] = declaration.validate(values.get(name, declaration.default))
            except ParameterError as error:
                wrong[name] = str(error)
                values.setdefault(name, declaration.default)

        for declaration in self.choosers.values():
            take(declaration)
        there = self._there(values)
        for declaration in there.values():
            if declaration.name not in self.choosers:
                take(declaration)
        return Reading(there, {name: values[name] for name in there}, taken, wrong)

    def _there(self, values: Values) -> dict[str, Declaration]:
        there = declarations(self.group_type, values)
        if self.keeps_read_only:
            return there
        return {
            name: dataclasses.replace(declaration, read_only=False)
            for name, declaration in there.items()
        }
