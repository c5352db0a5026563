"""What is told of a target, and what statuses say of all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pf_tracker_ros.tracking.estimate import DESCRIPTIONS, SEVERITIES, Estimate, estimate_values


@dataclass(frozen=True)
class TrackedTarget:
    """One of several targets in one frame, a value.

    Attributes:
        id: Its own from 1 on, never that of another.
        label: What it was called most, by the detector or by hand; an empty text if nothing.
        estimate: Where it is, as for a single target. Its state is "occluded" also where another
            target is in front of it.
        age: Seconds since it began.
        unconfirmed_for: Seconds since a detection last confirmed it, or since it was started.
    """

    id: int
    label: str
    estimate: Estimate
    age: float
    unconfirmed_for: float


def overall_state(targets: Sequence[TrackedTarget], selected: int) -> str:
    """The state of the selected target, lost if it is gone; without one of that seen best.

    `idle` where there is none.

    Args:
        targets: All that there are.
        selected: Id, 0 for none.
    """
    states = {target.estimate.state for target in targets if selected in (0, target.id)}
    best = next((one for one in ("tracking", "occluded", "lost") if one in states), "idle")
    return "lost" if selected and best == "idle" else best


def description(targets: Sequence[TrackedTarget], selected: int) -> str:
    """How all of them are, in words; arguments as of `overall_state`."""
    count = len(targets)
    if selected or count < 2:
        return DESCRIPTIONS[overall_state(targets, selected)]
    unseen = sum(target.estimate.state != "tracking" for target in targets)
    return f"tracking {count} targets" + (f", {unseen} of them out of sight" if unseen else "")


def severity(target: TrackedTarget) -> int:
    """How bad the state of one of them is, as a level of diagnostic_msgs/DiagnosticStatus."""
    # One of several that is behind another is no fault.
    return SEVERITIES["tracking" if target.estimate.state == "occluded" else target.estimate.state]


def common_values(
    targets: Sequence[TrackedTarget], selected: int, detector_runs: int, estimate: Estimate | None
) -> dict[str, str | float | int]:
    """What is known of them together and of the selected one, under the keys of the status.

    Args:
        targets: All that there are.
        selected: Id, 0 for none.
        detector_runs: Number of the answers of detectors so far.
        estimate: Of the selected target; None where there is none.
    """
    values: dict[str, str | float | int] = {
        "targets": len(targets),
        "selected": selected,
        "detector_runs": detector_runs,
    }
    return values | (estimate_values(estimate) if estimate else {})


def target_values(target: TrackedTarget) -> dict[str, str | float | int]:
    """What is known of one of them, under the keys that the status uses."""
    values: dict[str, str | float | int] = {
        "id": target.id,
        "label": target.label,
        "state": target.estimate.state,
        "age": round(target.age, 3),
        "unconfirmed_for": round(target.unconfirmed_for, 3),
    }
    return values | estimate_values(target.estimate)
