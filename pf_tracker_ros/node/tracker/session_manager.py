"""The tracking session and the built-in detector of a configured node."""

from __future__ import annotations

from typing import Any, NamedTuple

from pf_tracker_ros.foreign_code import ForeignError
from pf_tracker_ros.node.parameter_group import ParameterValues
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import build, declarations
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.built_in_detectors import DETECTORS, Detector, DetectorThread
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.frame_clock import TimePolicy
from pf_tracker_ros.tracking.parameters import TrackerParameters


class _DetectorChoice(NamedTuple):
    """The built-in detector that the parameters choose.

    Attributes:
        name: A key of `DETECTORS`, or "none".
        parameters: Its group of tunables.
        rate: Maximum number of frames in a second.
    """

    name: str = "none"
    parameters: Any = None
    rate: float = 0.0

    @classmethod
    def of(cls, values: ParameterValues) -> _DetectorChoice:
        """The choice by the values of all parameters of the node."""
        node = build(NodeParameters, {name: values[name] for name in declarations(NodeParameters)})
        name = node.built_in_detector
        return cls(name, node.detector_parameters.get(name), node.built_in_detector_rate)

    def make(self) -> Detector | None:
        """The detector, None for "none".

        Raises:
            ValueError: It cannot be created on this machine.
        """
        if self.name == "none":
            return None
        try:
            return DETECTORS.make(self.name, self.parameters)
        except Exception as error:
            # A missing library or model must not end the node.
            raise ValueError(
                f"the built-in detector {self.name!r} cannot be created: {error}; set "
                "'built_in_detector' to another one or to 'none'"
            ) from error


class SessionManager:
    """Creates, configures and ends the session and the built-in detector.

    Attributes:
        session: None before the first valid configuration.
        detector_thread: None without a built-in detector.
    """

    def __init__(self) -> None:
        self.session: Session | None = None
        self.detector_thread: DetectorThread | None = None
        self._choice = _DetectorChoice()

    def check(self, values: ParameterValues) -> None:
        """Check parameters as `configure` does, without a change.

        Raises:
            ValueError: As `configure`.
        """
        if self.session:
            self.session.check(_tracker_values(values), values["seed"])
        else:
            Session(_tracker_values(values), values["seed"])
        choice = _DetectorChoice.of(values)
        if choice[:2] != self._choice[:2]:
            choice.make()

    def configure(self, values: ParameterValues) -> None:
        """Apply parameters; creates the session and the detector as needed.

        Args:
            values: Full name to value of all parameters.

        Raises:
            ValueError: They are invalid; nothing changes then.
        """
        choice = _DetectorChoice.of(values)
        # First, because it may fail: a refused request changes nothing.
        detector = choice.make() if choice != self._choice else None
        if self.session:
            self.session.configure(_tracker_values(values), values["seed"])
        else:
            self.session = Session(_tracker_values(values), values["seed"])
        threshold = round(values["time_jump_threshold"] * NANOSECONDS)
        self.session.time_policy = TimePolicy(values["time_jump"], threshold)
        self.session.frozen_after = values["frozen_after"]
        self.session.frame_buffer.limit(
            values["frame_buffer_length"], values["frame_buffer_megabytes"]
        )
        if choice != self._choice:
            self._close_detector()
            self.detector_thread = DetectorThread(detector, choice.rate) if detector else None
            self._choice = choice

    def forget(self) -> None:
        """End the session and the detector."""
        self._close_detector()
        self.session = None

    def stop(self) -> str:
        """Stop all targets; returns the result as a sentence."""
        count = len(self.session.targets) if self.session else 0
        if self.session:
            self.session.stop()
        if count == 0:
            return "no target to stop"
        return f"stopped {counted(count, 'target')}; waiting for a target"

    def take_detections(self) -> tuple[str, ...]:
        """Pass the built-in detector's new detections to the session; returns its errors."""
        if self.detector_thread is None or self.session is None:
            return ()
        try:
            found = self.detector_thread.take()
        except ForeignError as error:
            # The present frame is processed all the same.
            return (f"the detector '{self._choice.name}' failed: {error}",)
        try:
            if found:
                self.session.add_detections(*found)
        except ValueError as error:
            return (f"detections refused: {error}",)
        return ()

    def skip(self, stamp: int) -> None:
        """Advance the clock by a skipped frame; `stamp` in nanoseconds."""
        if self.session:
            self.session.skip(stamp)
        if self.detector_thread:
            self.detector_thread.discard_pending()

    def _close_detector(self) -> None:
        if self.detector_thread:
            self.detector_thread.close()
        self.detector_thread, self._choice = None, _DetectorChoice()


def _tracker_values(values: ParameterValues) -> dict[str, Any]:
    return {name: values[name] for name in declarations(TrackerParameters)}
