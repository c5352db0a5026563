"""The node's health on `/diagnostics`, once a second, with and without images.

The loss of frames in transport is estimated from the gaps between the received stamps.
"""

from __future__ import annotations

import math
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
from pf_tracker_ros.stamps import LATE_WITHIN, NANOSECONDS
from pf_tracker_ros.topics import SKIPPED, StatusValues

# With fewer intervals there is no estimate.
_MIN_INTERVALS = 10
# The shortest gaps are between consecutive frames; their share is unknown, but not tiny.
_SHORT_QUANTILE = 0.1
_SHORT_WITHIN = 1.5
# First and last intervals of the window, and their largest ratio: beyond it the rate changes.
_RATE_INTERVALS = 20
_RATE_TOLERANCE = 0.25
# Most gaps of a regular camera are whole multiples of its interval, within this tolerance.
_MULTIPLE_TOLERANCE = 0.25
_MAX_MULTIPLE = 4.0
_REGULAR_SHARE = 0.8
# A single gap is a pause. Losses make several gaps, some of them short.
_MIN_GAPS = 3
_MIN_SHORT_GAPS = 2
# After a lost frame, the next one also arrives later; otherwise the stamps are coarse.
_MIN_CORRELATION = 0.3
# Below this probability of so few long gaps, the camera has two intervals instead of losses.
_MIN_LOSS_PROBABILITY = 1e-4
# A longer gap is a pause of the camera, not a loss.
_MAX_GAP = 2.0 * NANOSECONDS


@dataclass(frozen=True)
class FrameStatistics:
    """Rate and loss of a camera, estimated from stamps.

    Attributes:
        interval: Frame interval of the camera, seconds.
        frame_loss_rate: Share of its frames that did not arrive, 0 to 1.
    """

    interval: float
    frame_loss_rate: float


