"""Declared parameters as parameters of a ROS node.

A `ParameterBinding` declares them with their descriptors, checks the values given at start-up, and
follows changes at run time. An invalid value at start-up does not end the node: it is reported and
listed in `ParameterBinding.refused`, and the parameter has its default until it is corrected.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from pf_tracker_ros.node.parameter_group import (
    ParameterGroup,
    ParameterValues,
    Request,
    ResetCondition,
    descriptor_of,
    ros_parameter,
    ros_type,
)
from pf_tracker_ros.parameters import Declaration

# With more parameters a message refers to the documentation.
_MAX_NAMED = 12


class NoSuchParameter(ParameterNotDeclaredException):
    """A request names unknown parameters.

    Args:
        reason: The message, complete.
    """

    def __init__(self, reason: str) -> None:
        # Not rclpy's constructor, whose message has names only.
        Exception.__init__(self, reason)


class ParameterBinding:
    """Binds declarations to the parameters of a node.

    Call `declare` for each group, then `listen` once to follow changes at run time. From then on
    read-only parameters are fixed, as soon as all invalid values are corrected.

    Attributes:
        values: Full name to checked value, in the declared type. Parameters refused at start-up
            have their default.
        refused: Full name to reason of parameters refused at start-up and not corrected since.

    Args:
        node: The node of the parameters.
        report: Called with a sentence for each refused or unknown parameter; by default the node's
            error log.
    """

    def __init__(self, node: Node, report: Callable[[str], None] | None = None) -> None:
        self.values: dict[str, Any] = {}
        self.refused: dict[str, str] = {}
        self._node = node
        self._report = report or node.get_logger().error
        self._groups: list[ParameterGroup] = []
        self._declarations: dict[str, Declaration] = {}
        # rclpy has no public access to an override before its declaration, which raises for a value
        # of another type without naming it.
        self._overrides: dict[str, Parameter] = dict(node._parameter_overrides)
        self._superseded: set[str] = set()
        self._locked = False
        self._request: Request | None = None
        self._check: Callable[[ParameterValues], None] = lambda values: None
        self._apply: Callable[[ParameterValues], None] = lambda changes: None
        self._ready: Callable[[], bool] = lambda: True

    def declare(
        self,
        group_type: type,
        *,
        defaults: Callable[[ParameterValues], ParameterValues] | None = None,
        reset_by: Mapping[str, ResetCondition] | None = None,
        kept: Collection[str] = (),
        superseded: Collection[str] = (),
        keeps_read_only: bool = True,
    ) -> None:
        """Declare the parameters of a group on the node; the user's values override the defaults.

        Parameters of earlier groups are not declared again. An int is valid for a float and an
        empty list for any list.

        Args:
            group_type: A frozen dataclass as for `pf_tracker_ros.parameters.declarations`.
            defaults: Computes defaults from the values of earlier groups, full name to value, in
                place of the declared ones; other names are ignored.
            reset_by: Full name of a parameter of an earlier group to the condition under which a
                change of it resets this group to `defaults`.
            kept: Full names of parameters that are not reset.
            superseded: Full names whose values at start-up are ignored.
            keeps_read_only: Whether declared read-only parameters are so on the node; false for a
                group that is reset.
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
        request = Request(self.values)
        group.read(given, {}, request)
        for reason in request.invalid.values():
            self._report(reason)
        self.refused |= request.invalid
        self._superseded |= group.declarations.keys() & superseded
        self._groups.append(group)
        self._declarations |= group.declarations
        # Declared by type and set afterwards, because rclpy reads an empty list as bytes.
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
        check: Callable[[ParameterValues], None] | None = None,
        apply: Callable[[ParameterValues], None] | None = None,
        ready: Callable[[], bool] | None = None,
    ) -> None:
        """Follow changes at run time, and report unknown parameters given at start-up.

        Args:
            check: Called with all values after a request; raises ValueError to refuse it. It must
                not change anything.
            apply: Called with the changed values, requested and reset, once `values` has them.
            ready: Whether the node has started; until then read-only parameters can change.
        """
        self._check = check or self._check
        self._apply = apply or self._apply
        self._ready = ready or self._ready
        self._node.add_pre_set_parameters_callback(self._convert)
        self._node.add_on_set_parameters_callback(self._validate)
        self._node.add_post_set_parameters_callback(self._store)
        self._serve_atomic_requests()
        self._lock()
        reported = self.refused.keys() | self._superseded
        for name in self._overrides:
            is_foreign = self._node.has_parameter(name) or name.startswith("qos_overrides.")
            if name not in reported and not is_foreign:
                self._report(f"{self._why_unknown(name)}; it has no effect")

    def _serve_atomic_requests(self) -> None:
        """Make the service `set_parameters` apply a request as a whole, where possible.

        rclpy sets the parameters one by one in their order. Values that are valid together could be
        refused, and a parameter that resets others would undo earlier ones. Here:

        1. A read-only parameter with its present value is accepted, so that the file of
           `ros2 param dump` can be loaded.
        2. Invalid and unknown parameters are refused individually.
        3. The rest is set as a whole; if that is refused, one by one, parameters that reset others
           first.
        """
        service = next(s for s in self._node.services if s.srv_name.endswith("/set_parameters"))
        set_one_by_one: Any = service.callback

        def on_request(request: Any, response: Any) -> Any:
            messages = list(request.parameters)
            given = [Parameter.from_parameter_msg(one) for one in messages]
            results = [SetParametersResult(successful=True) for _ in given]
            changes = [i for i, one in enumerate(given) if not self._is_unchanged_read_only(one)]
            faults = self._faults([given[index] for index in changes])
            for index in changes:
                if reason := faults.get(given[index].name):
                    results[index] = SetParametersResult(successful=False, reason=reason)
            changes = [index for index in changes if given[index].name not in faults]
            if len(changes) < 2 or not self._set_as_a_whole([given[index] for index in changes]):
                changes.sort(key=lambda index: not self._resets_others(given[index].name))
                request.parameters = [messages[index] for index in changes]
                one_by_one = set_one_by_one(request, response).results
                for index, result in zip(changes, one_by_one, strict=True):
                    results[index] = result
            response.results = results
            return response

        service.callback = on_request

    def _is_unchanged_read_only(self, given: Parameter) -> bool:
        """Whether a parameter is read-only and requested with its present value."""
        name, node = given.name, self._node
        if not node.has_parameter(name) or not node.describe_parameter(name).read_only:
            return False
        present = node.get_parameter(name)
        return bool(present.get_parameter_value() == given.get_parameter_value())

    def _set_as_a_whole(self, given: list[Parameter]) -> bool:
        try:
            return bool(self._node.set_parameters_atomically(given).successful)
        except ParameterNotDeclaredException:
            return False

    def _faults(self, parameters: Sequence[Parameter]) -> dict[str, str]:
        """Report the unknown and invalid ones of the parameters to set: full name to reason."""
        request = self._read(parameters)
        faults = request.unknown | request.invalid
        for reason in faults.values():
            self._report(reason)
        return faults

    def _resets_others(self, name: str) -> bool:
        """Whether a parameter resets others, so that it has to be set first."""
        return any(name in group.reset_by for group in self._groups)

    def _convert(self, parameters: list[Parameter]) -> list[Parameter]:
        """Convert each value to its declared type, and add reset parameters.

        An invalid value is replaced by the present one, for `_validate` to refuse it: the messages
        of rclpy do not always name the parameter.
        """
        self._request = request = self._read(parameters)
        reasons = [*request.unknown.values(), *request.invalid.values()]
        for reason in reasons:
            self._report(reason)
        if request.unknown:
            raise NoSuchParameter("; ".join(reasons))
        foreign = [one for one in parameters if one.name not in self._declarations]
        values = request.changes | {name: self.values[name] for name in request.invalid}
        bound = [ros_parameter(self._declarations[name], value) for name, value in values.items()]
        return foreign + bound

    def _read(self, parameters: Sequence[Parameter]) -> Request:
        request = Request()
        given = {parameter.name: parameter for parameter in parameters}
        for group in self._groups:
            is_reset = group.is_reset(self.values, request.changes)
            unchanged = group.kept if is_reset else group.declarations
            group.read(given, {name: self.values[name] for name in unchanged}, request)
        for name in given:
            declaration = self._declarations.get(name)
            if declaration and declaration.read_only and self._locked:
                request.invalid[name] = (
                    f"parameter '{name}' is read-only while the node runs; set it at start-up"
                )
            if not self._node.has_parameter(name):
                request.unknown[name] = self._why_unknown(name)
        return request

    def _validate(self, parameters: list[Parameter]) -> SetParametersResult:
        request = self._request_of(parameters)
        if request is None:
            return SetParametersResult(successful=True)
        if request.invalid:
            return SetParametersResult(successful=False, reason="; ".join(request.invalid.values()))
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

    def _request_of(self, parameters: Iterable[Parameter]) -> Request | None:
        """The request of these parameters, None without any of this binding."""
        is_bound = any(parameter.name in self._declarations for parameter in parameters)
        return self._request if is_bound else None

    def _lock(self) -> None:
        """Fix the read-only parameters, once all invalid values are corrected."""
        if self._locked or self.refused or not self._ready():
            return
        self._locked = True
        for name, declaration in self._declarations.items():
            if declaration.read_only:
                self._node.set_descriptor(name, descriptor_of(declaration, read_only=True))

    def _why_unknown(self, name: str) -> str:
        close = difflib.get_close_matches(name, self._declarations, n=1)
        guess = f"did you mean '{close[0]}'?" if close else _known(self._declarations)
        return f"no parameter '{name}' ({guess})"


def _known(names: Collection[str]) -> str:
    """The names of all parameters, or where to find them."""
    if len(names) > _MAX_NAMED:
        return "see `ros2 param list` or docs/parameters.md"
    return f"there are: {', '.join(sorted(names))}"
