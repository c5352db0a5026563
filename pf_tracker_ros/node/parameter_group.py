"""A group of declared parameters on a node, and their values."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from rclpy.parameter import Parameter

from pf_tracker_ros.node.ros_parameters import checked_value
from pf_tracker_ros.parameters import Declaration, ParameterError, declarations

ParameterValues = Mapping[str, Any]
ResetCondition = Callable[[Any, Any], bool]
"""Returns from the present and the new value of a parameter whether it resets others."""


@dataclass
class Request:
    """Values to set, checked group by group.

    Attributes:
        values: Full name to value of all parameters after it; for invalid ones as if not given.
        changes: Full name to value of the given parameters and those reset with them.
        invalid: Full name to reason of refused values.
        unknown: Full name to reason of unknown parameters.
    """

    values: dict[str, Any] = field(default_factory=dict)
    changes: dict[str, Any] = field(default_factory=dict)
    invalid: dict[str, str] = field(default_factory=dict)
    unknown: dict[str, str] = field(default_factory=dict)


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
        self, given: Mapping[str, Parameter], before: ParameterValues, request: Request
    ) -> None:
        """Check given values, complete them, and add them to a request.

        Args:
            given: Full name to ROS parameter; other names are ignored.
            before: Full name to value of the parameters that keep it unless given.
            request: Has the values of earlier groups.
        """
        defaults = {**self.defaults(request.values), **before}
        for name, declaration in self.declarations.items():
            value, is_changed = defaults.get(name, declaration.default), name not in before
            if name in given:
                try:
                    value, is_changed = checked_value(declaration, given[name]), True
                except ParameterError as error:
                    request.invalid[name] = str(error)
            request.values[name] = value
            if is_changed:
                request.changes[name] = value
