"""Conversion of declared parameters to ROS: type, descriptor and value."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.parameter import Parameter

from pf_tracker_ros.parameters import Declaration

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
