"""The status of a frame: what is known of the target, and what stands in the way."""

from __future__ import annotations

from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from std_msgs.msg import Header

from pf_tracker_ros.node.message_building import estimate_values, status_message
from pf_tracker_ros.node.qos import LATCHED_QOS, Report, advertise
from pf_tracker_ros.node.tracker.reporter import Reporter
from pf_tracker_ros.stamps import parts
from pf_tracker_ros.tracking.estimate import Estimate

_LEVELS = {
    "idle": DiagnosticStatus.OK,
    "tracking": DiagnosticStatus.OK,
    "occluded": DiagnosticStatus.WARN,
    "lost": DiagnosticStatus.ERROR,
}
_DESCRIPTIONS = {
    "idle": "waiting for a target",
    "tracking": "tracking",
    "occluded": "the target is hidden; its place is a guess",
    "lost": "the target is lost",
}


@dataclass(frozen=True)
class Status:
    """How the node is after a frame.

    Attributes:
        frame: What became of the frame.
        estimate: The latest estimate, None without a target.
        requested_stamp: Stamp of the frame that a requested target waits for, None or 0 without.
        obstacle: What keeps the node from tracking at all, or empty.
        enabled: Whether it looks at images.
        preset: Of the tracker, and how many values differ from it.
        lost_share: Share of the camera's frames that did not come, 0 to 1.
    """

    frame: str
    estimate: Estimate | None
    requested_stamp: int | None
    obstacle: str
    enabled: bool
    preset: str
    lost_share: float

    @property
    def state(self) -> str:
        """`idle`, or the state of the track."""
        return self.estimate.state if self.estimate else "idle"

    @property
    def level(self) -> bytes:
        """How bad it is."""
        if self.obstacle or self.frame == "refused":
            return DiagnosticStatus.ERROR
        return _LEVELS[self.state]

    @property
    def description(self) -> str:
        """How it is, in words."""
        if self.obstacle:
            return f"not tracking: {self.obstacle}"
        if not self.enabled:
            return "paused; the service ~/enable goes on"
        if self.requested_stamp:
            seconds, nanoseconds = parts(self.requested_stamp)
            stamp = f"{seconds}.{nanoseconds:09d} s"
            return f"{self.state}; a target waits for an image stamped {stamp}"
        return _DESCRIPTIONS[self.state]


class StatusOutput:
    """The topic `~/status`.

    Args:
        node: The node that publishes.
        report: Called with a sentence if a subscriber cannot be reached.
    """

    def __init__(self, node: Node, report: Report) -> None:
        self._node = node
        self._publisher = advertise(
            node, DiagnosticArray, "~/status", profile=LATCHED_QOS, report=report
        )

    def publish(self, header: Header, status: Status, reporter: Reporter, elapsed: float) -> None:
        """Publish the status of a frame, with all errors since the last one.

        Args:
            header: Of the frame.
            status: How the node is.
            reporter: Knows the errors.
            elapsed: Seconds that the frame took.
        """
        level = status.level
        errors = [error for error in reporter.take_unshown() if error not in status.obstacle]
        if errors:
            level = max(level, DiagnosticStatus.WARN)
        if status.obstacle or not errors:
            errors.insert(0, status.description)
        values: dict[str, str | float | int] = {"state": status.state, "frame": status.frame}
        if status.estimate:
            values |= estimate_values(status.estimate)
        values["processing_time_ms"] = 1e3 * elapsed
        values["lost_share"] = status.lost_share
        values["preset"] = status.preset
        values |= reporter.values()
        name = self._node.get_fully_qualified_name()
        self._publisher.publish(status_message(header, name, level, "; ".join(errors), values))

    def close(self) -> None:
        """Withdraw the topic."""
        self._node.destroy_publisher(self._publisher)
