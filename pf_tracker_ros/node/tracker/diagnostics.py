"""The node's health on `/diagnostics`, once a second, whether images come or not."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from std_msgs.msg import Header

from pf_tracker_ros.node.image_topics import where_images_are
from pf_tracker_ros.node.message_building import status_message
from pf_tracker_ros.node.qos import DEFAULT_QOS, Report, advertise
from pf_tracker_ros.node.tracker.frame_rhythm import Rhythm, loss_message, overload_message, rhythm
from pf_tracker_ros.stamps import NANOSECONDS

Value = str | float | int

PERIOD = 1.0
_WINDOW = 5.0
_MOST_FRAMES = 5000
# A camera may skip a frame now and then.
_TOLERATED_LOSS = 0.05
# A node that is busy for so much of its time passes frames over.
_OVERLOAD = 0.95
# Stamps that far from the node's time are by another clock, as those of a recording.
_OTHER_CLOCK = 3600.0


@dataclass(frozen=True)
class Health:
    """What the node knows of itself apart from its frames.

    Attributes:
        level: `DiagnosticStatus.OK`, `WARN` or `ERROR`.
        message: One sentence for people.
        expects_images: Whether it is a fault if none come.
        image_topic: Of the images, empty while they are not subscribed to.
        image_reliability: With which they are subscribed to, `reliable` or `best_effort`.
        is_compressed: Whether they are to come compressed.
        values: More to know, key to value.
    """

    level: bytes
    message: str
    expects_images: bool
    image_topic: str
    image_reliability: str
    is_compressed: bool
    values: dict[str, Value]


@dataclass(frozen=True)
class _Frame:
    arrival: float
    stamp: int
    age: float
    processing: float


class Diagnostics:
    """Counts frames and publishes the figures of the last five seconds, and of all time.

    Attributes:
        jumps: How often time has gone back.
        lost_share: Share of the camera's frames that did not come, 0 to 1, in the last report.

    Args:
        node: The node that publishes.
        health: Tells how the node is.
        stale_after: Tells after how many seconds without an image to warn.
        report: Called with a sentence if an override of the quality of service is wrong.
    """

    def __init__(
        self,
        node: Node,
        health: Callable[[], Health],
        stale_after: Callable[[], float],
        report: Report,
    ) -> None:
        self._node = node
        self._health = health
        self._stale_after = stale_after
        self.jumps = 0
        self.lost_share = 0.0
        self._was_lossy = False
        # What the log has said of missing images, but for their number; None while there are some.
        self._said_missing: str | None = None
        self._outcomes: Counter[str] = Counter()
        self._frames: deque[_Frame] = deque(maxlen=_MOST_FRAMES)
        self._last_arrival: float | None = None
        self._began = time.monotonic()
        self._publisher = advertise(
            node, DiagnosticArray, "/diagnostics", profile=DEFAULT_QOS, report=report
        )
        # By the wall's clock: simulated time may stand still, which is worth telling.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(PERIOD, self._publish, clock=clock)

    def restart(self) -> None:
        """Wait for images from now on, as after an activation."""
        self._frames.clear()
        self._last_arrival = None
        self._said_missing = None
        self._began = time.monotonic()

    def count(self, outcome: str, stamp: int, processing: float) -> None:
        """Count a frame.

        Args:
            outcome: What became of it.
            stamp: Of its header, nanoseconds; 0 if it has none.
            processing: Seconds that it took.
        """
        now = time.monotonic()
        age = self._node.get_clock().now().nanoseconds - stamp if stamp else 0
        self._outcomes[outcome] += 1
        self._last_arrival = now
        self._frames.append(_Frame(now, stamp, age / NANOSECONDS, processing))

    def _publish(self) -> None:
        header = Header(stamp=self._node.get_clock().now().to_msg())
        name = f"{self._node.get_fully_qualified_name().lstrip('/')}: tracker"
        health = self._health()
        now = time.monotonic()
        while self._frames and now - self._frames[0].arrival > _WINDOW:
            self._frames.popleft()
        found = self._rhythm(health)
        self.lost_share = found.lost_share if found else 0.0
        # Twice in a row: a camera that changes its rate looks lossy for a moment.
        was_lossy, self._was_lossy = self._was_lossy, self.lost_share > _TOLERATED_LOSS
        is_lossy = was_lossy and self._was_lossy
        level, message = health.level, health.message
        if self._is_overloaded():
            level = max(level, DiagnosticStatus.WARN)
            message = f"{message}; {overload_message(self._processing())}"
        elif found and is_lossy:
            level = max(level, DiagnosticStatus.WARN)
            loss = loss_message(found, health.image_topic, health.image_reliability)
            message = f"{message}; {loss}"
        silent = now - (self._last_arrival or self._began)
        is_silent = health.expects_images and silent > self._stale_after()
        if is_silent:
            level = max(level, DiagnosticStatus.WARN)
            where = where_images_are(
                self._node, health.image_topic, compressed=health.is_compressed
            )
            said = f"no image for {silent:.1f} s{where}"
            if where != self._said_missing:
                self._node.get_logger().warning(said)
            self._said_missing = where
            message = f"{said}; {message}"
        else:
            self._said_missing = None
        values = self._figures(now, found) | health.values
        self._publisher.publish(status_message(header, name, level, message, values))

    def _rhythm(self, health: Health) -> Rhythm | None:
        """That of the only camera; the stamps of several would be taken for one's."""
        if not health.expects_images or self._node.count_publishers(health.image_topic) > 1:
            return None
        stamped = [frame for frame in self._frames if frame.stamp]
        return rhythm([frame.stamp for frame in stamped], [frame.arrival for frame in stamped])

    def _is_overloaded(self) -> bool:
        if len(self._frames) < 2:
            return False
        span = self._frames[-1].arrival - self._frames[0].arrival
        busy = sum(frame.processing for frame in self._frames) - self._frames[0].processing
        return busy > _OVERLOAD * span

    def _processing(self) -> float:
        """Seconds that a frame takes, on average."""
        return sum(frame.processing for frame in self._frames) / len(self._frames)

    def _figures(self, now: float, found: Rhythm | None) -> dict[str, Value]:
        frames = list(self._frames)
        values: dict[str, Value] = {
            "input_rate": len(frames) / min(_WINDOW, max(now - self._began, PERIOD)),
            "frames": self._outcomes.total(),
        }
        if found:
            values["camera_rate"] = 1.0 / found.interval
            values["lost_share"] = found.lost_share
        if self._last_arrival is not None:
            values["seconds_since_image"] = now - self._last_arrival
        if frames:
            age = sum(frame.age for frame in frames) / len(frames)
            if abs(age) < _OTHER_CLOCK:
                values["image_age_ms"] = 1e3 * age
            else:
                values["image_age_ms"] = "unknown: the stamps are by another clock"
            values["processing_time_ms"] = 1e3 * self._processing()
            values["processing_time_max_ms"] = 1e3 * max(frame.processing for frame in frames)
        for outcome in ("duplicate", "late", "paused", "refused"):
            values[f"dropped_{outcome}"] = self._outcomes[outcome]
        values["time_jumps"] = self.jumps
        return values
