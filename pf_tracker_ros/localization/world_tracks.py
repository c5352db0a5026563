"""Positions of the tracker's targets over time, without ROS: one filter for each target."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import is_truncated
from pf_tracker_ros.localization.box_errors import BoxErrors
from pf_tracker_ros.localization.camera_pose import CameraPose
from pf_tracker_ros.localization.expected_boxes import expected_box, standing
from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.localization.tracker_frame import ReportedTarget, TrackerFrame
from pf_tracker_ros.localization.trust import LEAST_LOG_ODDS, Trust, log_odds_by_place
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.tracking.hints import Hint
from pf_tracker_ros.world import (
    METHODS,
    Bearing,
    CameraModel,
    FilteredPosition,
    Localizer,
    Place,
    PositionFilter,
    in_fixed_frame,
)
from pf_tracker_ros.world_messages import UNKNOWN_ANGLE, WorldTarget

# Times after which half of a box's errors correlate by 1/e, seconds. Those of a tracker last longer
# than those of a detector: each box depends on the one before.
_CORRELATION_TIMES = 0.3, 5.0
# Seconds for which somebody stands on average.
_STANDS_FOR = 6.0
# Least speed, m/s, and its squared distance from 0 in standard deviations (99 % of two
# dimensions), from which a target has a heading.
_MIN_SPEED, _MIN_SPEED_DISTANCE = 0.2, -2.0 * math.log(0.01)
# Share of each measurement in the height of a target.
_HEIGHT_RATE = 0.1
# What a box with absurd numbers raises; the other targets are still located.
_UNUSABLE = ValueError, ArithmeticError


@dataclass(frozen=True, eq=False)
class Sensed:
    """What the sensors say at a frame.

    Attributes:
        camera: The calibration.
        pose: Where the camera is.
        depth: Depth image as for `Localizer.locate`; None without.
        depth_offset: Its stamp relative to the image's, seconds; None without.
        probability: (rows, columns) probability that a pixel in the selected target's box is its
            own; None where that is unknown.
    """

    camera: CameraModel
    pose: CameraPose
    depth: NDArray[Any] | None = None
    depth_offset: float | None = None
    probability: NDArray[np.float64] | None = None


@dataclass(frozen=True, eq=False)
class LocatedTarget:
    """A target after a frame.

    Attributes:
        reported: As the tracker reported it.
        bearing: Direction of the box in camera coordinates; None where there is none.
        place: The measurement of this frame; None without.
        world: Position and velocity; None without a recent measurement.
        normalized_innovation: Squared, of the measurement; None without.
        rejected_for: Seconds for which measurements are outside of the gate; None if the last one
            was not.
        covered_share: Share, 0 to 1, of the box that something in front of the target covers; None
            where that is unknown.
        hint: What the tracker may take of all this.
        problem: Why this frame has no measurement that was used; empty if it has.
        doubt: Why it may be something else than before; empty if there is no reason.
        predicted_for: Seconds since the last measurement without a doubt; infinite without one.
        coasts: Whether the prediction stands for the target in this frame: it has no measurement
            without a doubt, and `predicted_for` is at most `coast`.
    """

    reported: ReportedTarget
    bearing: Bearing | None
    place: Place | None
    world: WorldTarget | None
    normalized_innovation: float | None
    rejected_for: float | None
    covered_share: float | None
    hint: Hint
    problem: str
    doubt: str
    predicted_for: float
    coasts: bool

    @property
    def silence(self) -> str:
        """Why a robot gets no pose of it; empty if it does."""
        if self.world is not None and (self.coasts or self.predicted_for == 0.0):
            return ""
        return self.problem or self.doubt or f"target {self.reported.id} has no position"

    @property
    def has_bearing(self) -> bool:
        """Whether a robot may turn by its direction: it is tracked, without a doubt."""
        return self.bearing is not None and self.reported.state == "tracking" and not self.doubt


class WorldTracks:
    """Keeps a filter for each target of the tracker."""

    def __init__(self) -> None:
        self._tracks: dict[int, _Track] = {}

    def clear(self) -> None:
        """Forget all positions, as after a jump of the time."""
        self._tracks.clear()

    def advance(
        self, frame: TrackerFrame, sensed: Sensed, parameters: LocalizerParameters
    ) -> tuple[LocatedTarget, ...]:
        """Locate the targets of a frame.

        Args:
            frame: Of the tracker, later than the last one.
            sensed: At its stamp.
            parameters: Of the localizer.

        Returns:
            All targets of the frame.
        """
        tracks = {target.id: self._tracks.get(target.id) or _Track() for target in frame.targets}
        self._tracks = tracks
        localizer = Localizer(
            sensed.camera,
            plane=sensed.pose.plane,
            target_height=parameters.target.height,
            target_height_sd=parameters.target.height_sd,
        )
        scene = _Scene(frame, sensed, localizer, parameters)
        return tuple(self._locate(target, scene) for target in frame.targets)

    def miss(self, frame: TrackerFrame, parameters: LocalizerParameters) -> None:
        """Take a frame that is not located: only what says that a target is out of sight."""
        for target in frame.targets:
            track = self._tracks.get(target.id)
            if track and distrust(target, parameters.min_confidence):
                track.lose_sight(target)

    def _locate(self, target: ReportedTarget, scene: _Scene) -> LocatedTarget:
        stamp, localizer = scene.frame.stamp, scene.localizer
        track, parameters = self._tracks[target.id], scene.parameters
        place, covered_share = None, None
        track.place_odds = 0.0
        problem = distrust(target, parameters.min_confidence)
        if problem:
            track.lose_sight(target)
        try:
            if problem:
                covered_share = track.covered_share(target, scene)
            else:
                place = localizer.locate(
                    target.box,
                    track.box_errors.add(stamp, target.box, target.box_covariance),
                    depth=scene.sensed.depth,
                    target_probability=scene.probability_of(target),
                    predicted_range=track.predicted_range(scene),
                    methods=scene.methods,
                )
                if place:
                    covered_share = place.occlusion
                    problem = track.measure(target, place, scene)
                else:
                    hint = _contradiction(scene.sensed.pose)
                    problem = f"the box of target {target.id} gives no range{hint}"
        except _UNUSABLE as error:
            problem = problem or f"target {target.id} cannot be located: {error}"
        predicted_for = track.predicted_for(stamp)
        coasts = 0.0 < predicted_for <= parameters.coast
        is_kept = coasts or target.state != "lost"
        return LocatedTarget(
            reported=target,
            bearing=_bearing(place, localizer, target),
            place=place,
            world=track.world(stamp, target) if is_kept else None,
            normalized_innovation=track.filter.normalized_innovation if place else None,
            rejected_for=track.rejected_for(stamp),
            covered_share=covered_share,
            hint=track.hint(covered_share, scene),
            problem=problem,
            doubt=_doubt(target, track.trust),
            predicted_for=predicted_for,
            coasts=coasts,
        )


def _doubt(target: ReportedTarget, trust: Trust) -> str:
    if not trust.doubted_for:
        return ""
    if target.state != "tracking":
        return f"target {target.id} is {target.state}"
    return (
        f"target {target.id} may be something else since it was out of sight; it counts as the "
        f"same after {trust.doubted_for:.1f} s, or sooner with a higher confidence"
    )


def _bearing(place: Place | None, localizer: Localizer, target: ReportedTarget) -> Bearing | None:
    if place:
        return Bearing(place.bearing, place.bearing_covariance)
    try:
        return localizer.bearing(target.box, target.box_covariance)
    except _UNUSABLE:
        # `Localizer.locate` has the same reason.
        return None


def _contradiction(pose: CameraPose) -> str:
    """What gravity says about the camera if that explains a missing range; empty otherwise."""
    if pose.mounting != "imu" or pose.plane.down[1] >= 0.0:
        return ""
    return (
        "; gravity on the topic imu says that the camera is upside down: if it is not, the "
        "accelerometer has the opposite sign (REP 145: upward at rest), or set camera.pitch and "
        "camera.roll"
    )


@dataclass(frozen=True, eq=False)
class _Scene:
    """What all targets of a frame share; attributes as the arguments of `WorldTracks.advance`."""

    frame: TrackerFrame
    sensed: Sensed
    localizer: Localizer
    parameters: LocalizerParameters

    def probability_of(self, target: ReportedTarget) -> NDArray[np.float64] | None:
        """Which pixels of a target's box are its own, where that is known."""
        return self.sensed.probability if target.id == self.frame.selected else None

    @property
    def methods(self) -> tuple[str, ...]:
        method = self.parameters.method
        return METHODS if method == "auto" else (method,)


