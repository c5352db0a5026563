"""The rate controller on a simulated link."""

import itertools
import math

import pytest

from pf_tracker_ros.node.console.image_encoding import QUALITY_LEVELS
from pf_tracker_ros.node.console.rate_controller import RateController

RATE = 30.0
# Bytes of a picture in full quality, and the factor of each step of the quality levels.
FULL = 150_000
STEP = 0.72


def acquire(controller):
    """Acquire without waiting."""
    with pytest.raises(StopIteration):
        controller.acquire().send(None)


class Link:
    """A simulated camera, link and page in a row.

    Attributes:
        drawn: (time, age) of each frame drawn, seconds.
    """

    def __init__(self, bytes_per_second, latency=0.0, rate=RATE, draws=0.0):
        self.controller = RateController(0.0)
        self.bytes_per_second = bytes_per_second
        self.drawn = []
        self._latency = latency
        self._draws = draws
        self._interval = 1.0 / rate
        self._free_at = 0.0
        self._arriving = []
        self._sent = None
        self._frame = 0
        self.controller.start_round_trip(0.0)
        self.controller.end_round_trip(latency)

    def run(self, seconds):
        """Simulate so many seconds."""
        for _ in range(round(seconds / self._interval)):
            self._frame += 1
            self._offer(self._frame * self._interval)

    def _offer(self, now):
        while self._arriving and self._arriving[0][0] <= now:
            arrival, sent_at = self._arriving.pop(0)
            self.controller.acknowledge(arrival)
            self.drawn.append((arrival, arrival - sent_at))
        if not self.controller.can_send:
            return
        acquire(self.controller)
        size = FULL * STEP ** QUALITY_LEVELS.index(self.controller.quality_level)
        dropped = self._frame - (self._sent or self._frame) - 1
        self._sent = self._frame
        self.controller.send(max(0, dropped), now)
        self._free_at = max(self._free_at, now) + size / self.bytes_per_second + self._draws
        self._arriving.append((self._free_at + self._latency, now))

    def rate(self, since):
        times = [time for time, _ in self.drawn if time > since]
        return (len(times) - 1) / (times[-1] - times[0])

    def oldest(self, since):
        return max(age for time, age in self.drawn if time > since)


def test_a_fast_link_gets_every_frame_in_full_quality():
    link = Link(50e6)
    link.run(10)
    assert link.controller.quality_level == QUALITY_LEVELS[0]
    assert link.rate(2.0) == pytest.approx(RATE, rel=0.02)


@pytest.mark.parametrize("bytes_per_second", [0.3e6, 625e3, 1.5e6])
def test_a_slow_link_gets_less_quality_and_recent_frames(bytes_per_second):
    link = Link(bytes_per_second)
    link.run(20)
    assert link.controller.quality_level != QUALITY_LEVELS[0]
    # In full quality it would be 2 to 10.
    assert link.rate(5.0) > 15.0
    assert link.oldest(5.0) < 0.3


def test_below_the_lowest_usable_quality_a_link_gets_fewer_frames():
    link = Link(50e3)
    link.controller.level_count = 5
    link.run(20)
    assert link.controller.quality_level == QUALITY_LEVELS[4]
    assert 0.5 < link.rate(10.0) < 2.0
    assert link.oldest(10.0) < 2.5


def test_a_link_that_becomes_faster_gets_full_quality_back_and_keeps_it():
    link = Link(0.4e6)
    link.run(10)
    link.bytes_per_second = 50e6
    link.run(40)
    assert link.controller.quality_level == QUALITY_LEVELS[0]
    link.run(5)
    assert link.rate(50.0) == pytest.approx(RATE, rel=0.02)


def test_a_quality_that_was_too_much_is_tried_less_and_less_often():
    link = Link(1.0e6)
    link.run(60)
    levels = []
    for _ in range(600):
        link.run(0.1)
        levels.append(QUALITY_LEVELS.index(link.controller.quality_level))
    changes = sum(one != other for one, other in itertools.pairwise(levels))
    assert changes <= 12


def test_a_long_latency_is_no_slow_link():
    link = Link(50e6, latency=0.12)
    link.run(10)
    assert link.controller.quality_level == QUALITY_LEVELS[0]
    assert link.rate(2.0) > 20.0


def test_quality_is_not_reduced_where_that_raises_no_frame_rate():
    """As with a busy browser."""
    link = Link(math.inf, latency=0.15, draws=0.12)
    link.run(10)
    levels = []
    for _ in range(100):
        link.run(0.1)
        levels.append(QUALITY_LEVELS.index(link.controller.quality_level))
    assert sum(level == 0 for level in levels) > 80


def test_a_slow_camera_is_no_slow_link():
    link = Link(2.5e6, rate=10.0)
    link.run(10)
    assert link.controller.quality_level == QUALITY_LEVELS[0]


def test_acknowledgments_without_frames_are_ignored():
    controller = RateController(0.0)
    for now in range(100):
        controller.acknowledge(float(now))

    for _ in range(2):
        acquire(controller)
    assert not controller.can_send
