"""Stamps of a recording without time stamps, at any rate, with pauses and loops."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.node.replay.restamping import Restamper

START = 1_700_000_000_000_000_000
INTERVAL = 40_000_000


@given(
    steps=st.lists(st.tuples(st.integers(0, 10**9), st.booleans()), min_size=2, max_size=60),
    length=st.integers(2, 10),
    rate=st.sampled_from([0.5, 1.0, 2.0, 100.0]),
)
def test_stamps_keep_the_source_intervals_and_follow_the_clock_after_pauses(steps, length, rate):
    now, interval = START, round(INTERVAL / rate)
    played = Restamper(lambda: now)
    stamps = []
    for number, (passed, was_paused) in enumerate(steps):
        now += passed
        if was_paused:
            played.follow_clock()
        stamp = 10**9 + number % length * INTERVAL
        stamps.append(stamp + played.delay_of(stamp, rate))
        if was_paused or number % length == 0:
            assert stamps[-1] >= now
        elif number:
            assert stamps[-1] - stamps[-2] == interval
    assert stamps[0] == START + steps[0][0]
    gaps = [second - first for first, second in itertools.pairwise(stamps)]
    # The first frame has no interval yet.
    assert min(gaps[1:], default=interval) >= interval
    assert min(gaps) >= 0


@given(rates=st.lists(st.floats(0.1, 10.0), min_size=50, max_size=50))
def test_stamps_stay_with_the_clock_at_any_rate(rates):
    now = START
    played = Restamper(lambda: now)
    for number, rate in enumerate(rates):
        if number:
            now += round(INTERVAL / rate)
        stamp = 10**9 + number * INTERVAL
        assert stamp + played.delay_of(stamp, rate) == now