def distrust(target: ReportedTarget, min_confidence: float) -> str:
    """Why the box of a target is no measurement; empty if it is."""
    if target.state != "tracking":
        return f"target {target.id} is {target.state}"
    if target.confidence < min_confidence:
        return (
            f"the confidence of target {target.id} is {target.confidence:.2f}, below "
            f"min_confidence ({min_confidence:g})"
        )
    return ""


class _Track:
    """Filter, errors of the box, trust, heading and size of one target."""

    def __init__(self) -> None:
        self.filter = PositionFilter(correlation_times=_CORRELATION_TIMES, stands_for=_STANDS_FOR)
        self.box_errors = BoxErrors()
        self.trust = Trust()
        # Stamp of the last measurement without a doubt.
        self._measured_at: int | None = None
        self._yaw: float | None = None
        self._yaw_variance = UNKNOWN_ANGLE
        self._size = 0.0, 0.0
        # Width of a box over its height, and the height of the target in meters.
        self._aspect, self._height = 0.0, 0.0
        # Log odds of a measurement that contradicts the prediction; else 0.
        self.place_odds = 0.0

    def lose_sight(self, target: ReportedTarget) -> None:
        """The box of the target is no measurement in this frame."""
        self.trust.lose_sight(is_hidden=target.state != "tracking")
        self.filter.interrupt()
        if target.state == "lost":
            self.box_errors.reset()

    def predicted_range(self, scene: _Scene) -> tuple[float, float] | None:
        """Distance from the camera to half the height, and its standard deviation, meters."""
        predicted = self.filter.predict(scene.frame.stamp)
        if predicted is None:
            return None
        middle = np.append(predicted.position, scene.parameters.target.height / 2)
        offset = middle - scene.sensed.pose.pose.translation
        distance = float(np.linalg.norm(offset))
        if distance <= 0.0:
            return None
        along = offset[:2] / distance
        variance = float(along @ predicted.covariance[:2, :2] @ along)
        return distance, math.sqrt(max(variance, 0.0))

    def covered_share(self, target: ReportedTarget, scene: _Scene) -> float | None:
        """What covers the box of a target where it is predicted; None without depth."""
        depth, predicted = scene.sensed.depth, self.predicted_range(scene)
        if depth is None or predicted is None:
            return None
        return scene.localizer.covered_share(target.box, depth, predicted)

    def hint(self, covered_share: float | None, scene: _Scene) -> Hint:
        """What the tracker may take of it: what covers it, and where to look for it."""
        filtered = self.filter.predict(scene.frame.stamp)
        if filtered is None or not self._height:
            return Hint(covered_share)
        camera, pose = scene.sensed.camera, scene.sensed.pose
        box, center_std = None, 0.0
        if found := expected_box(camera, pose, filtered, self._height, self._aspect):
            box, center_std = found
        ground = standing(camera, pose, self._height)
        return Hint(covered_share, box, center_std, ground, self.place_odds)

    def measure(self, target: ReportedTarget, place: Place, scene: _Scene) -> str:
        """Take a measurement; why it is not used, empty if it is."""
        if place.is_unseen:
            self.place_odds = LEAST_LOG_ODDS
            self.trust.lose_sight(is_hidden=False)
            return (
                f"depth shows nothing in the box where target {target.id} is expected, as if it "
                "were hidden or the box on something else"
            )
        pose, camera = scene.sensed.pose.pose, scene.sensed.camera
        measured = in_fixed_frame(place, pose.rotation, pose.translation)
        stamp, parameters = scene.frame.stamp, scene.parameters
        is_used = self.filter.update(stamp, measured.mean, measured.covariance)
        innovation = self.filter.normalized_innovation
        by_place = log_odds_by_place(self.filter.log_density, innovation)
        if not is_used:
            self.place_odds = by_place
            return (
                f"the position of target {target.id} jumped (squared innovation "
                f"{innovation or 0.0:.1f}), as if the box were on something else"
            )
        if self.filter.has_restarted:
            self.trust.contradict(stamp)
        self.trust.measure(
            stamp,
            by_place,
            target.confidence,
            min_confidence=parameters.min_confidence,
            hold=parameters.hold,
        )
        if not self.trust.doubted_for:
            self._measured_at = stamp
        if self._yaw is None:
            away = measured.mean[:2] - pose.translation[:2]
            self._yaw = math.atan2(away[1], away[0])
        depth = float(place.position[2])
        self._size = target.box[2] * depth / camera.fx, target.box[3] * depth / camera.fy
        is_cut = is_truncated(np.array(target.box), (camera.width, camera.height))
        if not (self.trust.doubted_for or is_cut):
            self._aspect = target.box[2] / target.box[3]
            before = self._height or parameters.target.height
            self._height = before + _HEIGHT_RATE * (self._size[1] - before)
        return ""

    def rejected_for(self, stamp: int) -> float | None:
        """Seconds in which all measurements were outside of the gate; None without."""
        since = self.filter.rejected_since
        return None if since is None else (stamp - since) / NANOSECONDS

    def predicted_for(self, stamp: int) -> float:
        """Seconds since the last measurement without a doubt; infinite before the first."""
        last = self._measured_at
        return math.inf if last is None else (stamp - last) / NANOSECONDS

    def world(self, stamp: int, target: ReportedTarget) -> WorldTarget | None:
        """The target at a stamp; None before the first measurement."""
        filtered = self.filter.predict(stamp)
        if filtered is None:
            return None
        self._turn(filtered)
        return WorldTarget(
            id=target.id,
            label=target.label,
            state=target.state,
            confidence=target.confidence,
            filtered=filtered,
            yaw=self._yaw or 0.0,
            yaw_variance=self._yaw_variance,
            size=self._size,
        )

    def _turn(self, filtered: FilteredPosition) -> None:
        """Take the heading of a target that moves for certain; else keep the last one."""
        velocity, covariance = filtered.velocity, filtered.covariance[2:, 2:]
        speed = float(np.linalg.norm(velocity))
        distance = float(velocity @ np.linalg.solve(covariance, velocity))
        self._yaw_variance = UNKNOWN_ANGLE
        if speed < _MIN_SPEED or distance < _MIN_SPEED_DISTANCE:
            return
        self._yaw = math.atan2(velocity[1], velocity[0])
        across = np.array([-velocity[1], velocity[0]]) / speed
        variance = float(across @ covariance @ across) / speed**2
        self._yaw_variance = min(variance, UNKNOWN_ANGLE)
