"""A group of declared parameters on a node, and their values."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from rclpy.parameter import Parameter

from pf_tracker_ros.node.ros_parameters import checked_value
from pf_tracker_ros.parameters import Declaration, ParameterError, declarations

ParameterValues = Mapping[str, Any]
ResetCondition = Callable[[Any, Any], bool]
"""Returns from the present and the new value of a parameter whether it resets others."""


class Reading(NamedTuple):
    """Checked values of a group.

    Attributes:
        values: Full name to value; the default in place of an invalid value.
        given: Full names of the valid given values.
        invalid: Full name to reason of invalid values.
    """

    values: dict[str, Any]
    given: set[str]
    invalid: dict[str, str]


@dataclass(frozen=True)
class ParameterGroup:
    """The parameters of a group on a node, and their values.

    Attributes:
        group_type: A frozen dataclass as for `declarations`.
        keeps_read_only: Whether declared read-only parameters are so on the node.
        defaults: Computes defaults from the values of earlier groups, full name to value, in place
            of the declared ones; other names are ignored.
        reset_by: Full name of a parameter of an earlier group to the condition under which a change
            of it resets this group to `defaults`.
        kept: Full names of parameters that are not reset.
        declared: Full names of parameters of earlier groups, which are left out here.
    """

    group_type: type
    keeps_read_only: bool
    defaults: Callable[[ParameterValues], ParameterValues]
    reset_by: Mapping[str, ResetCondition]
    kept: Collection[str] = ()
    declared: Collection[str] = ()

    @cached_property
    def declarations(self) -> dict[str, Declaration]:
        """Full name to declaration."""
        return {
            name: one if self.keeps_read_only else dataclasses.replace(one, read_only=False)
            for name, one in declarations(self.group_type).items()
            if name not in self.declared
        }

    def is_reset(self, before: ParameterValues, changes: ParameterValues) -> bool:
        """Whether changes of earlier groups reset this one; both full name to value."""
        return any(
            name in changes and resets(before[name], changes[name])
            for name, resets in self.reset_by.items()
        )

    def read(
        self, given: Mapping[str, Parameter], before: ParameterValues, others: ParameterValues
    ) -> Reading:
        """Check given values, and complete them.

        Args:
            given: Full name to ROS parameter; other names are ignored.
            before: Full name to value of the parameters that keep it unless given.
            others: Full name to value of earlier groups.
        """
        defaults = {**self.defaults(others), **before}
        reading = Reading({}, set(), {})
        for name, declaration in self.declarations.items():
            reading.values[name] = defaults.get(name, declaration.default)
            if name not in given:
                continue
            try:
                reading.values[name] = checked_value(declaration, given[name])
                reading.given.add(name)
            except ParameterError as error:
                reading.invalid[name] = str(error)
        return reading
