"""The node's health on `/diagnostics`, once a second, whether images come or not.

How many frames got lost on the way is estimated from the rhythm of the stamps that came.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from std_msgs.msg import Header

from pf_tracker_ros.messages import WARN, Status, status_message
from pf_tracker_ros.node.image_topics import image_publisher_hint
from pf_tracker_ros.node.messages import new_message
from pf_tracker_ros.node.qos import DEFAULT_QOS, ErrorCallback, advertise
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.tracking.frame_clock import LATE_WITHIN

# Fewer intervals have no rhythm.
_FEWEST_INTERVALS = 10
# The shortest intervals are those between neighbors; their share of all is unknown, but not tiny.
_SHORT_QUANTILE = 0.1
_SHORT_WITHIN = 1.5
# A camera that changes its rate keeps no rhythm meanwhile.
_SAME_RHYTHM = 0.25
_TELLING_INTERVALS = 20
# A camera's stamps lie about whole multiples of its interval, most of them this near.
_NEAR_WHOLE = 0.25
_LARGEST_MULTIPLE = 4.0
_REGULAR_SHARE = 0.8
# One gap is a pause; where frames get lost there are several, and short ones among them.
_FEWEST_GAPS = 3
_FEWEST_SHORT_GAPS = 2
# Where a frame is missing, the next one also comes later: else the stamps are coarse.
_LEAST_CORRELATION = 0.3
# A longer silence is a pause of the camera, not a loss.
_LONGEST_GAP = 2.0 * NANOSECONDS


@dataclass(frozen=True)
class FrameStatistics:
    """What the stamps of some frames tell.

    Attributes:
        interval: Seconds from one frame of the camera to the next.
        frame_loss_rate: Share of its frames that are missing between those that came, 0 to 1.
    """

    interval: float
    frame_loss_rate: float


def frame_statistics(stamps: Sequence[int], arrivals: Sequence[float]) -> FrameStatistics | None:
    """The rhythm of a camera, from the stamps of those of its frames that came.

    Args:
        stamps: Nanoseconds, in the order in which the frames came; some may be late or double, and
            time may begin anew, as when a recording is played again.
        arrivals: Seconds by any clock at which the frames came, one for each stamp.

    Returns:
        The rhythm; None where there are too few stamps, or none that they keep to.
    """
    gaps, waits = _between_neighbors(
        np.asarray(stamps, dtype=np.int64), np.asarray(arrivals, dtype=np.float64)
    )
    if len(gaps) < _FEWEST_INTERVALS:
        return None
    interval = _interval(gaps)
    some = min(len(gaps) // 2, _TELLING_INTERVALS)
    shorter, longer = sorted([_interval(gaps[:some]), _interval(gaps[-some:])])
    if longer > (1.0 + _SAME_RHYTHM) * shorter:
        return None
    multiples = gaps / interval
    # An error of the interval adds up over many of them: long gaps say nothing of regularity.
    judged = multiples[multiples < _LARGEST_MULTIPLE]
    if np.mean(np.abs(judged - np.rint(judged)) < _NEAR_WHOLE) < _REGULAR_SHARE:
        return None
    missing = np.maximum(np.rint(multiples), 1.0) - 1.0
    if np.count_nonzero(missing) < _FEWEST_GAPS:
        return FrameStatistics(interval / NANOSECONDS, 0.0)
    are_losses = (
        np.count_nonzero(np.rint(judged) > 1.0) >= _FEWEST_SHORT_GAPS
        and np.corrcoef(gaps, waits)[0, 1] > _LEAST_CORRELATION
    )
    if not are_losses:
        return None
    lost = float(missing.sum() - missing.max())
    return FrameStatistics(interval / NANOSECONDS, lost / (lost + len(gaps)))


def _between_neighbors(
    stamps: NDArray[np.int64], arrivals: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """From one frame to the next by the stamps, nanoseconds, and by the arrivals, seconds."""
    gaps, waits = [], []
    starts = np.flatnonzero(np.diff(stamps) < -LATE_WITHIN) + 1
    for times, came in zip(np.split(stamps, starts), np.split(arrivals, starts), strict=True):
        ordered, first = np.unique(times, return_index=True)
        gaps.append(np.diff(ordered).astype(np.float64))
        waits.append(np.diff(came[first]))
    all_gaps, all_waits = np.concatenate(gaps), np.concatenate(waits)
    are_near = all_gaps < _LONGEST_GAP
    return all_gaps[are_near], all_waits[are_near]


def _interval(gaps: NDArray[np.float64]) -> float:
    shortest = np.quantile(gaps, _SHORT_QUANTILE)
    return float(np.median(gaps[gaps <= _SHORT_WITHIN * shortest]))


def overload_warning(processing: float) -> str:
    """What to do where the node is busy all the time.

    Args:
        processing: Seconds that a frame takes it.
    """
    return (
        f"frames are passed over, because each takes {1e3 * processing:.0f} ms and they come "
        "faster: take a cheaper preset, fewer particles or smaller images"
    )


def loss_warning(found: FrameStatistics, topic: str, reliability: str) -> str:
    """How many frames are lost on the way, and the cure.

    Args:
        found: The rhythm of the frames.
        topic: Of the images.
        reliability: With which they are subscribed to, `reliable` or `best_effort`.
    """
    share = (
        f"about {100 * found.frame_loss_rate:.0f} % of the frames on {topic} are lost on the way"
    )
    profile = (
        "start both sides with the Fast DDS profile for large images "
        "(large_images:=true in the launch files)"
    )
    if reliability == "reliable":
        return f"{share} although they are sent reliably: {profile}"
    return (
        f"{share}, which best effort allows: let the camera publish reliably and "
        f"image_reliability be auto, or {profile}"
    )


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
        level: `OK`, `WARN` or `ERROR` of `pf_tracker_ros.messages`.
        message: One sentence for people.
        expects_images: Whether it is a fault if none come.
        image_topic: Of the images, empty while they are not subscribed to.
        image_reliability: With which they are subscribed to, `reliable` or `best_effort`.
        is_compressed: Whether they are to come compressed.
        values: More to know, key to value.
    """

    level: int
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
        time_jumps: How often time has gone back.
        frame_loss_rate: Share of the camera's frames that did not come, 0 to 1, in the last report.

    Args:
        node: The node that publishes.
        health: Tells how the node is.
        image_timeout: Tells after how many seconds without an image to warn.
        report: Called with a sentence if an override of the quality of service is wrong.
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
        self._stale_after = image_timeout
        self.time_jumps = 0
        self.frame_loss_rate = 0.0
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
        self.frame_loss_rate = found.frame_loss_rate if found else 0.0
        # Twice in a row: a camera that changes its rate looks lossy for a moment.
        was_lossy, self._was_lossy = self._was_lossy, self.frame_loss_rate > _TOLERATED_LOSS
        is_lossy = was_lossy and self._was_lossy
        level, message = health.level, health.message
        if self._is_overloaded():
            level = max(level, WARN)
            message = f"{message}; {overload_warning(self._processing())}"
        elif found and is_lossy:
            level = max(level, WARN)
            loss = loss_warning(found, health.image_topic, health.image_reliability)
            message = f"{message}; {loss}"
        silent = now - (self._last_arrival or self._began)
        is_silent = health.expects_images and silent > self._stale_after()
        if is_silent:
            level = max(level, WARN)
            where = image_publisher_hint(
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
        status = Status(name, level, message, values)
        self._publisher.publish(status_message(new_message, header, [status]))

    def _rhythm(self, health: Health) -> FrameStatistics | None:
        """That of the only camera; the stamps of several would be taken for one's."""
        if not health.expects_images or self._node.count_publishers(health.image_topic) > 1:
            return None
        stamped = [frame for frame in self._frames if frame.stamp]
        return frame_statistics(
            [frame.stamp for frame in stamped], [frame.arrival for frame in stamped]
        )

    def _is_overloaded(self) -> bool:
        if len(self._frames) < 2:
            return False
        span = self._frames[-1].arrival - self._frames[0].arrival
        busy = sum(frame.processing for frame in self._frames) - self._frames[0].processing
        return busy > _OVERLOAD * span

    def _processing(self) -> float:
        """Seconds that a frame takes, on average."""
        return sum(frame.processing for frame in self._frames) / len(self._frames)

    def _figures(self, now: float, found: FrameStatistics | None) -> dict[str, Value]:
        frames = list(self._frames)
        values: dict[str, Value] = {
            "input_rate": len(frames) / min(_WINDOW, max(now - self._began, PERIOD)),
            "frames": self._outcomes.total(),
        }
        if found:
            values["camera_rate"] = 1.0 / found.interval
            values["frame_loss_rate"] = found.frame_loss_rate
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
        values["time_jumps"] = self.time_jumps
        return values
