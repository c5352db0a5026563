"""A group of declared parameters on a node, and with which values."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from rclpy.parameter import Parameter

from pf_tracker_ros.node.ros_parameters import checked_value
from pf_tracker_ros.parameters import Declaration, ParameterError, declarations

Values = Mapping[str, Any]
ResetCondition = Callable[[Any, Any], bool]
"""Tells from a parameter's value as it is, and as it is set, whether others begin anew with it."""


class Reading(NamedTuple):
    """The parameters of a group after some have been given.

    Attributes:
        values: Full name to value; what was given wrongly has the value that it has where nothing
            is given.
        taken: Full names of what was given rightly.
        wrong: Full name to the reason, of what was given wrongly.
    """

    values: dict[str, Any]
    taken: set[str]
    wrong: dict[str, str]


@dataclass(frozen=True)
class ParameterGroup:
    """The parameters of a group on a node, and their values.

    Attributes:
        group_type: A frozen dataclass as `declarations` takes it.
        keeps_read_only: Whether what is declared read-only is so on the node.
        defaults: From the values of the groups before to full name to value, where that is another
            than the declared default; may name what is not in the group.
        reset_by: Full name of a parameter of a group before, to whether all of this group begin
            anew from `defaults` when it is set.
        kept: Full names of those that do not.
        declared: Full names of parameters of the groups before, which are not once more in this.
    """

    group_type: type
    keeps_read_only: bool
    defaults: Callable[[Values], Values]
    reset_by: Mapping[str, ResetCondition]
    kept: Collection[str] = ()
    declared: Collection[str] = ()

    @cached_property
    def declarations(self) -> dict[str, Declaration]:
        """Full name to declaration of all parameters."""
        return {
            name: one if self.keeps_read_only else dataclasses.replace(one, read_only=False)
            for name, one in declarations(self.group_type).items()
            if name not in self.declared
        }

    def is_reset(self, before: Values, changes: Values) -> bool:
        """Whether changes of the groups before renew this one; both full name to value."""
        return any(
            name in changes and renews(before[name], changes[name])
            for name, renews in self.reset_by.items()
        )

    def read(self, given: Mapping[str, Parameter], before: Values, others: Values) -> Reading:
        """The parameters when some are given.

        Args:
            given: Full name to ROS parameter; may name what is not in the group.
            before: Full name to the value that stays where none is given.
            others: Full name to value, of the groups before.
        """
        defaults = {**self.defaults(others), **before}
        reading = Reading({}, set(), {})
        for name, declaration in self.declarations.items():
            reading.values[name] = defaults.get(name, declaration.default)
            if name not in given:
                continue
            try:
                reading.values[name] = checked_value(declaration, given[name])
                reading.taken.add(name)
            except ParameterError as error:
                reading.wrong[name] = str(error)
        return reading
