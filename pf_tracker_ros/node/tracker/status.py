"""The status of a frame: what is known of the targets, and what stands in the way.

Frames that are answered but not looked at are counted, and the log has each new state soon.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from std_msgs.msg import Header

from pf_tracker_ros.messages import ERROR, WARN, Status, status_message
from pf_tracker_ros.node.messages import new_message
from pf_tracker_ros.node.qos import LATCHED_QOS, ErrorCallback, advertise
from pf_tracker_ros.node.tracker.reporter import Reporter
from pf_tracker_ros.stamps import split_stamp
from pf_tracker_ros.targets.tracked_target import (
    TrackedTarget,
    description,
)
from pf_tracker_ros.topics import FrameResult
from pf_tracker_ros.tracking.estimate import SEVERITIES, Estimate

# What becomes of a frame that is not looked at.
SKIPPED = ("refused", "duplicate", "late", "paused")

# One frame may come twice or broken; so many seconds of such frames are told of.
REPORT_AFTER = 1.0


@dataclass(frozen=True)
class SkippedStreak:
    """The frames in a row, up to the last one, that were not looked at.

    Attributes:
        count: How many.
        seconds: From the first of them to the last one, by arrival, in whole milliseconds.
        cause: Of the last one: why, and what to do.
        last_stamp: Of the last frame that was looked at, nanoseconds; 0 if it had none, or if there
            was none.
    """

    count: int
    seconds: float
    cause: str
    last_stamp: int

    @property
    def is_lasting(self) -> bool:
        """Whether it has lasted for so long that people should know."""
        return self.seconds >= REPORT_AFTER

    @property
    def description(self) -> str:
        """The cause, and since when if that is long ago."""
        if not self.is_lasting:
            return self.cause
        return f"{self.cause}; no frame has been looked at for {self.seconds:.1f} s"


class SkippedFrames:
    """Follows which frames are looked at; the log has one line when that ends, one when it goes on.

    A pause is none of its business there, as whoever asked for it is told; and the log has the
    error of a frame that is refused.

    Args:
        logger: Of the node.
    """

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self.forget()

    def forget(self) -> None:
        """Begin again, as after an activation."""
        self.last: SkippedStreak | None = None
        self._began = 0.0
        self._last_stamp = 0
        self._is_logged = False

    def mark_processed(self, stamp: int) -> None:
        """Take a frame that was looked at.

        Args:
            stamp: Of its header, nanoseconds.
        """
        if self.last and self._is_logged:
            self._logger.info(
                f"frames are looked at again, after {self.last.count} in "
                f"{time.monotonic() - self._began:.1f} s that were not"
            )
        self.last, self._is_logged, self._last_stamp = None, False, stamp

    def skip(self, frame: str, cause: str) -> None:
        """Take a frame that was not.

        Args:
            frame: What became of it, one of `SKIPPED`.
            cause: Why, and what to do.
        """
        now = time.monotonic()
        if self.last is None:
            self._began = now
        count = self.last.count + 1 if self.last else 1
        self.last = SkippedStreak(count, round(now - self._began, 3), cause, self._last_stamp)
        if self.last.is_lasting and not self._is_logged and frame != "paused":
            self._is_logged = True
            if frame != "refused":
                self._logger.warning(self.last.description)


# A target that flickers at the frame rate is told of once in so long, with the state it is then in.
_INTERVAL = 1.0


class StateLog:
    """Logs changes of the selected target's state, the last of them always, within a second.

    Another target counts as tracked before.

    Args:
        logger: Of the node.
    """

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self._id = 0
        self._told = "tracking"
        self._told_at = -_INTERVAL

    def update(self, id: int, estimate: Estimate) -> None:
        """Log the state after a frame if it is another than the last one that was told.

        Args:
            id: Of the target.
            estimate: What is known of it.
        """
        if id != self._id:
            self._id, self._told = id, "tracking"
        now = time.monotonic()
        if estimate.state == self._told or now - self._told_at < _INTERVAL:
            return
        self._logger.info(f"{self._told} -> {estimate.state}, confidence {estimate.confidence:.2f}")
        self._told, self._told_at = estimate.state, now


class TargetsLog:
    """Logs which targets there are, once they are others, the last of them within a second.

    Args:
        logger: Of the node.
    """

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self._told: tuple[int, ...] = ()
        self._told_at = -_INTERVAL

    def update(self, targets: Sequence[TrackedTarget]) -> None:
        """Log the targets after a frame if they are others than the last ones that were told."""
        now = time.monotonic()
        ids = tuple(target.id for target in targets)
        if ids == self._told or now - self._told_at < _INTERVAL:
            return
        listed = ", ".join(f"{target.id} {target.label}".rstrip() for target in targets)
        self._logger.info(f"targets: {listed or 'none'}")
        self._told, self._told_at = ids, now


PAUSED = "paused; the service ~/enable lets it go on"


def format_stamp(stamp: int) -> str:
    """A stamp in nanoseconds as seconds with all digits."""
    seconds, nanoseconds = split_stamp(stamp)
    return f"{seconds}.{nanoseconds:09d}"


@dataclass(frozen=True)
class NodeStatus:
    """How the node is after a frame.

    Attributes:
        frame: What became of the frame, empty where it is not about one.
        result: What is known after the last frame that was looked at.
        requested_stamp: Stamp of the frame that a requested target waits for, None or 0 without.
        skipped: The frames since, None if that is this one.
        configuration_error: What keeps the node from tracking at all, or empty.
        enabled: Whether it looks at images.
        preset: Of the tracker, and how many values differ from it.
        frame_loss_rate: Share of the camera's frames that did not come, 0 to 1.
    """

    frame: str
    result: FrameResult
    requested_stamp: int | None
    skipped: SkippedStreak | None
    configuration_error: str
    enabled: bool
    preset: str
    frame_loss_rate: float

    @property
    def is_skipped(self) -> bool:
        """Whether it says nothing of the target, because the image was not looked at."""
        return self.skipped is not None or not self.enabled

    @property
    def last_state(self) -> str:
        """`idle`, or the state of the track, in the last frame that was looked at."""
        return self.result.state

    @property
    def state(self) -> str:
        """`skipped`, `idle`, or the state of the track."""
        return "skipped" if self.is_skipped else self.last_state

    @property
    def level(self) -> int:
        """How bad it is."""
        if self.configuration_error or self.frame == "refused":
            return ERROR
        level = SEVERITIES[self.last_state]
        if self.skipped and self.skipped.is_lasting:
            level = max(level, WARN)
        return level

    @property
    def description(self) -> str:
        """How it is, in words."""
        if self.configuration_error:
            return f"not tracking: {self.configuration_error}"
        if self.skipped:
            return self.skipped.description
        if not self.enabled:
            return PAUSED
        if self.requested_stamp:
            stamp = format_stamp(self.requested_stamp)
            return f"{self.state}; a target waits for an image stamped {stamp} s"
        return description(self.result.targets, self.result.selected)

    @property
    def values(self) -> dict[str, str | float | int]:
        """The state and what is known of the target, key to value; of no frame but this."""
        values: dict[str, str | float | int] = {"state": self.state}
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
    """The topic `~/status`.

    Args:
        node: The node that publishes.
        report: Called with a sentence if a subscriber cannot be reached.
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
            header: Of the frame.
            status: How the node is.
            reporter: Knows the errors.
            elapsed: Seconds that the frame took.
        """
        level = status.level
        errors = [
            error for error in reporter.take_unshown() if error not in status.configuration_error
        ]
        if errors:
            level = max(level, WARN)
        if status.configuration_error or not errors:
            errors.insert(0, status.description)
        values: dict[str, str | float | int] = {"frame": status.frame}
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
        """Withdraw the topic."""
        self._node.destroy_publisher(self._publisher)
