"""What statuses say of several targets, all together and one by one."""

from __future__ import annotations

from collections.abc import Sequence

from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.tracking.estimate import estimate_values
from pf_tracker_ros.tracking.state_descriptions import DESCRIPTIONS, SEVERITIES


def best_state(targets: Sequence[TrackedTarget]) -> str:
    """The state of the target that is seen best, `idle` without one."""
    states = {target.estimate.state for target in targets}
    return next((one for one in ("tracking", "occluded", "lost") if one in states), "idle")


def description(targets: Sequence[TrackedTarget]) -> str:
    """How all of them are, in words."""
    count = len(targets)
    if count < 2:
        return DESCRIPTIONS[best_state(targets)]
    unseen = sum(target.estimate.state != "tracking" for target in targets)
    return f"tracking {count} targets" + (f", {unseen} of them out of sight" if unseen else "")


def severity(target: TrackedTarget) -> int:
    """How bad the state of one of them is, as a level of diagnostic_msgs/DiagnosticStatus."""
    # One of several that is behind another is no fault.
    return SEVERITIES["tracking" if target.estimate.state == "occluded" else target.estimate.state]


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
