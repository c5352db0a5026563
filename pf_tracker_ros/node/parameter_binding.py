"""Declared parameters as parameters of a ROS node.

A `ParameterBinding` declares every `Declaration` on a node with its descriptor, checks what the
user gave at start-up, and keeps the checked values up to date as they are set at run time. A wrong
value at start-up does not end the node: it is reported, listed in `ParameterBinding.refused`, and
the parameter holds its default until it is set rightly.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from pf_tracker_ros.parameters import Declaration, ParameterError

Values = Mapping[str, Any]

_ROS_TYPES = {
    bool: Parameter.Type.BOOL,
    int: Parameter.Type.INTEGER,
    float: Parameter.Type.DOUBLE,
    str: Parameter.Type.STRING,
    tuple[float, ...]: Parameter.Type.DOUBLE_ARRAY,
}


def descriptor_of(declaration: Declaration, *, read_only: bool) -> ParameterDescriptor:
    """The ROS descriptor of a declaration: type, description with unit, range, constraints.

    Args:
        declaration: The parameter.
        read_only: Whether ROS refuses to change it.

    Returns:
        The descriptor; numbers carry their range, which is also what rejects NaN and infinity.
    """
    unit = f" [{declaration.unit}]" if declaration.unit else ""
    descriptor = ParameterDescriptor(
        name=declaration.name,
        type=_ROS_TYPES[declaration.type].value,
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
    return Parameter(declaration.name, _ROS_TYPES[declaration.type], ros_value)


class ParameterBinding:
    """Keeps the parameters of a node and their declarations together.

    First `declare`, as often as needed; then `listen`, once, to follow changes at run time. From
    then on read-only parameters are fixed, but not before every wrong value has been corrected.

    Attributes:
        values: Full name to checked value, in the declared type. What was refused at start-up has
            its default.
        refused: Full name to the reason, for each parameter that was given a wrong value at
            start-up and has not been set rightly since.
    """

    def __init__(self, node: Node, report: Callable[[str], None] | None = None) -> None:
        """Bind to a node.

        Args:
            node: The node that gets the parameters.
            report: Called with one sentence for every refused or unknown parameter; by default
                it goes to the node's log as an error.
        """
        self.values: dict[str, Any] = {}
        self.refused: dict[str, str] = {}
        self._node = node
        self._report = report or node.get_logger().error
        self._declarations: dict[str, Declaration] = {}
        # rclpy has no public way to see an override before it is declared, and declaring one of
        # the wrong type raises instead of telling what it was.
        self._overrides: dict[str, Parameter] = dict(node._parameter_overrides)
        self._locked = False
        self._check: Callable[[Values], None] = lambda values: None
        self._apply: Callable[[Values], None] = lambda changes: None
        self._imply: Callable[[Values], Values] = lambda requested: {}
        self._ready: Callable[[], bool] = lambda: True

    def declare(
        self,
        declarations: Mapping[str, Declaration],
        defaults: Values | None = None,
        superseded: Collection[str] = (),
    ) -> None:
        """Declare parameters on the node; what the user gave at start-up comes over the defaults.

        An int is taken for a float and an empty list for any list.

        Args:
            declarations: Full name to declaration.
            defaults: Full name to a default that replaces the declaration's own.
            superseded: Full names of which the default counts, whatever was given at start-up.
        """
        for name, declaration in declarations.items():
            self._declarations[name] = declaration
            default = declaration.default if defaults is None else defaults[name]
            self.values[name] = declaration.validate(default)
            if name in self._overrides and name not in superseded:
                try:
                    self.values[name] = _checked(declaration, self._overrides[name])
                except ParameterError as error:
                    self.refused[name] = str(error)
                    self._report(str(error))
        # Declared by type and set afterwards, because rclpy takes an empty list for bytes.
        self._node.declare_parameters(
            "",
            [
                (name, _ROS_TYPES[declaration.type], descriptor_of(declaration, read_only=False))
                for name, declaration in declarations.items()
            ],
            ignore_override=True,
        )
        self._node.set_parameters_atomically(
            [
                ros_parameter(declaration, self.values[name])
                for name, declaration in declarations.items()
            ]
        )

    def listen(
        self,
        *,
        check: Callable[[Values], None] | None = None,
        apply: Callable[[Values], None] | None = None,
        imply: Callable[[Values], Values] | None = None,
        ready: Callable[[], bool] | None = None,
    ) -> None:
        """Follow changes at run time, and report what was given at start-up but does not exist.

        Args:
            check: Called with all values as they would become; raises ValueError to refuse the
                whole set. It must not change anything.
            apply: Called with the changed values once `values` holds them.
            imply: Called with the requested values; returns the values that follow from them for
                other parameters, which are set in the same step. A request wins over it.
            ready: Whether the node has begun; until then read-only parameters can be corrected.
        """
        self._check = check or self._check
        self._apply = apply or self._apply
        self._imply = imply or self._imply
        self._ready = ready or self._ready
        self._node.add_pre_set_parameters_callback(self._convert)
        self._node.add_on_set_parameters_callback(self._validate)
        self._node.add_post_set_parameters_callback(self._store)
        self._lock()
        for name in self._overrides:
            if not self._node.has_parameter(name) and not name.startswith("qos_overrides."):
                self._report(f"{self._unknown(name)}; it has no effect")

    def _convert(self, parameters: list[Parameter]) -> list[Parameter]:
        """Give each value its declared type where it fits, and add the values that follow.

        What does not fit is reported here and left as it is: rclpy refuses a wrong type, range or
        read-only parameter before it asks `_validate`, in words that do not always name it.
        """
        requested: dict[str, Any] = {}
        converted = []
        for parameter in parameters:
            declaration = self._declarations.get(parameter.name)
            if declaration is None:
                if not self._node.has_parameter(parameter.name):
                    self._report(self._unknown(parameter.name))
                converted.append(parameter)
                continue
            try:
                requested[parameter.name] = value = _checked(declaration, parameter)
                converted.append(ros_parameter(declaration, value))
            except ParameterError as error:
                self._report(str(error))
                converted.append(_of_declared_type(declaration, parameter))
            if declaration.read_only and self._locked:
                self._report(
                    f"parameter '{parameter.name}' is fixed while the node runs; "
                    "give it at start-up instead"
                )
        converted.extend(
            ros_parameter(self._declarations[name], value)
            for name, value in self._imply(requested).items()
            if name not in requested
        )
        return converted

    def _validate(self, parameters: list[Parameter]) -> SetParametersResult:
        changes: dict[str, Any] = {}
        for parameter in self._bound(parameters):
            try:
                changes[parameter.name] = _checked(self._declarations[parameter.name], parameter)
            except ParameterError as error:
                return SetParametersResult(successful=False, reason=str(error))
        try:
            self._check({**self.values, **changes})
        except ValueError as error:
            self._report(str(error))
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _store(self, parameters: list[Parameter]) -> None:
        changes = {
            parameter.name: _checked(self._declarations[parameter.name], parameter)
            for parameter in self._bound(parameters)
        }
        if not changes:
            return
        self.values.update(changes)
        for name in changes:
            self.refused.pop(name, None)
        self._apply(changes)
        self._lock()

    def _bound(self, parameters: Iterable[Parameter]) -> list[Parameter]:
        return [parameter for parameter in parameters if parameter.name in self._declarations]

    def _lock(self) -> None:
        """Make read-only what is declared so, once nothing awaits correction."""
        if self._locked or self.refused or not self._ready():
            return
        self._locked = True
        for name, declaration in self._declarations.items():
            if declaration.read_only:
                self._node.set_descriptor(name, descriptor_of(declaration, read_only=True))

    def _unknown(self, name: str) -> str:
        close = difflib.get_close_matches(name, self._declarations, n=1)
        guess = f"did you mean '{close[0]}'?" if close else f"there are: {sorted(self.values)}"
        return f"there is no parameter '{name}' ({guess})"


def _of_declared_type(declaration: Declaration, parameter: Parameter) -> Parameter:
    """Whole numbers as floats in a list of floats: rclpy would complain of their type alone."""
    is_list_of_floats = _ROS_TYPES[declaration.type] == Parameter.Type.DOUBLE_ARRAY
    if not (is_list_of_floats and parameter.type_ == Parameter.Type.INTEGER_ARRAY):
        return parameter
    return ros_parameter(declaration, tuple(float(element) for element in parameter.value))


def _checked(declaration: Declaration, parameter: Parameter) -> Any:
    """The parameter's value in the declared type; ParameterError says why there is none."""
    value = parameter.value
    if value is None and declaration.type == tuple[float, ...]:
        # An empty list in a parameter file arrives as a parameter without a value.
        value = ()
    elif hasattr(value, "__len__") and not isinstance(value, (str, bytes)):
        value = list(value)
    return declaration.validate(value)
