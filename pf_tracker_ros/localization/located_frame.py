"""The result of the localizer for one frame, and its status."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pf_tracker_ros.boxes import as_box
from pf_tracker_ros.localization.tracker_frame import TrackerFrame
from pf_tracker_ros.localization.world_tracks import LocatedTarget, Sensed
from pf_tracker_ros.messages import OK, WARN, Status
from pf_tracker_ros.stamps import NANOSECONDS, format_stamp
from pf_tracker_ros.topics import StatusValues
from pf_tracker_ros.tracking.hints import Hint, Standing
from pf_tracker_ros.world_messages import WorldTarget


@dataclass(frozen=True, eq=False)
class LocatedFrame:
    """A frame of the tracker with positions.

    Attributes:
        frame: The tracker's result.
        silence: Why the selected target has no pose; empty if it has.
        silent_since: Stamp of the first frame without a pose, nanoseconds.
        problems: Of the inputs.
        sensed: What the sensors say; None if the frame is not located.
        learned_boxes: Boxes from which the ground is learned.
        targets: All targets.
        waited: Seconds for which the frame waited for the other inputs.
    """

    frame: TrackerFrame
    silence: str
    silent_since: int
    problems: tuple[str, ...] = ()
    sensed: Sensed | None = None
    learned_boxes: int = 0
    targets: Sequence[LocatedTarget] = ()
    waited: float = 0.0

    @property
    def selected(self) -> LocatedTarget | None:
        """The selected target; None without."""
        selected = self.frame.selected
        return next((one for one in self.targets if one.reported.id == selected), None)

    @property
    def world_targets(self) -> list[WorldTarget]:
        """The targets with a position."""
        return [one.world for one in self.targets if one.world]

    @property
    def hints(self) -> dict[int, Hint]:
        """Id of a target to `LocatedTarget.hint`."""
        return {one.reported.id: one.hint for one in self.targets}

    @property
    def level(self) -> int:
        """Level of diagnostic_msgs/DiagnosticStatus."""
        return WARN if self.problems or (self.silence and self.frame.selected) else OK

    @property
    def message(self) -> str:
        """The status as a sentence."""
        selected = self.selected
        if not self.silence and selected and selected.coasts:
            seconds = selected.predicted_for
            texts = [f"target {self.frame.selected} is predicted for {seconds:.1f} s"]
        elif not self.silence:
            texts = [f"target {self.frame.selected} is located"]
        else:
            seconds = (self.frame.stamp - self.silent_since) / NANOSECONDS
            texts = [f"no pose for {seconds:.1f} s: {self.silence}"]
        return "; ".join([*texts, *(one for one in self.problems if one != self.silence)])

    @property
    def values(self) -> StatusValues:
        """Values by key."""
        values: StatusValues = {"selected": self.frame.selected}
        values["pose"] = "silent" if self.silence else "published"
        if self.selected and self.selected.coasts:
            values["pose"] = "predicted"
            values["predicted_for"] = self.selected.predicted_for
        if self.silence:
            values["silent_since"] = format_stamp(self.silent_since)
            values["reason"] = self.silence
        values["waited_ms"] = 1e3 * self.waited
        if self.sensed:
            if self.sensed.depth_offset is not None:
                values["depth_offset"] = self.sensed.depth_offset
            camera = self.sensed.pose
            values["camera_mounting"] = camera.mounting
            values["camera_motion"] = camera.motion
            height = camera.plane.height
            values["camera_height"] = "unknown" if height is None else height
            values["camera_pitch"], values["camera_roll"] = camera.plane.pitch, camera.plane.roll
        if self.learned_boxes:
            values["learned_boxes"] = self.learned_boxes
        return values

    def statuses(self, node: str) -> list[Status]:
        """The status of the frame and one for each target.

        Args:
            node: Fully qualified name of the node.
        """
        return [
            Status(node, self.level, self.message, self.values),
            *(
                Status(
                    f"{node}: target {target.reported.id}",
                    OK,
                    target.problem or "located",
                    located_values(target),
                )
                for target in self.targets
            ),
        ]


def hint_of_values(values: Mapping[str, str]) -> Hint:
    """The hint among the values of a target, see `located_values`.

    Raises:
        ValueError: A value is no number.
    """

    def numbers(*names: str) -> list[float] | None:
        return [float(values[name]) for name in names] if values.keys() >= set(names) else None

    share = numbers("covered_share")
    box = numbers("expected_x", "expected_y", "expected_width", "expected_height")
    ground = numbers("horizon", "height_slope")
    return Hint(
        share[0] if share else None,
        as_box(box) if box else None,
        float(values.get("expected_center_std", 0.0)),
        Standing(*ground) if ground else None,
        float(values.get("place_odds", 0.0)),
    )


def located_values(target: LocatedTarget) -> StatusValues:
    """The values of a target by key: meters, meters per second, radians."""
    reported, world, place = target.reported, target.world, target.place
    values: StatusValues = {
        "id": reported.id,
        "label": reported.label,
        "state": reported.state,
        "confidence": reported.confidence,
    }
    if target.bearing:
        x, y, z = target.bearing.direction.tolist()
        (xx, xy), (_, yy) = target.bearing.covariance.tolist()
        values |= {"bearing_x": x, "bearing_y": y, "bearing_z": z}
        values |= {"bearing_covariance_xx": xx, "bearing_covariance_xy": xy}
        values["bearing_covariance_yy"] = yy
    if place:
        values |= {"method": place.method, "range": place.range}
    if target.covered_share is not None:
        values["covered_share"] = target.covered_share
    box, expected = target.hint.box, target.hint.standing
    if box is not None:
        names = ("expected_x", "expected_y", "expected_width", "expected_height")
        values |= dict(zip(names, box, strict=True))
        values["expected_center_std"] = target.hint.center_std
    if target.hint.place_odds:
        values["place_odds"] = target.hint.place_odds
    if expected is not None:
        values |= {"horizon": expected.horizon, "height_slope": expected.slope}
    if target.normalized_innovation is not None:
        values["normalized_innovation"] = target.normalized_innovation
    if target.rejected_for is not None:
        values["rejected_for"] = target.rejected_for
    if world:
        x, y = world.filtered.position.tolist()
        velocity_x, velocity_y = world.filtered.velocity.tolist()
        covariance = world.filtered.covariance.tolist()
        values |= {"x": x, "y": y, "velocity_x": velocity_x, "velocity_y": velocity_y}
        values |= {"covariance_xx": covariance[0][0], "covariance_xy": covariance[0][1]}
        values["covariance_yy"] = covariance[1][1]
    if target.problem:
        values["reason"] = target.problem
    return values
