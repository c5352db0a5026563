"""Which of the kept frames an age is of."""

import tracemalloc

import numpy as np
import pytest

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.crowd import Crowd
from pf_tracker_ros.targets.history import History, Moment


def history_of(intervals, first=0):
    """Frames so many seconds after each other, the first of which is the so manieth of all."""
    history = History()
    for number, interval in enumerate(intervals, first):
        history.add(Moment(Frame(np.zeros((4, 4), np.uint8)), interval, Crowd(frame=number)))
    return history


def numbers(moments):
    return None if moments is None else [moment.before.frame for moment in moments]


@pytest.mark.parametrize("rate", [7, 25, 30, 60, 120, 500])
def test_it_is_of_the_nearest_frame_however_fast_they_come(rate):
    history = history_of([1 / rate] * 6)
    for back in range(6):
        for off in (-0.45, 0.0, 0.45):
            assert numbers(history.since((back + off) / rate)) == list(range(5 - back, 6))


def test_frames_at_odd_times_are_told_apart_half_way_between_them():
    history = history_of([0.1, 0.01, 0.3])
    assert numbers(history.since(0.149)) == [2]
    assert numbers(history.since(0.151)) == [1, 2]
    assert numbers(history.since(0.304)) == [1, 2]
    assert numbers(history.since(0.306)) == [0, 1, 2]


def test_before_the_frames_that_are_kept_there_is_none():
    history = history_of([1 / 60] * 3, first=10)
    assert numbers(history.since(2 / 60)) == [10, 11, 12]
    assert history.since(3 / 60) is None
    assert History().since(0.0) is None


def test_what_is_a_little_older_than_the_first_frame_of_all_is_of_that():
    history = history_of([0.0, 1 / 60])
    assert numbers(history.since(1 / 60 + 0.019)) == [0, 1]
    assert history.since(1 / 60 + 0.021) is None


def test_of_all_frames_but_the_newest_only_the_image_is_kept():
    image = np.random.default_rng(0).integers(0, 60_000, (400, 400), dtype=np.uint16)
    history = History()
    seen = []
    tracemalloc.start()
    for number in range(5):
        frame = Frame(image.copy(), span=(0.0, 60_000.0))
        seen.append((frame, frame.pixels.copy()))
        history.add(Moment(frame, 0.04, Crowd(frame=number)))
    held = tracemalloc.get_traced_memory()[0] - sum(view.nbytes for _, view in seen)
    tracemalloc.stop()
    # Five images, and one view of 8 bit.
    assert held < 5.6 * image.nbytes
    for frame, view in seen:
        np.testing.assert_array_equal(frame.pixels, view)
