"""Declared parameters in ROS: their types and descriptors, and a group of them on a node."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.parameter import Parameter

from pf_tracker_ros.parameters import Declaration, ParameterError, declarations

_ROS_TYPES = {
    bool: Parameter.Type.BOOL,
    int: Parameter.Type.INTEGER,
    float: Parameter.Type.DOUBLE,
    str: Parameter.Type.STRING,
    tuple[float, ...]: Parameter.Type.DOUBLE_ARRAY,
    tuple[str, ...]: Parameter.Type.STRING_ARRAY,
}


def ros_type(declaration: Declaration) -> Parameter.Type:
    """The ROS type of a declaration."""
    return _ROS_TYPES[declaration.type]


def descriptor_of(declaration: Declaration, *, read_only: bool) -> ParameterDescriptor:
    """The ROS descriptor of a declaration: type, description with unit, range, constraints.

    Args:
        declaration: The parameter.
        read_only: Whether ROS refuses changes.

    Returns:
        The descriptor; the range of numbers also rejects NaN and infinity.
    """
    unit = f" [{declaration.unit}]" if declaration.unit else ""
    descriptor = ParameterDescriptor(
        name=declaration.name,
        type=ros_type(declaration).value,
        description=declaration.description + unit,
        read_only=read_only,
    )
    low: Any = declaration.minimum
    high: Any = declaration.maximum
    if declaration.type is int:
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    elif declaration.type is float:
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(low), to_value=float(high))
        ]
    else:
        descriptor.additional_constraints = f"allowed: {declaration.allowed}"
    return descriptor


def ros_parameter(declaration: Declaration, value: Any) -> Parameter:
    """A checked value as a ROS parameter of the declared type."""
    ros_value = list(value) if isinstance(value, tuple) else value
    return Parameter(declaration.name, ros_type(declaration), ros_value)


def checked_value(declaration: Declaration, parameter: Parameter) -> Any:
    """The value of a ROS parameter in the declared type.

    An int is valid for a float and an empty list for any list.

    Raises:
        ParameterError: The type is another one, or the value is not allowed.
    """
    value = parameter.value
    if value is None and declaration.type in (tuple[float, ...], tuple[str, ...]):
        # An empty list of a parameter file is a parameter without a value.
        value = ()
    elif hasattr(value, "__len__") and not isinstance(value, (str, bytes)):
        value = list(value)
    return declaration.validate(value)


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
