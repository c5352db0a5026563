"""A single target: its session, what is published of it, and what the log tells."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial
from typing import Any

from numpy.typing import NDArray
from rclpy.node import Node
from std_msgs.msg import Header

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.node.message_building import likelihood_values
from pf_tracker_ros.node.parameter_group import Values
from pf_tracker_ros.node.qos import Report
from pf_tracker_ros.node.tracker.following import Followed, Known, show_nothing
from pf_tracker_ros.node.tracker.outputs import Outputs
from pf_tracker_ros.node.tracker.session_settings import set_up
from pf_tracker_ros.node.tracker.skipped_frames import SKIPPED
from pf_tracker_ros.node.tracker.state_log import StateLog
from pf_tracker_ros.parameters import ParameterError, declarations
from pf_tracker_ros.stamps import stamp_of
from pf_tracker_ros.tracking.estimate import estimate_values
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PresetInForce, preset_parameters
from pf_tracker_ros.tracking.session import Outcome, Session
from pf_tracker_ros.tracking.state_descriptions import DESCRIPTIONS


class OneTarget:
    """Follows one target; see `Following`.

    Args:
        logger: Of the node.
    """

    tunables = TrackerParameters
    kept: Collection[str] = ()

    def __init__(self, logger: Any) -> None:
        self._log = logger
        self._states = StateLog(logger)
        self._session: Session | None = None
        self._outputs: Outputs | None = None
        self._likelihood: LikelihoodMap | None = None

    def usual(self, preset: str) -> Values:  # noqa: D102
        return preset_parameters(preset)

    def preset(self, values: Values) -> PresetInForce:  # noqa: D102
        return PresetInForce.of(values)

    @property
    def is_ready(self) -> bool:  # noqa: D102
        return self._session is not None

    def check(self, values: Values) -> None:  # noqa: D102
        _check_alone(values)
        if self._session:
            self._session.check(_of_tracker(values), values["seed"])
        else:
            Session(_of_tracker(values), values["seed"])

    def configure(self, values: Values) -> None:  # noqa: D102
        _check_alone(values)
        if self._session:
            self._session.configure(_of_tracker(values), values["seed"])
        else:
            self._session = Session(_of_tracker(values), values["seed"])
        set_up(self._session, values)

    def forget(self) -> None:  # noqa: D102
        self._session = None

    def advertise(self, node: Node, report: Report) -> None:  # noqa: D102
        self._outputs = Outputs(node, report)

    def subscribe(self, node: Node, report: Report) -> None:
        """Images and targets are all that it listens to."""

    def unsubscribe(self) -> None:
        """Images and targets are all that it listens to."""

    def close(self) -> None:  # noqa: D102
        if self._outputs:
            self._outputs.close()
            self._outputs = None

    def request(self, box: Box, stamp: int) -> None:  # noqa: D102
        if self._session:
            self._session.request(box, stamp)

    def withdraw(self) -> None:  # noqa: D102
        if self._session:
            self._session.withdraw()

    def stop(self) -> str:  # noqa: D102
        had_target = self._session is not None and self._session.estimate is not None
        if self._session:
            self._session.stop()
        self._states.forget()
        return "stopped; waiting for a target" if had_target else "there was no target"

    def begin_frame(self) -> None:  # noqa: D102
        self._likelihood = None

    def process(  # noqa: D102
        self, read: Callable[[], NDArray[Any]], header: Header
    ) -> Followed:
        if self._session:
            outcome = self._session.process_unread(read, stamp_of(header))
        else:
            read()
            outcome = Outcome("waiting", None)
        self._log_progress(outcome)
        show = show_nothing
        if self._outputs and outcome.frame not in SKIPPED:
            self._outputs.publish(header, outcome.estimate)
            show = partial(self._outputs.show, read(), header, outcome.estimate)
            if self._session and self._outputs.wants_likelihood:
                self._likelihood = self._session.map_likelihood()
            if self._likelihood:
                self._outputs.publish_likelihood(self._likelihood, header)
        errors = (outcome.refused_target,) if outcome.refused_target else ()
        return Followed(outcome.frame, errors, outcome.jumped_back, show)

    def pass_over(self, stamp: int) -> None:  # noqa: D102
        if self._session:
            self._session.pass_over(stamp)

    def _log_progress(self, outcome: Outcome) -> None:
        if outcome.estimate is None:
            return
        if outcome.frame == "started":
            box = ", ".join(f"{value:g}" for value in outcome.estimate.box)
            self._log.info(f"tracking a target from the box ({box}) on")
            self._states.forget()
        self._states.tell(outcome.estimate)

    @property
    def known(self) -> Known:  # noqa: D102
        session = self._session
        estimate = session.estimate if session else None
        state = estimate.state if estimate else "idle"
        return Known(
            state,
            DESCRIPTIONS[state],
            estimate_values(estimate) if estimate else {},
            likelihood_values(self._likelihood) if self._likelihood else {},
            session.requested_stamp if session else None,
        )


def _of_tracker(values: Values) -> dict[str, Any]:
    return {name: values[name] for name in declarations(TrackerParameters)}


def _check_alone(values: Values) -> None:
    """Refuse what asks for several targets."""
    if values["built_in_detector"] != "none":
        raise ParameterError(
            f"parameter 'built_in_detector' is '{values['built_in_detector']}', which starts "
            "targets by itself; allowed: 'none', or start the node with 'max_targets' above 1"
        )
