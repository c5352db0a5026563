"""Rate and loss of a camera, estimated from stamps."""

from itertools import chain

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.node.tracker.diagnostics import FrameStatistics, frame_statistics, loss_warning

START = 1_700_000_000_000_000_000


def camera(rate, count, jitter=0.0, seed=0):
    """Stamps of a camera, each off by up to a share of the interval."""
    noise = np.random.default_rng(seed).uniform(-jitter, jitter, count)
    return [START + round((index + off) / rate * 1e9) for index, off in enumerate(noise)]


def seconds(stamps):
    """Arrival times as even as the stamps."""
    return [stamp * 1e-9 for stamp in stamps]


def found_in(stamps):
    return frame_statistics(stamps, seconds(stamps))


@given(
    rate=st.floats(5.0, 120.0),
    kept=st.floats(0.5, 1.0),
    jitter=st.floats(0.0, 0.05),
    seed=st.integers(0, 1000),
)
def test_rate_and_loss_are_estimated(rate, kept, jitter, seed):
    stamps = np.array(camera(rate, 300, jitter, seed))
    received = np.random.default_rng(seed).random(300) < kept
    received[[0, -1]] = True
    found = found_in(stamps[received].tolist())
    assert found.interval == pytest.approx(1.0 / rate, rel=0.1)
    assert found.frame_loss_rate == pytest.approx(1.0 - received.mean(), abs=0.1)


def test_there_is_nearly_always_an_estimate_if_most_frames_are_lost():
    without = 0
    for seed in range(200):
        received = np.random.default_rng(seed).random(300) < 0.4
        received[[0, -1]] = True
        found = found_in(np.array(camera(5.0, 300))[received].tolist())
        without += found is None
        if found:
            assert found.frame_loss_rate == pytest.approx(1.0 - received.mean(), abs=0.1)
    assert without <= 4


def test_a_looped_recording_counts_each_time():
    """Each loop loses other frames, so that hardly any is always missing."""
    random = np.random.default_rng(3)
    received = [random.random(60) < 0.7 for _ in range(5)]
    stamps = [np.array(camera(30.0, 60))[kept].tolist() for kept in received]
    arrivals = [[2.0 * turn + 1e-9 * one for one in part] for turn, part in enumerate(stamps)]
    found = frame_statistics([*chain(*stamps)], [*chain(*arrivals)])
    assert found.interval == pytest.approx(1.0 / 30.0, rel=0.1)
    assert found.frame_loss_rate == pytest.approx(1.0 - np.mean(received), abs=0.05)


@pytest.mark.parametrize(
    "stamps",
    [[], [START], camera(30.0, 10), [START] * 100, [0] * 5],
    ids=["none", "one", "few", "one again and again", "no stamps"],
)
def test_too_few_stamps_give_no_estimate(stamps):
    assert found_in(stamps) is None


def with_pause(seconds):
    later = [stamp + round(seconds * 1e9) for stamp in camera(30.0, 75)]
    return [*camera(30.0, 75), *(stamp + 2_500_000_000 for stamp in later)]


@pytest.mark.parametrize(
    "stamps",
    [
        with_pause(0.2),
        with_pause(1.0),
        with_pause(60.0),
        [*camera(25.0, 50), *camera(25.0, 50)],
        camera(25.0, 50)[::-1],
        camera(25.0, 20) + camera(25.0, 60)[25:],
    ],
    ids=["short pause", "pause", "long pause", "twice", "backward", "one gap"],
)
def test_pauses_duplicates_and_another_order_are_no_losses(stamps):
    assert found_in(stamps).frame_loss_rate == 0.0


def test_irregular_stamps_give_no_estimate():
    gaps = np.random.default_rng(1).uniform(10e6, 90e6, 200)
    assert found_in((START + np.cumsum(gaps)).astype(np.int64).tolist()) is None


@pytest.mark.parametrize("apart", [1_000, 1_000_000, 3_000_000])
def test_two_cameras_give_no_estimate(apart):
    stamps = camera(30.0, 75)
    both = sorted([*stamps, *(stamp + apart for stamp in stamps)])
    assert found_in(both) is None


@pytest.mark.parametrize("rates", [(30.0, 15.0), (60.0, 15.0), (15.0, 30.0)])
def test_a_change_of_the_rate_gives_no_estimate(rates):
    before, after = rates
    stamps = camera(before, round(2.5 * before))
    stamps += [stamp + 2_500_000_000 for stamp in camera(after, round(2.5 * after))]
    assert found_in(stamps) is None


@pytest.mark.parametrize("order", ["alternating", "random", "a third", "in turns"])
def test_a_camera_with_two_intervals_loses_nothing(order):
    """Such as one that doubles its exposure in the dark: 33 or 67 ms."""
    random = np.random.default_rng(2)
    is_long = {
        "alternating": np.arange(100) % 2,
        "random": random.integers(0, 2, 100),
        "a third": random.integers(0, 3, 100) == 0,
        "in turns": np.arange(100) // 10 % 2,
    }[order]
    gaps = np.where(is_long, 66_700_000, 33_300_000)
    assert found_in((START + np.cumsum(gaps)).tolist()) is None


@pytest.mark.parametrize(("rate", "tick"), [(60.0, 10_000_000), (50.0, 15_600_000)])
def test_coarse_stamps_are_no_losses(rate, tick):
    even = camera(rate, 300)
    coarse = [stamp // tick * tick for stamp in even]
    found = frame_statistics(coarse, seconds(even))
    assert found is None or found.frame_loss_rate < 0.05


@pytest.mark.parametrize(
    ("reliability", "words"),
    [
        (
            "best_effort",
            ["lost on the way with best-effort", "publish them reliably", "large_images:=true"],
        ),
        ("reliable", ["lost on the way despite reliable delivery", "large_images"]),
    ],
)
def test_the_warning_has_cause_and_remedy(reliability, words):
    text = loss_warning(FrameStatistics(0.04, 0.5), "/camera/image_raw", reliability)
    assert text.startswith("about 50 % of the frames on /camera/image_raw are ")
    assert [word for word in words if word not in text] == []
