"""What a link bears, with a link that is calculated."""

import itertools
import math

import pytest

from pf_tracker_ros.node.console.image_encoding import QUALITY_LEVELS
from pf_tracker_ros.node.console.rate_controller import RateController

RATE = 30.0
# Of a picture in full detail, and how much less each step is; for a picture that nobody knows.
FULL = 150_000
SMALLER = 0.72


def acquire(pace):
    """Take what is free, for which there is nothing to wait."""
    with pytest.raises(StopIteration):
        pace.acquire().send(None)


class Link:
    """A camera, a link and a page, one after another; times are calculated.

    Attributes:
        shown: (when, age) of each frame that was drawn.
    """

    def __init__(self, octets_a_second, latency=0.0, rate=RATE, draws=0.0):
        self.pace = RateController(0.0)
        self.octets_a_second = octets_a_second
        self.shown = []
        self._latency = latency
        self._draws = draws
        self._interval = 1.0 / rate
        self._free_at = 0.0
        self._arriving = []
        self._sent = None
        self._frame = 0
        self.pace.start_round_trip(0.0)
        self.pace.end_round_trip(latency)

    def run(self, seconds):
        """Let the camera take frames for so long."""
        for _ in range(round(seconds / self._interval)):
            self._frame += 1
            self._offer(self._frame * self._interval)

    def _offer(self, now):
        while self._arriving and self._arriving[0][0] <= now:
            arrival, taken = self._arriving.pop(0)
            self.pace.acknowledge(arrival)
            self.shown.append((arrival, arrival - taken))
        if not self.pace.can_send:
            return
        acquire(self.pace)
        octets = FULL * SMALLER ** QUALITY_LEVELS.index(self.pace.quality_level)
        dropped = self._frame - (self._sent or self._frame) - 1
        self._sent = self._frame
        self.pace.send(max(0, dropped), now)
        self._free_at = max(self._free_at, now) + octets / self.octets_a_second + self._draws
        self._arriving.append((self._free_at + self._latency, now))

    def rate(self, since):
        times = [time for time, _ in self.shown if time > since]
        return (len(times) - 1) / (times[-1] - times[0])

    def oldest(self, since):
        return max(age for time, age in self.shown if time > since)


def test_a_wide_link_gets_every_frame_in_full_detail():
    link = Link(50e6)
    link.run(10)
    assert link.pace.quality_level == QUALITY_LEVELS[0]
    assert link.rate(2.0) == pytest.approx(RATE, rel=0.02)


@pytest.mark.parametrize("octets_a_second", [0.3e6, 625e3, 1.5e6])
def test_a_narrow_link_gets_less_detail_and_frames_that_are_not_old(octets_a_second):
    link = Link(octets_a_second)
    link.run(20)
    assert link.pace.quality_level != QUALITY_LEVELS[0]
    # In full detail it would be 2 to 10.
    assert link.rate(5.0) > 15.0
    assert link.oldest(5.0) < 0.3


def test_a_link_that_widens_gets_its_detail_back_and_keeps_it():
    link = Link(0.4e6)
    link.run(10)
    link.octets_a_second = 50e6
    link.run(40)
    assert link.pace.quality_level == QUALITY_LEVELS[0]
    link.run(5)
    assert link.rate(50.0) == pytest.approx(RATE, rel=0.02)


def test_what_a_link_bore_not_is_tried_more_and_more_seldom():
    link = Link(1.0e6)
    link.run(60)
    levels = []
    for _ in range(600):
        link.run(0.1)
        levels.append(QUALITY_LEVELS.index(link.pace.quality_level))
    changes = sum(one != other for one, other in itertools.pairwise(levels))
    assert changes <= 12


def test_a_long_way_is_no_narrow_link():
    link = Link(50e6, latency=0.12)
    link.run(10)
    assert link.pace.quality_level == QUALITY_LEVELS[0]
    assert link.rate(2.0) > 20.0


def test_detail_is_not_given_up_where_that_brings_no_frames():
    """As with a browser that is busy with something else."""
    link = Link(math.inf, latency=0.15, draws=0.12)
    link.run(10)
    levels = []
    for _ in range(100):
        link.run(0.1)
        levels.append(QUALITY_LEVELS.index(link.pace.quality_level))
    assert sum(level == 0 for level in levels) > 80


def test_a_slow_camera_is_no_narrow_link():
    link = Link(2.5e6, rate=10.0)
    link.run(10)
    assert link.pace.quality_level == QUALITY_LEVELS[0]


def test_what_was_never_sent_cannot_be_acknowledged():
    pace = RateController(0.0)
    for now in range(100):
        pace.acknowledge(float(now))

    for _ in range(2):
        acquire(pace)
    assert not pace.can_send
