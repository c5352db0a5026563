"""What the node would have published of several targets, as a bag to play beside the recording."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from pf_tracker_ros.footage.bag_writing import MARKERS_TYPE, PARTICLES_TYPE, STATUS_TYPE, Status
from pf_tracker_ros.footage.bags import IMAGE_TYPE
from pf_tracker_ros.footage.markers import Outline
from pf_tracker_ros.overlay import target_color, target_text
from pf_tracker_ros.recordings.several import TrackedTargets
from pf_tracker_ros.recordings.topics import (
    ERROR,
    NODE,
    OVERLAY,
    PARTICLES,
    STATUS,
    TopicBag,
    Values,
)
from pf_tracker_ros.recordings.tracking import Tracked
from pf_tracker_ros.targets.statuses import description, severity, target_values
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.tracking.state_descriptions import DESCRIPTIONS, SEVERITIES

BOXES = f"{NODE}/boxes"
_WARN = 1


class SeveralTopicBag(TopicBag):
    """As `TopicBag`, of a node that follows several targets."""

    topics: ClassVar[Mapping[str, str]] = {
        BOXES: MARKERS_TYPE,
        STATUS: STATUS_TYPE,
        PARTICLES: PARTICLES_TYPE,
        OVERLAY: IMAGE_TYPE,
    }

    def _write_targets(self, tracked: Tracked, where: dict[str, Any]) -> None:
        assert isinstance(tracked, TrackedTargets)
        if tracked.state == "skipped":
            return
        stamp, targets = tracked.frame.stamp, tracked.targets
        present = [target for target in targets if target.estimate.state != "lost"]
        self._writer.write_outlines(BOXES, stamp, [_outline(target) for target in present], **where)
        if targets:
            estimates = [target.estimate for target in targets]
            self._writer.write_particles(
                PARTICLES,
                stamp,
                np.vstack([estimate.particle_boxes for estimate in estimates]),
                np.concatenate([estimate.weights for estimate in estimates]),
                ids=np.repeat(
                    [target.id for target in targets],
                    [len(estimate.weights) for estimate in estimates],
                ),
                **where,
            )

    def _statuses(self, tracked: Tracked) -> list[Status]:
        assert isinstance(tracked, TrackedTargets)
        level = ERROR if tracked.outcome == "refused" else SEVERITIES[self._last_state]
        problems = [tracked.problem] if tracked.problem else []
        problems += tracked.remarks
        if tracked.remarks:
            level = max(level, _WARN)
        text = "; ".join(problems) or description(tracked.targets)
        if tracked.state == "skipped" and not problems:
            text = f"not looked at: {tracked.outcome}"
        known: dict[str, str | float | int] = {}
        if tracked.state != "skipped":
            known = {"targets": len(tracked.targets), "detector_answers": tracked.heard}
        values = self._values(tracked, known, problems[-1] if problems else "")
        return [
            Status(NODE, level, text, values),
            *(_status(target) for target in tracked.targets),
        ]


def _status(target: TrackedTarget) -> Status:
    values: Values = target_values(target)
    text = DESCRIPTIONS[target.estimate.state]
    return Status(f"{NODE}: target {target.id}", severity(target), text, values)


def _outline(target: TrackedTarget) -> Outline:
    blue, green, red = (value / 255.0 for value in target_color(target.id))
    opacity = 1.0 if target.estimate.state == "tracking" else 0.5
    color = (red, green, blue, opacity)
    return Outline(target.id, target.estimate.box, target_text(target), color)
