"""What a run was worth: the rows of its frames, and the figures that follow from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from tracking_runs import spans

from follow_parts.loop import Moment
from follow_parts.robot import Pose2D
from follow_parts.world import INTERVAL
from pf_tracker_ros.boxes import Box, iou

Array = NDArray[np.float64]

# Frames from this time on count, seconds.
_FROM = 2.0
# Share of a person from which they are visible, and that below which they are hidden; in between
# they are what they were.
_VISIBLE, _HIDDEN = 0.5, 0.3
# Least IoU of a box that is on somebody, and on somebody else than the right person.
_ON, _ON_OTHER = 0.2, 0.3
# Error from which a pose is off, meters; duration from which a target is astray, seconds.
OFF, ASTRAY = 0.7, 1.0
# Durations, seconds: a short occlusion, an absence, and within which somebody is taken back.
_SHORT, _ABSENT, _BACK = 1.0, 2.0, 2.0
_NEAR, _FAR = 1.5, 3.0
# Seconds after which somebody who stands does so for the velocity, too.
_STANDS_AFTER = 1.0


@dataclass(frozen=True, eq=False)
class Row:
    """A frame of a run. Meters, seconds, pixels; nan where there is nothing."""

    time: float  # since the start
    distance: float  # from the robot to the person
    visible: float  # share of the person that is seen, 0 to 1
    state: str  # of the selected target
    confidence: float  # of it
    box: Box | None  # of it
    true_box: Box | None  # of the person, inside the image, as if nothing were in front
    own: float  # IoU of the two
    other: float  # largest IoU of the box with somebody else who is seen
    person: Array  # (2,) in the room
    robot: Pose2D  # in the room
    said: Array  # (2,) of the pose, in the room
    said_distance: float  # from the robot to the pose
    measured_distance: float  # from the robot to the unfiltered position
    nees: float  # of the pose over its two degrees of freedom
    velocity: Array  # (2,) of the person, m/s, in the room
    said_velocity: Array  # (2,) of the pose, m/s, in the frame of the odometry
    stands_for: float  # how long the person has been standing

    @property
    def is_right(self) -> bool:
        """Whether the box is on the right person."""
        return self.own >= _ON and self.own >= self.other

    @property
    def is_on_other(self) -> bool:
        """Whether somebody else is tracked."""
        return self.state == "tracking" and self.other >= _ON_OTHER and self.own < _ON

    @property
    def error(self) -> float:
        """Of the pose, meters; nan without."""
        return math.hypot(*(self.said - self.person))


def row_of(moment: Moment) -> Row:
    """The row of a moment."""
    truth, report = moment.truth, moment.report
    person, people = truth.positions[0], truth.view.people
    said = measured = np.full(2, np.nan)
    nees = math.nan
    robot = truth.robot.position
    if report.measured is not None:
        measured = truth.in_room(report.measured)
    if report.position is not None and report.covariance is not None:
        said = truth.in_room(report.position)
        error = report.position - truth.in_odometry(person)
        nees = float(error @ np.linalg.solve(report.covariance, error)) / 2.0
    own_box, own, other = people[0].box_in_image, 0.0, 0.0
    if report.box:
        box = np.array(report.box)
        own = float(iou(box, np.array(own_box))) if own_box else 0.0
        seen = [one.box_in_image for one in people[1:] if one.shown >= _HIDDEN]
        other = max((float(iou(box, np.array(one))) for one in seen if one), default=0.0)
    return Row(
        time=truth.time,
        distance=float(np.hypot(*(person - robot))),
        visible=people[0].shown,
        state=report.state,
        confidence=report.confidence,
        box=report.box,
        true_box=own_box,
        own=own,
        other=other,
        person=person,
        robot=truth.robot,
        said=said,
        said_distance=float(np.hypot(*(said - robot))),
        measured_distance=float(np.hypot(*(measured - robot))),
        nees=nees,
        velocity=truth.velocity,
        said_velocity=np.full(2, np.nan) if report.velocity is None else report.velocity,
        stands_for=truth.stands_for,
    )


def visibility(shares: Array) -> NDArray[np.bool_]:
    """Whether somebody is visible in each frame, from the shares that are seen."""
    visible, flags = True, []
    for share in shares.tolist():
        visible = share >= (_HIDDEN if visible else _VISIBLE)
        flags.append(visible)
    return np.array(flags, bool)


def figures(rows: Sequence[Row], interval: float = INTERVAL) -> dict[str, float]:
    """The figures of a run by name, from all frames; nan where there is nothing to count."""
    kept = [row for row in rows if row.time >= _FROM - 1e-6]
    errors = np.array([row.error for row in kept])
    posed = np.isfinite(errors)
    visible = visibility(np.array([row.visible for row in kept]))
    right = np.array([row.is_right for row in kept])
    distance = np.array([row.distance for row in kept])
    astray = [
        (end - begin) * interval
        for begin, end in spans([row.is_on_other for row in kept])
        if (end - begin) * interval > ASTRAY
    ]
    silences = [(end - begin) * interval for begin, end in spans(~posed)]
    near = posed & (errors <= OFF)
    said = np.array([row.said_distance for row in kept])
    measured = np.array([row.measured_distance for row in kept])
    both = near & np.isfinite(measured)
    return {
        "right": _mean(right[visible]),
        "pose": _mean(posed[visible]),
        "off": _mean(~near[posed]),
        "kept": _mean((distance >= _NEAR) & (distance <= _FAR)),
        "astray": float(sum(astray)),
        "silence": max(silences, default=0.0),
        **_returns(visible, near, interval),
        **_standing(kept, posed, interval),
        "rms": _rms((said - distance)[near]),
        "raw_rms": _rms((measured - distance)[both]),
        "lag": _lag(kept, near),
        "nees": _mean(np.array([row.nees for row in kept])[posed]),
    }


def _returns(
    visible: NDArray[np.bool_], posed: NDArray[np.bool_], interval: float
) -> dict[str, float]:
    """Times from the end of each occlusion to the first right pose."""
    short: list[float] = []
    long: list[float] = []
    back: list[bool] = []
    for begin, end in spans(~visible):
        again = np.flatnonzero(posed[end:])
        # Without a pose until the end of the run, it takes at least so long.
        time = interval * float(again[0] if len(again) else len(visible) - end)
        if not len(again) and time < _BACK:
            continue
        duration = (end - begin) * interval
        (short if duration < _SHORT else long).append(time)
        if duration >= _ABSENT:
            back.append(time <= _BACK)
    return {
        "first_50": _quantile(short, 0.5),
        "first_90": _quantile(short, 0.9),
        "late_50": _quantile(long, 0.5),
        "late_90": _quantile(long, 0.9),
        "back": _mean(np.array(back)),
    }


def _standing(rows: Sequence[Row], posed: NDArray[np.bool_], interval: float) -> dict[str, float]:
    """Speed and acceleration of the pose while the person stands."""
    speeds = np.array([row.said_velocity for row in rows]).reshape(-1, 2)
    stands = np.array([row.stands_for > _STANDS_AFTER for row in rows], bool) & posed
    changes = np.diff(speeds, axis=0)[stands[1:] & stands[:-1]] / interval
    return {
        "stands_speed": _quantile(np.hypot(*speeds[stands].T), 0.95),
        "stands_acceleration": _quantile(np.hypot(*changes.T), 0.95),
    }


def _lag(rows: Sequence[Row], posed: NDArray[np.bool_]) -> float:
    """Seconds by which the pose is late, by its error along the velocity."""
    velocity = np.array([row.velocity for row in rows]).reshape(-1, 2)[posed]
    error = np.array([row.said - row.person for row in rows]).reshape(-1, 2)
    moved = float((velocity**2).sum())
    return -float((error[posed] * velocity).sum()) / moved if moved > 0.0 else math.nan


def _mean(values: NDArray[np.bool_] | Array) -> float:
    return float(np.mean(values)) if len(values) else math.nan


def _rms(values: Array) -> float:
    return math.sqrt(_mean(values**2)) if len(values) else math.nan


def _quantile(values: Sequence[float] | Array, share: float) -> float:
    # An observed value, as some are infinite.
    return float(np.quantile(values, share, method="higher")) if len(values) else math.nan
