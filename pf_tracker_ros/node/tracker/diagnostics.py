"""The node's health on `/diagnostics`, once a second, with and without images.

DDS counts the frames that were sent and did not arrive. A frame that arrived, but was not taken
from the queue in time, is the node's own overload.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass

from rclpy.node import Node

from pf_tracker_ros.messages import WARN
from pf_tracker_ros.node import health_topic
from pf_tracker_ros.node.image_topics import image_publisher_hint
from pf_tracker_ros.node.qos import ErrorCallback
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.topics import SKIPPED, StatusValues


def overload_warning(processing: float) -> str:
    """The warning for frames that arrive faster than they are processed.

    Args:
        processing: Processing time of a frame, seconds.
    """
    return (
        f"overloaded, so frames are dropped: each takes {1e3 * processing:.0f} ms; use a cheaper "
        "preset, fewer particles or smaller images"
    )


def loss_warning(rate: float, topic: str, reliability: str, held_up: float = 0.0) -> str:
    """The warning for frames lost in transport, with the remedy.

    Args:
        rate: Share of the frames of the last five seconds, 0 to 1.
        topic: Topic of the images.
        reliability: Reliability of the subscription, `reliable` or `best_effort`.
        held_up: How long the process did not run in these seconds.
    """
    share = f"{100 * rate:.0f} % of the frames on {topic} are lost"
    if held_up > rate * _WINDOW / 2:
        return (
            f"{share}, as the process was held up for {held_up:.1f} s; give it more processor "
            "time, or set realtime_priority to 1"
        )
    share += " on the way"
    profile = (
        "start publisher and tracker with the Fast DDS profile for large images "
        "(large_images:=true in the launch files)"
    )
    if reliability == "reliable":
        return f"{share} despite reliable delivery; {profile}"
    return (
        f"{share} with best-effort delivery; publish them reliably with image_reliability auto, "
        f"or {profile}"
    )


_WINDOW = 5.0
_MAX_FRAMES = 5000
# Above it a warning, unless it is of less than so many frames.
_TOLERATED_LOSS, _MIN_LOST = 0.05, 3
# Share of the time spent on processing above which frames are dropped.
_OVERLOAD = 0.95
# Stamps this far from the node's time are of another clock, as in a recording; seconds.
_OTHER_CLOCK = 3600.0


@dataclass(frozen=True)
class Health:
    """Health of the node apart from its frames.

    Attributes:
        level: `OK`, `WARN` or `ERROR` of `pf_tracker_ros.messages`.
        message: One sentence.
        expects_images: Whether missing images are a fault.
        image_topic: Topic of the images, empty without a subscription.
        image_reliability: Reliability of the subscription, `reliable` or `best_effort`.
        is_compressed: Whether the subscription is to compressed images.
        values: Further values by key.
    """

    level: int
    message: str
    expects_images: bool
    image_topic: str
    image_reliability: str
    is_compressed: bool
    values: StatusValues


@dataclass(frozen=True)
class _Frame:
    arrival: float
    stamp: int
    age: float
    processing: float


class Diagnostics:
    """Counts frames, and publishes statistics of the last five seconds and totals.

    Attributes:
        time_jumps: Number of jumps back in time.
        frame_loss_rate: Share of the sent frames that were lost in transport, 0 to 1, in the last
            report.

    Args:
        node: The publishing node.
        health: Returns the health of the node.
        image_timeout: Returns the seconds without an image before a warning.
        report: Called with a sentence if a QoS override is invalid.
    """

    def __init__(
        self,
        node: Node,
        health: Callable[[], Health],
        image_timeout: Callable[[], float],
        report: ErrorCallback,
    ) -> None:
        self._node = node
        self._health = health
        self._image_timeout = image_timeout
        self.time_jumps = 0
        self.frame_loss_rate = 0.0
        self._was_lossy = False
        # Hint logged last with the warning of missing images; None while images arrive.
        self._logged_hint: str | None = None
        self._outcomes: Counter[str] = Counter()
        self._frames: deque[_Frame] = deque(maxlen=_MAX_FRAMES)
        # Time and number of frames of each loss.
        self._losses: deque[tuple[float, float]] = deque(maxlen=_MAX_FRAMES)
        # Time of each report, and the seconds by which it was late.
        self._delays: deque[tuple[float, float]] = deque()
        self._last_arrival: float | None = None
        self._start = time.monotonic()
        self._topic = health_topic.HealthTopic(node, "tracker", self._health_message, report)

    def restart(self) -> None:
        """Wait for images from now on, after an activation."""
        self._frames.clear()
        self._losses.clear()
        self._last_arrival = None
        self._logged_hint = None
        self._start = time.monotonic()

    def count(self, outcome: str, stamp: int, processing: float) -> None:
        """Count a frame.

        Args:
            outcome: Its outcome, as in the status.
            stamp: Of its header, nanoseconds; 0 without one.
            processing: Processing time, seconds.
        """
        now = time.monotonic()
        age = self._node.get_clock().now().nanoseconds - stamp if stamp else 0
        self._outcomes[outcome] += 1
        self._last_arrival = now
        self._frames.append(_Frame(now, stamp, age / NANOSECONDS, processing))

    def count_lost(self, count: int) -> None:
        """Count frames that were lost in transport."""
        self._losses.append((time.monotonic(), count))

    def _health_message(self) -> tuple[int, str, StatusValues]:
        """Level, sentence and values."""
        health = self._health()
        now = time.monotonic()
        lost = self._count_recent(now)
        level, message = health.level, health.message
        if warning := self._drop_warning(health, lost):
            level, message = max(level, WARN), f"{message}; {warning}"
        if warning := self._silence_warning(health, now):
            level, message = max(level, WARN), f"{warning}; {message}"
        return level, message, self._statistics_values(now, lost) | health.values

    def _count_recent(self, now: float) -> int:
        """Frames lost in the last seconds; older ones are forgotten."""
        last_report = self._delays[-1][0] if self._delays else now
        self._delays.append((now, max(now - last_report - health_topic.PERIOD, 0.0)))
        while self._frames and now - self._frames[0].arrival > _WINDOW:
            self._frames.popleft()
        for recent in (self._losses, self._delays):
            while recent and now - recent[0][0] > _WINDOW:
                recent.popleft()
        lost = int(sum(count for _, count in self._losses))
        self.frame_loss_rate = lost / (lost + len(self._frames)) if lost else 0.0
        return lost

    def _drop_warning(self, health: Health, lost: int) -> str:
        """That frames are dropped or lost, or empty; a loss is logged once."""
        was_lossy = self._was_lossy
        self._was_lossy = lost >= _MIN_LOST and self.frame_loss_rate > _TOLERATED_LOSS
        if self._is_overloaded():
            return overload_warning(self._processing())
        if not self._was_lossy or not health.expects_images:
            return ""
        held_up = sum(seconds for _, seconds in self._delays)
        loss = loss_warning(
            self.frame_loss_rate, health.image_topic, health.image_reliability, held_up
        )
        if not was_lossy:
            self._node.get_logger().warning(loss)
        return loss

    def _silence_warning(self, health: Health, now: float) -> str:
        """That images are missing, or empty; it is logged with each new hint."""
        silent = now - (self._last_arrival or self._start)
        if not health.expects_images or silent <= self._image_timeout():
            self._logged_hint = None
            return ""
        hint = image_publisher_hint(self._node, health.image_topic, compressed=health.is_compressed)
        warning = f"no image for {silent:.1f} s{hint}"
        if hint != self._logged_hint:
            self._node.get_logger().warning(warning)
        self._logged_hint = hint
        return warning

    def _is_overloaded(self) -> bool:
        if len(self._frames) < 2:
            return False
        span = self._frames[-1].arrival - self._frames[0].arrival
        busy = sum(frame.processing for frame in self._frames) - self._frames[0].processing
        return busy > _OVERLOAD * span

    def _processing(self) -> float:
        """Mean processing time of a frame, seconds."""
        return sum(frame.processing for frame in self._frames) / len(self._frames)

    def _statistics_values(self, now: float, lost: int) -> StatusValues:
        frames = list(self._frames)
        seconds = min(_WINDOW, max(now - self._start, health_topic.PERIOD))
        values: StatusValues = {
            "input_rate": len(frames) / seconds,
            "camera_rate": (len(frames) + lost) / seconds,
            "frame_loss_rate": self.frame_loss_rate,
            "frames": self._outcomes.total(),
        }
        if self._last_arrival is not None:
            values["seconds_since_image"] = now - self._last_arrival
        if frames:
            age = sum(frame.age for frame in frames) / len(frames)
            if abs(age) < _OTHER_CLOCK:
                values["image_age_ms"] = 1e3 * age
            else:
                values["image_age_ms"] = "unknown: the stamps are of another clock"
            values["processing_time_ms"] = 1e3 * self._processing()
            values["processing_time_max_ms"] = 1e3 * max(frame.processing for frame in frames)
        for outcome in sorted(SKIPPED):
            values[f"dropped_{outcome}"] = self._outcomes[outcome]
        values["time_jumps"] = self.time_jumps
        return values
