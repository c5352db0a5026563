"""The topic `~/status`: one status for each frame, processed or skipped."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from std_msgs.msg import Header

from pf_tracker_ros.messages import ERROR, WARN, Status, status_message
from pf_tracker_ros.node.messages import new_message
from pf_tracker_ros.node.qos import LATCHED_QOS, ErrorCallback, advertise
from pf_tracker_ros.node.tracker.reporter import Reporter
from pf_tracker_ros.stamps import format_stamp
from pf_tracker_ros.targets.tracked_target import description
from pf_tracker_ros.topics import FrameResult, StatusValues
from pf_tracker_ros.tracking.estimate import SEVERITIES

# Seconds of skipped frames before a warning. Single duplicate or broken frames are normal.
REPORT_AFTER = 1.0


@dataclass(frozen=True)
class SkippedStreak:
    """Consecutive skipped frames, up to the last frame.

    Attributes:
        count: Number of frames.
        seconds: From the first to the last arrival, in whole milliseconds.
        outcome: Outcome of the last one, of `pf_tracker_ros.topics.SKIPPED`.
        cause: Why the last one was skipped, and the remedy.
        last_stamp: Stamp of the last processed frame, nanoseconds; 0 without one.
    """

    count: int
    seconds: float
    outcome: str
    cause: str
    last_stamp: int

    @property
    def is_lasting(self) -> bool:
        """Whether the streak is long enough for a warning."""
        return self.seconds >= REPORT_AFTER

    @property
    def is_fault(self) -> bool:
        """Whether to warn. Frozen images have lasted when they are noticed."""
        return self.is_lasting or self.outcome == "frozen"

    @property
    def description(self) -> str:
        """The cause, and the duration of a lasting streak."""
        if not self.is_lasting:
            return self.cause
        return f"{self.cause}; no frame processed for {self.seconds:.1f} s"


class SkippedFrames:
    """Counts skipped frames. Logs a lasting streak once, and its end.

    A pause is not logged here: its service call is. Neither is a refused frame: its error is.

    Args:
        logger: Logger of the node.
    """

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self.forget()

    def forget(self) -> None:
        """Start anew, as after an activation."""
        self.last: SkippedStreak | None = None
        self._streak_start = 0.0
        self._last_stamp = 0
        self._is_logged = False

    def mark_processed(self, stamp: int) -> None:
        """Record a processed frame, which ends the streak.

        Args:
            stamp: Of its header, nanoseconds.
        """
        if self.last and self._is_logged:
            self._logger.info(
                f"frames are processed again, after {self.last.count} skipped in "
                f"{time.monotonic() - self._streak_start:.1f} s"
            )
        self.last, self._is_logged, self._last_stamp = None, False, stamp

    def skip(self, outcome: str, cause: str) -> None:
        """Record a skipped frame.

        Args:
            outcome: One of `pf_tracker_ros.topics.SKIPPED`.
            cause: Why it was skipped, and the remedy.
        """
        now = time.monotonic()
        if self.last is None:
            self._streak_start = now
        count = self.last.count + 1 if self.last else 1
        seconds = round(now - self._streak_start, 3)
        self.last = SkippedStreak(count, seconds, outcome, cause, self._last_stamp)
        if self.last.is_fault and not self._is_logged and outcome != "paused":
            self._is_logged = True
            if outcome != "refused":
                self._logger.warning(self.last.description)


PAUSED = "paused; resume with the service ~/enable"


def skip_cause(outcome: str, stamp: int, topic: str, frozen_after: float) -> str:
    """Why a frame is skipped, and the remedy; empty if it is refused, which has its own error.

    Args:
        outcome: One of `pf_tracker_ros.topics.SKIPPED`.
        stamp: Of its header, nanoseconds.
        topic: Of the images.
        frozen_after: The parameter of this name, seconds.
    """
    text = format_stamp(stamp)
    causes = {
        "paused": PAUSED,
        "frozen": f"frozen: the images on {topic} have not changed for more than "
        f"{frozen_after:g} s; restart the camera or its driver, or set 'frozen_after' to 0 for "
        "images without noise",
        "duplicate": f"duplicate stamp {text} s on {topic}; the publisher must stamp each image "
        "with its own time of capture, or all images with 0",
        "late": f"stamp {text} s on {topic} is older than the last one; let a single camera with "
        "one clock publish there, or lower 'time_jump_threshold' for a recording that starts "
        "again",
    }
    return causes.get(outcome, "")


@dataclass(frozen=True)
class NodeStatus:
    """Status of the node after a frame.

    Attributes:
        outcome: Outcome of the frame, empty for a status without a frame.
        result: Result of the last processed frame.
        requested_stamp: Stamp of the frame that a requested target waits for, None or 0 without.
        skipped: The frames skipped since, None after a processed frame.
        configuration_error: Why the node cannot track at all, or empty.
        enabled: Whether the node is not paused.
        preset: Preset of the tracker, and how many values differ from it.
        frame_loss_rate: Share of the camera's frames lost in transport, 0 to 1.
    """

    outcome: str
    result: FrameResult
    requested_stamp: int | None
    skipped: SkippedStreak | None
    configuration_error: str
    enabled: bool
    preset: str
    frame_loss_rate: float

    @property
    def is_skipped(self) -> bool:
        """Whether it has no estimate, because the frame was skipped."""
        return self.skipped is not None or not self.enabled

    @property
    def last_state(self) -> str:
        """`idle`, or the target's state, in the last processed frame."""
        return self.result.state

    @property
    def state(self) -> str:
        """`skipped`, `idle`, or the target's state."""
        return "skipped" if self.is_skipped else self.last_state

    @property
    def level(self) -> int:
        """Level of diagnostic_msgs/DiagnosticStatus."""
        if self.configuration_error or self.outcome == "refused":
            return ERROR
        level = SEVERITIES[self.last_state]
        if self.skipped and self.skipped.is_fault:
            level = max(level, WARN)
        return level

    @property
    def description(self) -> str:
        """The status as a sentence."""
        if self.configuration_error:
            return f"not tracking: {self.configuration_error}"
        if self.skipped:
            return self.skipped.description
        if not self.enabled:
            return PAUSED
        if self.requested_stamp:
            stamp = format_stamp(self.requested_stamp)
            return f"{self.state}; the requested target waits for the image stamped {stamp} s"
        return description(self.result.targets, self.result.selected)

    @property
    def values(self) -> StatusValues:
        """State and estimate of the target, key to value; no estimate of a skipped frame."""
        values: StatusValues = {"state": self.state}
        if self.skipped:
            values["skipped_frames"] = self.skipped.count
            values["skipped_seconds"] = self.skipped.seconds
        if self.is_skipped:
            values["last_state"] = self.last_state
        if self.skipped and self.skipped.last_stamp:
            values["last_stamp"] = format_stamp(self.skipped.last_stamp)
        if not self.is_skipped:
            values |= self.result.values
        return values


class StatusOutput:
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

    def publish(
        self, header: Header, status: NodeStatus, reporter: Reporter, elapsed: float
    ) -> None:
        """Publish the status of a frame, with all errors since the last one.

        Args:
            header: Header of the image.
            status: Status of the node.
            reporter: Source of the errors.
            elapsed: Processing time of the frame, seconds.
        """
        level = status.level
        errors = [
            error for error in reporter.take_unshown() if error not in status.configuration_error
        ]
        if errors:
            level = max(level, WARN)
        if status.configuration_error or not errors:
            errors.insert(0, status.description)
        values: StatusValues = {"frame": status.outcome}
        values |= status.values
        values["processing_time_ms"] = 1e3 * elapsed
        values["frame_loss_rate"] = status.frame_loss_rate
        values["preset"] = status.preset
        values |= reporter.values()
        name = self._node.get_fully_qualified_name()
        statuses = [Status(name, level, "; ".join(errors), values)]
        if not status.is_skipped:
            statuses += status.result.target_statuses(name)
        self._publisher.publish(status_message(new_message, header, statuses))

    def close(self) -> None:
        """Remove the publisher."""
        self._node.destroy_publisher(self._publisher)
