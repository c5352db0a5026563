"""The log of a frame: refusals, time jumps, started targets, the ids of all and their states."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from pf_tracker_ros.node.tracker.reporter import LOG_INTERVAL, Throttle
from pf_tracker_ros.targets.session import Outcome
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.tracking.estimate import Estimate

# Seconds between log lines of a target that flickers; the next line has its state by then.
_INTERVAL = 1.0


class StateLog:
    """Logs state changes of the selected target, at most one a second, the last one always.

    A newly selected target counts as tracked before.

    Args:
        logger: Logger of the node.
    """

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self._id = 0
        self._logged_state = "tracking"
        self._logged_at = -_INTERVAL

    def update(self, id: int, estimate: Estimate) -> None:
        """Log the state after a frame if it differs from the last logged one."""
        if id != self._id:
            self._id, self._logged_state = id, "tracking"
        now = time.monotonic()
        if estimate.state == self._logged_state or now - self._logged_at < _INTERVAL:
            return
        self._logger.info(
            f"{self._logged_state} -> {estimate.state}, confidence {estimate.confidence:.2f}"
        )
        self._logged_state, self._logged_at = estimate.state, now


class TargetsLog:
    """Logs the list of targets when it changes, at most once a second, the last one always.

    Args:
        logger: Logger of the node.
    """

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self._logged_ids: tuple[int, ...] = ()
        self._logged_at = -_INTERVAL

    def update(self, targets: Sequence[TrackedTarget]) -> None:
        """Log the targets after a frame if their ids differ from the last logged ones."""
        now = time.monotonic()
        ids = tuple(target.id for target in targets)
        if ids == self._logged_ids or now - self._logged_at < _INTERVAL:
            return
        listed = ", ".join(f"{target.id} {target.label}".rstrip() for target in targets)
        self._logger.info(f"ids of the targets: {listed or 'none'}")
        self._logged_ids, self._logged_at = ids, now


class OutcomeLog:
    """Logs what the frames of a session change.

    Args:
        logger: Logger of the node.
        report: Called with each refusal.
    """

    def __init__(self, logger: Any, report: Callable[[str], None]) -> None:
        self._logger, self._report = logger, report
        self._throttle = Throttle()
        self._state_log, self._targets_log = StateLog(logger), TargetsLog(logger)

    def report_unrepeated(self, errors: Sequence[str]) -> None:
        """Report the errors that were not reported a moment ago."""
        for error in self._throttle.unrepeated(errors):
            self._report(error)

    def forget_targets(self) -> None:
        """Log that there are no targets any more."""
        self._targets_log.update(())

    def update(self, outcome: Outcome, time_jump: str, *, had_target: bool) -> None:
        """Log the outcome of a frame.

        Args:
            outcome: Of the frame.
            time_jump: The parameter of this name.
            had_target: Whether there was a target before.
        """
        for error in (*outcome.refused, *outcome.ended):
            self._report(error)
        self.report_unrepeated(outcome.rejected_detections)
        if outcome.jumped_back:
            self._log_time_jump(outcome, time_jump, had_target=had_target)
        for target in outcome.targets:
            if target.id in outcome.started:
                box = ", ".join(f"{value:g}" for value in target.estimate.box)
                self._logger.info(f"target {target.id} started on the box ({box})")
        self._targets_log.update(outcome.targets)
        if outcome.estimate:
            self._state_log.update(outcome.selected, outcome.estimate)

    def _log_time_jump(self, outcome: Outcome, choice: str, *, had_target: bool) -> None:
        """With advice where a target may be lost unasked."""
        text = f"time went back by {outcome.jumped_back:.3f} s"
        if choice == "restart" or outcome.frame == "started" or not had_target:
            self._logger.info(text, throttle_duration_sec=LOG_INTERVAL)
            return
        advice = "; use 'restart' for recordings that start again" if choice == "keep" else ""
        self._logger.warning(
            f"{text}; 'time_jump' is '{choice}'{advice}", throttle_duration_sec=LOG_INTERVAL
        )
