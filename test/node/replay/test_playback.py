"""The schedule of a playback, without ROS."""

import contextlib
import threading
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.node.replay import playback as module
from pf_tracker_ros.node.replay.playback import (
    TOLERATED_LAG,
    Playback,
    PlaybackStopped,
    SeekRequested,
)

MILLISECOND = 1_000_000


@pytest.fixture(scope="module")
def clock():
    """A clock of whole playbacks, which passes only while they wait; its time in seconds."""
    with pytest.MonkeyPatch.context() as patch:
        clock = SimpleNamespace(now=0.0)
        patch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock.now))
        yield clock


def play(clock, times, rate):
    """Wait for all times in turn; returns when each was due, in seconds from now."""
    playback, began, due = timed(clock), clock.now, []
    for item_time in times:
        playback.wait_until_due(item_time, rate)
        due.append(clock.now - began)
    return due


def timed(clock):
    """A playback that waits by the clock."""

    def wait(seconds):
        clock.now += seconds

    playback = Playback()
    playback._changed.wait = wait
    return playback


@given(st.lists(st.integers(0, 30), min_size=1, max_size=4), st.floats(0.5, 10.0))
def test_every_item_is_due_at_its_time(clock, gaps, rate):
    times = [5 * MILLISECOND]
    for gap in gaps:
        times.append(times[-1] + gap * MILLISECOND)
    due = play(clock, times, lambda: rate)
    expected = [(item_time - times[0]) * 1e-9 / rate for item_time in times]
    assert due == pytest.approx(expected, abs=1e-9)


def test_everything_without_a_rate_and_an_item_with_an_earlier_time_are_due_at_once(clock):
    assert play(clock, [0, 10**12, 10**15], None) == [0.0] * 3
    assert play(clock, [10**15, 0, 1], lambda: 1.0) == pytest.approx([0.0, 0.0, 1e-9])


@pytest.mark.parametrize("resumed", [True, False])
def test_a_delayed_item_is_no_lag_of_the_next(clock, resumed):
    playback = timed(clock)
    playback.wait_until_due(0, lambda: 1.0)
    clock.now += 5.0
    if resumed:
        playback.restart_schedule()
    clock.now += 0.02
    lag = playback.wait_until_due(20 * MILLISECOND, lambda: 1.0)
    assert lag == pytest.approx(0.0 if resumed else 5.0)


def test_the_next_pass_starts_one_interval_after_the_last_item(clock):
    playback = timed(clock)
    playback.wait_until_due(0, lambda: 1.0)
    playback.wait_until_due(60 * MILLISECOND, lambda: 1.0)
    playback.begin_pass()
    began = clock.now
    playback.wait_until_due(0, lambda: 1.0)
    assert clock.now - began == pytest.approx(0.06)


def test_cancelled_steps_publish_nothing():
    playback = Playback(paused=True)
    playback.step(3)
    playback.wait_until_due(0, None)
    playback.drop_steps()
    threading.Timer(0.05, playback.stop).start()
    with pytest.raises(PlaybackStopped):
        playback.wait_until_due(1, None)


def test_a_lag_is_reported_and_not_caught_up(clock):
    playback = timed(clock)
    playback.wait_until_due(0, lambda: 1.0)
    clock.now += 0.2 + TOLERATED_LAG
    lag = playback.wait_until_due(MILLISECOND, lambda: 1.0)
    assert lag == pytest.approx(0.199 + TOLERATED_LAG)
    began = clock.now
    playback.wait_until_due(51 * MILLISECOND, lambda: 1.0)
    assert clock.now - began == pytest.approx(0.05)


WAITS = {
    "due": lambda playback: playback.wait_until_due(10**15, lambda: 1.0),
    "status": lambda playback: playback.wait_until_processed(7, 1000.0),
    "condition": lambda playback: playback.wait_for(lambda: False, 1000.0),
    "end": lambda playback: playback.wait_at_end(),
}


def started(*, paused):
    """A playback whose first item was due."""
    playback = Playback()
    playback.wait_until_due(0, None)
    playback.paused = paused
    return playback


@pytest.mark.parametrize("kind", WAITS)
@pytest.mark.parametrize("paused", [True, False])
def test_stopping_ends_every_wait(kind, paused):
    playback = started(paused=paused)
    threading.Timer(0.05, playback.stop).start()
    for _ in range(2):
        with pytest.raises(PlaybackStopped):
            WAITS[kind](playback)
    assert playback.paused == (paused or kind == "end")


@pytest.mark.parametrize("kind", ["due", "status", "end"])
@pytest.mark.parametrize("paused", [True, False])
def test_seeking_ends_every_wait_once_and_steps(kind, paused):
    playback = started(paused=paused)
    threading.Timer(0.05, playback.seek, (3,)).start()
    with pytest.raises(SeekRequested) as sought:
        WAITS[kind](playback)
    assert sought.value.args == (3,)
    playback.begin_pass()
    playback.wait_until_due(0, lambda: 1.0)


def test_a_report_counts_for_its_own_stamp_only():
    playback = Playback()
    playback.mark_processed(6)
    assert not playback.wait_until_processed(7, 0.01)
    threading.Timer(0.05, playback.mark_processed, (7,)).start()
    assert playback.wait_until_processed(7, 30.0)
    playback.clear_processed()
    assert not playback.wait_until_processed(7, 0.01)


def test_a_paused_item_is_due_on_resume():
    playback = Playback(paused=True)
    released = threading.Event()

    def go_on():
        released.set()
        playback.paused = False

    threading.Timer(0.1, go_on).start()
    playback.wait_until_due(0, None)
    assert released.is_set()


def test_steps_are_due_at_once_during_a_pause():
    playback = Playback(paused=True)
    playback.step(2)
    passed = []

    def run():
        with contextlib.suppress(PlaybackStopped):
            for item in range(4):
                playback.wait_until_due(item * 10**12, lambda: 1.0)
                passed.append(item)

    thread = threading.Thread(target=run)
    thread.start()
    assert playback.wait_until_held(30.0)
    assert passed == [0, 1]
    playback.step()
    assert playback.wait_until_held(30.0)
    assert passed == [0, 1, 2]
    playback.stop()
    thread.join()