def frame_statistics(stamps: Sequence[int], arrivals: Sequence[float]) -> FrameStatistics | None:
    """Estimate the interval and the loss of a camera from the received stamps.

    1. The interval is the median of the shortest gaps between stamps.
    2. Each gap of n intervals misses n - 1 frames; the largest gap counts as a pause.
    3. Gaps are losses only if they are repeated, the arrivals have them too, and losses of single
       frames would explain their lengths.

    Args:
        stamps: Nanoseconds, in the order of arrival; late and duplicate stamps and jumps back in
            time are allowed.
        arrivals: Arrival time of each stamp, seconds by any clock.

    Returns:
        The estimate; None with too few stamps or irregular ones.
    """
    gaps, waits = _gaps(np.asarray(stamps, dtype=np.int64), np.asarray(arrivals, dtype=np.float64))
    if len(gaps) < _MIN_INTERVALS:
        return None
    interval = _interval(gaps)
    count = min(len(gaps) // 2, _RATE_INTERVALS)
    shorter, longer = sorted([_interval(gaps[:count]), _interval(gaps[-count:])])
    if longer > (1.0 + _RATE_TOLERANCE) * shorter:
        return None
    multiples = gaps / interval
    # The error of the interval adds up over a long gap: only short gaps show regularity.
    short = multiples[multiples < _MAX_MULTIPLE]
    if np.mean(np.abs(short - np.rint(short)) < _MULTIPLE_TOLERANCE) < _REGULAR_SHARE:
        return None
    missing = np.maximum(np.rint(multiples), 1.0) - 1.0
    if np.count_nonzero(missing) < _MIN_GAPS:
        return FrameStatistics(interval / NANOSECONDS, 0.0)
    are_losses = (
        np.count_nonzero(np.rint(short) > 1.0) >= _MIN_SHORT_GAPS
        and np.corrcoef(gaps, waits)[0, 1] > _MIN_CORRELATION
        and _loss_probability(missing) > _MIN_LOSS_PROBABILITY
    )
    if not are_losses:
        return None
    lost = float(missing.sum() - missing.max())
    return FrameStatistics(interval / NANOSECONDS, lost / (lost + len(gaps)))


def _loss_probability(missing: NDArray[np.float64]) -> float:
    """Probability of so few long gaps if frames are lost independently of each other.

    With a probability p of a loss, p of the gaps miss a frame, and p of those miss more than one. A
    camera that changes between two intervals, one of them twice as long, has no longer gaps.
    Several losses in a row make more of them, and are not tested.

    Args:
        missing: (gaps,) frames that each gap misses.
    """
    count, longer = np.count_nonzero(missing > 0.0), np.count_nonzero(missing > 1.0)
    share = count / len(missing)
    return sum(
        math.comb(count, number) * share**number * (1.0 - share) ** (count - number)
        for number in range(longer + 1)
    )


def _gaps(
    stamps: NDArray[np.int64], arrivals: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gaps between consecutive frames: of the stamps, nanoseconds, and the arrivals, seconds."""
    gaps, waits = [], []
    starts = np.flatnonzero(np.diff(stamps) < -LATE_WITHIN) + 1
    for times, received in zip(np.split(stamps, starts), np.split(arrivals, starts), strict=True):
        ordered, first = np.unique(times, return_index=True)
        gaps.append(np.diff(ordered).astype(np.float64))
        waits.append(np.diff(received[first]))
    all_gaps, all_waits = np.concatenate(gaps), np.concatenate(waits)
    are_near = all_gaps < _MAX_GAP
    return all_gaps[are_near], all_waits[are_near]


def _interval(gaps: NDArray[np.float64]) -> float:
    shortest = np.quantile(gaps, _SHORT_QUANTILE)
    return float(np.median(gaps[gaps <= _SHORT_WITHIN * shortest]))


def overload_warning(processing: float) -> str:
    """The warning for frames that arrive faster than they are processed.

    Args:
        processing: Processing time of a frame, seconds.
    """
    return (
        f"overloaded, so frames are dropped: each takes {1e3 * processing:.0f} ms; use a cheaper "
        "preset, fewer particles or smaller images"
    )


def loss_warning(found: FrameStatistics, topic: str, reliability: str) -> str:
    """The warning for frames lost in transport, with the remedy.

    Args:
        found: Statistics of the frames.
        topic: Topic of the images.
        reliability: Reliability of the subscription, `reliable` or `best_effort`.
    """
    share = (
        f"about {100 * found.frame_loss_rate:.0f} % of the frames on {topic} are lost on the way"
    )
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


PERIOD = 1.0
_WINDOW = 5.0
_MAX_FRAMES = 5000
# A camera may drop a single frame.
_TOLERATED_LOSS = 0.05
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
        frame_loss_rate: Share of the camera's frames lost in transport, 0 to 1, in the last report.

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
        self._last_arrival: float | None = None
        self._start = time.monotonic()
        self._publisher = advertise(
            node, DiagnosticArray, "/diagnostics", profile=DEFAULT_QOS, report=report
        )
        # Steady time: simulated time may stand still, which is worth a report.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(PERIOD, self._publish, clock=clock)

    def restart(self) -> None:
        """Wait for images from now on, after an activation."""
        self._frames.clear()
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

    def _publish(self) -> None:
        header = Header(stamp=self._node.get_clock().now().to_msg())
        name = f"{self._node.get_fully_qualified_name().lstrip('/')}: tracker"
        health = self._health()
        now = time.monotonic()
        while self._frames and now - self._frames[0].arrival > _WINDOW:
            self._frames.popleft()
        found = self._frame_statistics(health)
        self.frame_loss_rate = found.frame_loss_rate if found else 0.0
        # Twice in a row: a change of the rate looks like a loss for a moment.
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
        silent = now - (self._last_arrival or self._start)
        is_silent = health.expects_images and silent > self._image_timeout()
        if is_silent:
            level = max(level, WARN)
            hint = image_publisher_hint(
                self._node, health.image_topic, compressed=health.is_compressed
            )
            warning = f"no image for {silent:.1f} s{hint}"
            if hint != self._logged_hint:
                self._node.get_logger().warning(warning)
            self._logged_hint = hint
            message = f"{warning}; {message}"
        else:
            self._logged_hint = None
        values = self._statistics_values(now, found) | health.values
        status = Status(name, level, message, values)
        self._publisher.publish(status_message(new_message, header, [status]))

    def _frame_statistics(self, health: Health) -> FrameStatistics | None:
        """Statistics of the only publisher; None with several, whose stamps would mix."""
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
        """Mean processing time of a frame, seconds."""
        return sum(frame.processing for frame in self._frames) / len(self._frames)

    def _statistics_values(self, now: float, found: FrameStatistics | None) -> StatusValues:
        frames = list(self._frames)
        values: StatusValues = {
            "input_rate": len(frames) / min(_WINDOW, max(now - self._start, PERIOD)),
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
                values["image_age_ms"] = "unknown: the stamps are of another clock"
            values["processing_time_ms"] = 1e3 * self._processing()
            values["processing_time_max_ms"] = 1e3 * max(frame.processing for frame in frames)
        for outcome in sorted(SKIPPED):
            values[f"dropped_{outcome}"] = self._outcomes[outcome]
        values["time_jumps"] = self.time_jumps
        return values
