"""A reported target, and the status values of targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pf_tracker_ros.tracking.estimate import DESCRIPTIONS, SEVERITIES, Estimate, estimate_values


@dataclass(frozen=True)
class TrackedTarget:
    """A target in one frame; immutable.

    Attributes:
        id: From 1, never reused.
        label: Its most frequent label, by detections or a user; an empty text without any.
        estimate: Its state is "occluded" also if another target is in front of it.
        age: Seconds since it started.
        unconfirmed_for: Seconds since its last detection, or since it started.

    Example:
        >>> import numpy as np
        >>> from pf_tracker_ros import MultiTracker
        >>> image = np.random.default_rng(1).integers(0, 256, (120, 160), np.uint8)
        >>> tracker = MultiTracker.from_preset("default", seed=0)
        >>> tracker.start(image, (60, 40, 40, 30), label="car")
        1
        >>> for _ in range(5):
        ...     (target,) = tracker.update(image, dt=0.1)
        >>> target.id, target.label, round(target.age, 1), round(target.unconfirmed_for, 1)
        (1, 'car', 0.5, 0.5)
    """

    id: int
    label: str
    estimate: Estimate
    age: float
    unconfirmed_for: float


def overall_state(targets: Sequence[TrackedTarget], selected: int) -> str:
    """The state of the selected target, "lost" if it has ended; else the best of all targets.

    "idle" without any target. The id of the selected one is 0 for none.
    """
    states = {target.estimate.state for target in targets if selected in (0, target.id)}
    best = next((one for one in ("tracking", "occluded", "lost") if one in states), "idle")
    return "lost" if selected and best == "idle" else best


def description(targets: Sequence[TrackedTarget], selected: int) -> str:
    """The state of all targets in words; arguments as for `overall_state`."""
    count = len(targets)
    if selected or count < 2:
        return DESCRIPTIONS[overall_state(targets, selected)]
    unseen = sum(target.estimate.state != "tracking" for target in targets)
    return f"tracking {count} targets" + (f", {unseen} of them out of sight" if unseen else "")


def severity(target: TrackedTarget) -> int:
    """The state of one of several targets as a level of diagnostic_msgs/DiagnosticStatus."""
    # A target behind another one is no fault.
    return SEVERITIES["tracking" if target.estimate.state == "occluded" else target.estimate.state]


def common_values(
    targets: Sequence[TrackedTarget], selected: int, detector_runs: int, estimate: Estimate | None
) -> dict[str, str | float | int]:
    """The status values of all targets together and of the selected one, by status key."""
    values: dict[str, str | float | int] = {
        "targets": len(targets),
        "selected": selected,
        "detector_runs": detector_runs,
    }
    return values | (estimate_values(estimate) if estimate else {})


def target_values(target: TrackedTarget) -> dict[str, str | float | int]:
    """The status values of one target, by status key."""
    values: dict[str, str | float | int] = {
        "id": target.id,
        "label": target.label,
        "state": target.estimate.state,
        "age": round(target.age, 3),
        "unconfirmed_for": round(target.unconfirmed_for, 3),
    }
    return values | estimate_values(target.estimate)
