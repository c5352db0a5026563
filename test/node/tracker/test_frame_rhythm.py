"""What stamps tell of frames that never came."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.node.tracker.frame_rhythm import Rhythm, loss_message, rhythm

START = 1_700_000_000_000_000_000


def camera(rate, count, jitter=0.0, seed=0):
    """Stamps of a camera, each off by up to a share of the interval."""
    noise = np.random.default_rng(seed).uniform(-jitter, jitter, count)
    return [START + round((index + off) / rate * 1e9) for index, off in enumerate(noise)]


@given(
    rate=st.floats(1.0, 120.0),
    kept=st.floats(0.25, 1.0),
    jitter=st.floats(0.0, 0.05),
    seed=st.integers(0, 1000),
)
def test_the_share_of_lost_frames_and_the_rate_are_found(rate, kept, jitter, seed):
    stamps = np.array(camera(rate, 300, jitter, seed))
    came = stamps[np.random.default_rng(seed).random(300) < kept]
    came = came[: 2 + int(np.argmax(np.append(np.diff(came), 3e9) >= 1.9e9))]
    found = rhythm(came.tolist())
    if len(came) < 60:
        return
    between = np.searchsorted(stamps, came[-1]) - np.searchsorted(stamps, came[0])
    assert found.interval == pytest.approx(1.0 / rate, rel=0.1)
    assert found.lost_share == pytest.approx(1.0 - (len(came) - 1) / between, abs=0.05)


@pytest.mark.parametrize(
    "stamps",
    [[], [START], camera(30.0, 10), [START] * 100, [0] * 5],
    ids=["none", "one", "few", "one again and again", "no stamps"],
)
def test_too_few_stamps_tell_nothing(stamps):
    assert rhythm(stamps) is None


def test_a_camera_without_a_rhythm_is_not_said_to_lose_frames():
    gaps = np.random.default_rng(1).uniform(10e6, 90e6, 200)
    assert rhythm((START + np.cumsum(gaps)).astype(np.int64).tolist()) is None


def test_a_pause_is_no_loss_and_neither_are_doubles_or_another_order():
    stamps = camera(25.0, 50)
    later = [stamp + 60_000_000_000 for stamp in camera(25.0, 50)]
    assert rhythm([*later, *stamps, *stamps]) == Rhythm(pytest.approx(0.04), 0.0)


@pytest.mark.parametrize(
    ("processing", "reliability", "words"),
    [
        (
            0.005,
            "best_effort",
            ["lost on the way", "publish reliably", "image_reliability be auto"],
        ),
        (0.005, "reliable", ["lost on the way although they are sent reliably", "large_images"]),
        (0.080, "reliable", ["passed over", "every 40 ms but takes 80 ms", "fewer particles"]),
    ],
)
def test_the_cause_and_the_cure_are_named(processing, reliability, words):
    text = loss_message(Rhythm(0.04, 0.5), processing, "/camera/image_raw", reliability)
    assert text.startswith("about 50 % of the frames on /camera/image_raw are ")
    assert [word for word in words if word not in text] == []
