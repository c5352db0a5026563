"""Declared parameters as parameters of a ROS node.

A `ParameterBinding` declares the parameters on a node, with their descriptors, checks what the
user gave at start-up, and keeps the checked values up to date as they are set at run time. A wrong
value at start-up does not end the node: it is reported, listed in `ParameterBinding.refused`, and
the parameter holds its default until it is set rightly.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from pf_tracker_ros.node.parameter_group import ParameterGroup, ResetCondition, Values
from pf_tracker_ros.node.ros_parameters import descriptor_of, ros_parameter, ros_type
from pf_tracker_ros.parameters import Declaration

# More of them are no help to read.
_MOST_NAMED = 12


class NoSuchParameter(ParameterNotDeclaredException):
    """A request names parameters that there are not, and says why.

    Args:
        reason: One sentence or several.
    """

    def __init__(self, reason: str) -> None:
        # What rclpy makes of names alone does not say what to do.
        Exception.__init__(self, reason)


class _Request(NamedTuple):
    """What a request comes to.

    Attributes:
        values: Full name to value, of every parameter after it.
        changes: Full name to value of what is requested or follows from it.
        wrong: Full name to the reason, of what cannot be set to what is asked.
        unknown: Full name to the reason, of what is not there.
    """

    values: dict[str, Any]
    changes: dict[str, Any]
    wrong: dict[str, str]
    unknown: dict[str, str]


class ParameterBinding:
    """Keeps the parameters of a node and their declarations together.

    First `declare`, as often as needed; then `listen`, once, to follow changes at run time. From
    then on read-only parameters are fixed, but not before every wrong value has been corrected.

    Attributes:
        values: Full name to checked value, in the declared type. What was refused at start-up has
            its default.
        refused: Full name to the reason, for each parameter that was given a wrong value at
            start-up and has not been set rightly since.

    Args:
        node: The node that gets the parameters.
        report: Called with one sentence for every refused or unknown parameter; by default it goes
            to the node's log as an error.
    """

    def __init__(self, node: Node, report: Callable[[str], None] | None = None) -> None:
        self.values: dict[str, Any] = {}
        self.refused: dict[str, str] = {}
        self._node = node
        self._report = report or node.get_logger().error
        self._groups: list[ParameterGroup] = []
        self._declarations: dict[str, Declaration] = {}
        # rclpy has no public way to see an override before it is declared, and declaring one of
        # the wrong type raises instead of telling what it was.
        self._overrides: dict[str, Parameter] = dict(node._parameter_overrides)
        self._superseded: set[str] = set()
        self._locked = False
        self._request: _Request | None = None
        self._check: Callable[[Values], None] = lambda values: None
        self._apply: Callable[[Values], None] = lambda changes: None
        self._ready: Callable[[], bool] = lambda: True

    def declare(
        self,
        group_type: type,
        *,
        defaults: Callable[[Values], Values] | None = None,
        reset_by: Mapping[str, ResetCondition] | None = None,
        kept: Collection[str] = (),
        superseded: Collection[str] = (),
        keeps_read_only: bool = True,
    ) -> None:
        """Declare a group's parameters on the node; what the user gave comes over the defaults.

        Those that a group before has as well are declared once.

        An int is taken for a float and an empty list for any list.

        Args:
            group_type: A frozen dataclass as `pf_tracker_ros.parameters.declarations` takes it.
            defaults: From the values of what was declared before to full name to value, where that is
                another than the declared default; may name what is not in the group.
            reset_by: Full name of a parameter that was declared before, to whether all of this
                group begin anew from `defaults` when it is set.
            kept: Full names of those that do not.
            superseded: Full names that count as not given at start-up.
            keeps_read_only: Whether what is declared read-only is so on the node; it can't be
                where it does not stay.
        """
        superseded = set(superseded) - set(kept)
        defaults = defaults or (lambda _: {})
        group = ParameterGroup(
            group_type,
            keeps_read_only,
            defaults,
            reset_by or {},
            kept,
            declared=tuple(self._declarations),
        )
        given = {name: one for name, one in self._overrides.items() if name not in superseded}
        reading = group.read(given, {}, self.values)
        for reason in reading.wrong.values():
            self._report(reason)
        self.refused |= reading.wrong
        self._superseded |= group.declarations.keys() & superseded
        self._groups.append(group)
        self.values |= reading.values
        self._declarations |= group.declarations
        # Declared by type and set afterwards, because rclpy takes an empty list for bytes.
        self._node.declare_parameters(
            "",
            [
                (one.name, ros_type(one), descriptor_of(one, read_only=False))
                for one in group.declarations.values()
            ],
            ignore_override=True,
        )
        self._node.set_parameters_atomically(
            [ros_parameter(one, self.values[one.name]) for one in group.declarations.values()]
        )

    def listen(
        self,
        *,
        check: Callable[[Values], None] | None = None,
        apply: Callable[[Values], None] | None = None,
        ready: Callable[[], bool] | None = None,
    ) -> None:
        """Follow changes at run time, and report what was given at start-up but does not exist.

        Args:
            check: Called with all values as they would become; raises ValueError to refuse the
                whole set. It must not change anything.
            apply: Called with the changed values once `values` holds them: what was requested, and
                what begins anew with it.
            ready: Whether the node has begun; until then read-only parameters can be corrected.
        """
        self._check = check or self._check
        self._apply = apply or self._apply
        self._ready = ready or self._ready
        self._node.add_pre_set_parameters_callback(self._convert)
        self._node.add_on_set_parameters_callback(self._validate)
        self._node.add_post_set_parameters_callback(self._store)
        self._lock()
        told = self.refused.keys() | self._superseded
        for name in self._overrides:
            is_foreign = self._node.has_parameter(name) or name.startswith("qos_overrides.")
            if name not in told and not is_foreign:
                self._report(f"{self._why_unknown(name)}; it has no effect")

    def faults(self, parameters: Sequence[Parameter]) -> dict[str, str]:
        """What of a request cannot be, whatever else is in it; each is reported.

        Args:
            parameters: Of the request.

        Returns:
            Full name to the reason.
        """
        request = self._read(parameters)
        faults = request.unknown | request.wrong
        for reason in faults.values():
            self._report(reason)
        return faults

    def resets_others(self, name: str) -> bool:
        """Whether others begin anew when a parameter is set, so that it has to come first."""
        return any(name in group.reset_by for group in self._groups)

    def _convert(self, parameters: list[Parameter]) -> list[Parameter]:
        """Give each value its declared type, and add what follows.

        In place of a wrong value stands the present one, so that it is `_validate` that refuses it:
        what rclpy says of a wrong type or range does not always name the parameter.
        """
        self._request = request = self._read(parameters)
        reasons = [*request.unknown.values(), *request.wrong.values()]
        for reason in reasons:
            self._report(reason)
        if request.unknown:
            raise NoSuchParameter("; ".join(reasons))
        foreign = [one for one in parameters if one.name not in self._declarations]
        values = request.changes | {name: self.values[name] for name in request.wrong}
        bound = [ros_parameter(self._declarations[name], value) for name, value in values.items()]
        return foreign + bound

    def _read(self, parameters: Sequence[Parameter]) -> _Request:
        request = _Request({}, {}, {}, {})
        given = {parameter.name: parameter for parameter in parameters}
        for group in self._groups:
            is_renewed = group.is_reset(self.values, request.changes)
            stays = group.kept if is_renewed else group.declarations
            before = {name: self.values[name] for name in stays}
            reading = group.read(given, before, request.values)
            request.values.update(reading.values)
            request.wrong.update(reading.wrong)
            request.changes.update(
                (name, value)
                for name, value in reading.values.items()
                if name in reading.taken or name not in before
            )
        for name in given:
            declaration = self._declarations.get(name)
            if declaration and declaration.read_only and self._locked:
                request.wrong[name] = (
                    f"parameter '{name}' is fixed while the node runs; give it at start-up instead"
                )
            if not self._node.has_parameter(name):
                request.unknown[name] = self._why_unknown(name)
        return request

    def _validate(self, parameters: list[Parameter]) -> SetParametersResult:
        request = self._request_of(parameters)
        if request is None:
            return SetParametersResult(successful=True)
        if request.wrong:
            return SetParametersResult(successful=False, reason="; ".join(request.wrong.values()))
        try:
            self._check(request.values)
        except ValueError as error:
            self._report(str(error))
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _store(self, parameters: list[Parameter]) -> None:
        request = self._request_of(parameters)
        if request is None:
            return
        self._request, self.values = None, request.values
        for name in list(self.refused):
            if name in request.changes:
                del self.refused[name]
        self._apply(request.changes)
        self._lock()

    def _request_of(self, parameters: Iterable[Parameter]) -> _Request | None:
        """What rclpy asks for, None if it is none of this binding's business."""
        is_bound = any(parameter.name in self._declarations for parameter in parameters)
        return self._request if is_bound else None

    def _lock(self) -> None:
        """Make read-only what is declared so, once nothing awaits correction."""
        if self._locked or self.refused or not self._ready():
            return
        self._locked = True
        for name, declaration in self._declarations.items():
            if declaration.read_only:
                self._node.set_descriptor(name, descriptor_of(declaration, read_only=True))

    def _why_unknown(self, name: str) -> str:
        close = difflib.get_close_matches(name, self._declarations, n=1)
        guess = f"did you mean '{close[0]}'?" if close else _known(self._declarations)
        return f"there is no parameter '{name}' ({guess})"


def _known(names: Collection[str]) -> str:
    """Which parameters there are, as far as that can be read."""
    if len(names) > _MOST_NAMED:
        return "`ros2 param list` and docs/parameters.md name those that there are"
    return f"there are: {', '.join(sorted(names))}"
