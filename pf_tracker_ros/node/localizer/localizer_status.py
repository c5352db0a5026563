"""The localizer's `~/status`, one for each status of the tracker, and `/diagnostics`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from std_msgs.msg import Header

from pf_tracker_ros.messages import OK, WARN, Status, status_message
from pf_tracker_ros.node.localizer.camera_pose import CameraPose
from pf_tracker_ros.node.localizer.world_tracks import LocatedTarget
from pf_tracker_ros.node.messages import new_message
from pf_tracker_ros.node.qos import DEFAULT_QOS, LATCHED_QOS, ErrorCallback, advertise
from pf_tracker_ros.stamps import NANOSECONDS, split_stamp
from pf_tracker_ros.topics import StatusValues

# Seconds between two messages on /diagnostics.
_PERIOD = 1.0


@dataclass(frozen=True, eq=False)
class LocalizerStatus:
    """Status after a frame of the tracker.

    Attributes:
        selected: Id of the selected target, 0 without.
        silence: Why the selected target has no pose; empty if it has.
        silent_since: Stamp of the first frame without a pose, nanoseconds.
        stamp: Of the frame.
        problems: Of the inputs.
        camera: Where the camera is; None if it is unknown.
        learned_boxes: Boxes from which the ground is learned.
        depth_offset: Stamp of the depth image relative to the image's, seconds; None without.
        targets: All targets.
        waited: Seconds for which the frame waited for the other inputs.
    """

    selected: int
    silence: str
    silent_since: int
    stamp: int
    problems: tuple[str, ...]
    camera: CameraPose | None
    learned_boxes: int
    depth_offset: float | None
    targets: Sequence[LocatedTarget]
    waited: float

    @property
    def level(self) -> int:
        """Level of diagnostic_msgs/DiagnosticStatus."""
        return WARN if self.problems or (self.silence and self.selected) else OK

    @property
    def message(self) -> str:
        """The status as a sentence."""
        if not self.silence:
            texts = [f"target {self.selected} is located"]
        else:
            seconds = (self.stamp - self.silent_since) / NANOSECONDS
            texts = [f"no pose for {seconds:.1f} s: {self.silence}"]
        return "; ".join([*texts, *(one for one in self.problems if one != self.silence)])

    @property
    def values(self) -> StatusValues:
        """Values by key."""
        values: StatusValues = {"selected": self.selected}
        values["pose"] = "silent" if self.silence else "published"
        if self.silence:
            seconds, nanoseconds = split_stamp(self.silent_since)
            values["silent_since"] = f"{seconds}.{nanoseconds:09d}"
            values["reason"] = self.silence
        values["waited_ms"] = 1e3 * self.waited
        if self.depth_offset is not None:
            values["depth_offset"] = self.depth_offset
        if self.camera:
            plane = self.camera.plane
            values["camera_mounting"] = self.camera.mounting
            values["camera_motion"] = self.camera.motion
            values["camera_height"] = "unknown" if plane.height is None else plane.height
            values["camera_pitch"], values["camera_roll"] = plane.pitch, plane.roll
        if self.learned_boxes:
            values["learned_boxes"] = self.learned_boxes
        return values


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
        if place.occlusion is not None:
            values["occluded_depth"] = place.occlusion
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


class StatusPublisher:
    """The publisher of `~/status`.

    Args:
        node: The publishing node.
        report: Called with a sentence if a QoS override is invalid.
    """

    def __init__(self, node: Node, report: ErrorCallback) -> None:
        self._node = node
        self._publisher = advertise(
            node, DiagnosticArray, "~/status", profile=LATCHED_QOS, report=report
        )

    def publish(self, header: Header, status: LocalizerStatus) -> None:
        """Publish a status with the header of the image."""
        name = self._node.get_fully_qualified_name()
        statuses = [Status(name, status.level, status.message, status.values)]
        statuses += [
            Status(
                f"{name}: target {target.reported.id}",
                OK,
                target.problem or "located",
                located_values(target),
            )
            for target in status.targets
        ]
        self._publisher.publish(status_message(new_message, header, statuses))

    def close(self) -> None:
        """Remove the publisher."""
        self._node.destroy_publisher(self._publisher)


class LocalizerDiagnostics:
    """The node's health on `/diagnostics`, once a second.

    Args:
        node: The publishing node.
        health: Returns level, sentence and values.
        report: Called with a sentence if a QoS override is invalid.
    """

    def __init__(
        self,
        node: Node,
        health: Callable[[], tuple[int, str, StatusValues]],
        report: ErrorCallback,
    ) -> None:
        self._node = node
        self._health = health
        self._publisher = advertise(
            node, DiagnosticArray, "/diagnostics", profile=DEFAULT_QOS, report=report
        )
        # Steady time: simulated time may stand still, which is worth a report.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(_PERIOD, self._publish, clock=clock)

    def _publish(self) -> None:
        header = Header(stamp=self._node.get_clock().now().to_msg())
        name = f"{self._node.get_fully_qualified_name().lstrip('/')}: localizer"
        status = Status(name, *self._health())
        self._publisher.publish(status_message(new_message, header, [status]))


class Rate:
    """The rate of a counter between two calls."""

    def __init__(self) -> None:
        self._last = 0, time.monotonic()

    def update(self, count: int) -> float:
        """Increase a second since the last call, Hz; 0 if the counter has started anew."""
        now = time.monotonic()
        (before, then), self._last = self._last, (count, now)
        return max(count - before, 0) / max(now - then, 1e-3)
