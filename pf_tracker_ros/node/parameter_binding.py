"""Declared parameters as parameters of a ROS node.

A `ParameterBinding` declares on a node, with their descriptors, the parameters that there are,
checks what the user gave at start-up, and keeps the checked values up to date as they are set at
run time. When a parameter that chooses a part is set, the node loses the parameters of the part
before and gets those of the other. A wrong value at start-up does not end the node: it is
reported, listed in `ParameterBinding.refused`, and the parameter holds its default until it is set
rightly.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from pf_tracker_ros.node.parameter_group import ParameterGroup, Values
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
        there: Full name to declaration, of each parameter that there is after it.
        values: Full name to value, of the same.
        changes: Full name to value of what is requested, follows from it, or comes to be there.
        wrong: Full name to the reason, of what cannot be set to what is asked.
        unknown: Full name to the reason, of what is not there.
    """

    there: dict[str, Declaration]
    values: dict[str, Any]
    changes: dict[str, Any]
    wrong: dict[str, str]
    unknown: dict[str, str]


class ParameterBinding:
    """Keeps the parameters of a node and their declarations together.

    First `declare`, as often as needed; then `listen`, once, to follow changes at run time. From
    then on read-only parameters are fixed, but not before every wrong value has been corrected.

    Attributes:
        values: Full name to checked value, in the declared type, of each parameter that there is.
            What was refused at start-up has its default.
        refused: Full name to the reason, for each parameter that was given a wrong value at
            start-up, or given by a name that it has no more, and has not been set rightly since.

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
        self._declaring = False
        self._request: _Request | None = None
        self._check: Callable[[Values], None] = lambda values: None
        self._apply: Callable[[Values], None] = lambda changes: None
        self._ready: Callable[[], bool] = lambda: True

    def declare(
        self,
        group_type: type,
        *,
        usual: Callable[[Values], Values] | None = None,
        renewed_by: str = "",
        kept: Collection[str] = (),
        superseded: Collection[str] = (),
        keeps_read_only: bool = True,
    ) -> None:
        """Declare a group's parameters on the node; what the user gave comes over the defaults.

        An int is taken for a float and an empty list for any list.

        Args:
            group_type: A frozen dataclass as `pf_tracker_ros.parameters.declarations` takes it.
            usual: From the values of what was declared before to full name to value, where that is
                another than the declared default; may name what is not there.
            renewed_by: Full name of a parameter that was declared before: when it is set, all of
                this group begin anew from `usual`.
            kept: Full names of those that do not.
            superseded: Full names that count as not given at start-up.
            keeps_read_only: Whether what is declared read-only is so on the node; it can't be
                where it does not stay.
        """
        superseded = set(superseded) - set(kept)
        usual = usual or (lambda _: {})
        group = ParameterGroup(group_type, keeps_read_only, usual, renewed_by, kept)
        given = {name: one for name, one in self._overrides.items() if name not in superseded}
        reading = group.read(given, {}, self.values)
        for reason in reading.wrong.values():
            self._report(reason)
        self.refused |= reading.wrong
        self._superseded |= group.every.keys() & superseded
        self._groups.append(group)
        self.values |= reading.values
        self._put(reading.there.values(), reading.values)
        self._declarations |= reading.there

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
            apply: Called with the changed values once `values` holds them: what was requested, what
                begins anew with it, and what has come to be there.
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
                self._report(f"{self._why_unknown(name, self.values)}; it has no effect")

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

    def precedence(self, name: str) -> int:
        """Where a parameter comes when several are set one by one: the smallest first.

        First what renews others, then what decides which there are, then the rest.
        """
        if any(name == group.renewed_by for group in self._groups):
            return 0
        return 1 if any(name in group.choosers for group in self._groups) else 2

    def _convert(self, parameters: list[Parameter]) -> list[Parameter]:
        """Give each value its declared type, and add what follows.

        What is only coming to be there is left out, and declared once rclpy has taken the rest. In
        place of a wrong value stands the present one, so that it is `_validate` that refuses it:
        what rclpy says of a wrong type or range does not always name the parameter.
        """
        if self._declaring:
            return parameters
        self._request = request = self._read(parameters)
        reasons = [*request.unknown.values(), *request.wrong.values()]
        for reason in reasons:
            self._report(reason)
        if request.unknown:
            raise NoSuchParameter("; ".join(reasons))
        converted = [parameter for parameter in parameters if parameter.name not in request.there]
        named = dict.fromkeys([parameter.name for parameter in parameters] + [*request.changes])
        for name in named:
            declaration = request.there.get(name)
            if declaration and declaration == self._declarations.get(name):
                value = self.values[name] if name in request.wrong else request.changes[name]
                converted.append(ros_parameter(declaration, value))
        return converted

    def _read(self, parameters: Sequence[Parameter]) -> _Request:
        request = _Request({}, {}, {}, {}, {})
        given = {parameter.name: parameter for parameter in parameters}
        for group in self._groups:
            before = {name: one for name, one in self.values.items() if name in group.every}
            if group.renewed_by in request.changes:
                before = {name: one for name, one in before.items() if name in group.kept}
            reading = group.read(given, before, request.values)
            request.there.update(reading.there)
            request.values.update(reading.values)
            request.wrong.update(reading.wrong)
            request.changes.update(
                (name, value)
                for name, value in reading.values.items()
                if name in reading.taken or name not in before
            )
        for name in given:
            declaration = request.there.get(name)
            if declaration and declaration.read_only and self._locked:
                request.wrong[name] = (
                    f"parameter '{name}' is fixed while the node runs; give it at start-up instead"
                )
            is_foreign = self._node.has_parameter(name) and name not in self._declarations
            if declaration is None and not is_foreign:
                request.unknown[name] = self._why_unknown(name, request.values)
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
        self._request = None
        before, after = self._declarations, request.there
        for name in before:
            if after.get(name) != before[name]:
                self._node.undeclare_parameter(name)
        self._put((one for one in after.values() if before.get(one.name) != one), request.values)
        self._declarations, self.values = after, request.values
        for name in list(self.refused):
            if name in request.changes or name not in request.there:
                del self.refused[name]
        self._apply(request.changes)
        self._lock()

    def _request_of(self, parameters: Iterable[Parameter]) -> _Request | None:
        """What rclpy asks for, None if it is none of this binding's business."""
        is_bound = any(parameter.name in self._declarations for parameter in parameters)
        return self._request if is_bound and not self._declaring else None

    def _put(self, declarations: Iterable[Declaration], values: Values) -> None:
        """Declare parameters on the node with their values."""
        declarations = list(declarations)
        if not declarations:
            return
        # Declared by type and set afterwards, because rclpy takes an empty list for bytes.
        with self._as_declaring():
            self._node.declare_parameters(
                "",
                [
                    (one.name, ros_type(one), descriptor_of(one, read_only=False))
                    for one in declarations
                ],
                ignore_override=True,
            )
            self._node.set_parameters_atomically(
                [ros_parameter(one, values[one.name]) for one in declarations]
            )

    @contextmanager
    def _as_declaring(self) -> Iterator[None]:
        """What is set meanwhile is no request."""
        self._declaring = True
        try:
            yield
        finally:
            self._declaring = False

    def _lock(self) -> None:
        """Make read-only what is declared so, once nothing awaits correction."""
        if self._locked or self.refused or not self._ready():
            return
        self._locked = True
        for name, declaration in self._declarations.items():
            if declaration.read_only:
                self._node.set_descriptor(name, descriptor_of(declaration, read_only=True))

    def _why_unknown(self, name: str, values: Values) -> str:
        for group in self._groups:
            if name in group.every:
                return group.why_unknown(name, values)
        every: Mapping[str, Declaration] = {}
        for group in self._groups:
            every = {**every, **group.every}
        close = [
            *difflib.get_close_matches(name, values, n=1),
            *difflib.get_close_matches(name, every, n=1),
        ]
        guess = f"did you mean '{close[0]}'?" if close else _known(values)
        return f"there is no parameter '{name}' ({guess})"


def _known(names: Collection[str]) -> str:
    """Which parameters there are, as far as that can be read."""
    if len(names) > _MOST_NAMED:
        return "`ros2 param list` and docs/parameters.md name those that there are"
    return f"there are: {', '.join(sorted(names))}"
