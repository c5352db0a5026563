"""Bad images, boxes, intervals and seeds are refused, and the target is kept."""

from datetime import timedelta

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.targets.multi_tracker import MultiTracker

BOX = (82.0, 82.0, 36.0, 36.0)


def _texture():
    noise = np.random.default_rng(1).integers(0, 255, (40, 53, 3), dtype=np.uint8)
    return cv2.resize(noise, (320, 240), interpolation=cv2.INTER_CUBIC)


IMAGE = _texture()


@pytest.mark.parametrize(
    ("box", "complaint"),
    [
        ((10, 10, 0, 20), "too small"),
        ((10, 10, 321, 20), "larger than the image, 320 x 240"),
        ((400, 10, 20, 20), "outside the image, 320 x 240"),
        ((-30, 10, 20, 20), "outside the image"),
        ((10, 10, float("nan"), 20), "finite"),
        ((10, 10, float("inf"), 20), "finite"),
        ((10, 10, 20), "four"),
        ("here", "four"),
        (None, "four"),
        (("10", "10", "20", "20"), "four finite numbers"),
        ((10, 10, 20, None), "four finite numbers"),
        (np.array([10, 10, 20, 20], dtype=object), "four finite numbers"),
        ((10, True, 20, 20), "four finite numbers"),
        (np.ones(4, bool), "four finite numbers"),
        ((10, 10, 20, 20j), "four finite numbers"),
        (np.full(4, np.timedelta64(20, "s")), "four finite numbers"),
        ([[10, 10, 20, 20]], "four finite numbers"),
        ((10, 10, (20, 20)), "four finite numbers"),
        ({"x": 10, "y": 10, "width": 20, "height": 20}, "four finite numbers"),
        ((10, 10, 20, 10**400), "four finite numbers"),
    ],
)
def test_a_bad_box_is_refused_and_the_target_before_is_kept(box, complaint):
    tracker = Tracker.from_preset("li2007")
    tracker.start(IMAGE, BOX)
    before = tracker.estimate
    with pytest.raises(ValueError, match=complaint):
        tracker.start(IMAGE, box)
    assert tracker.estimate is before


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((240, 320, 4), np.uint8),
        np.zeros((240, 320, 3), np.float32),
        np.zeros((240, 320), np.int16),
        np.zeros((0, 320), np.uint8),
        np.zeros(320, np.uint8),
        [[0, 1], [2, 3]],
        np.zeros((100, 320, 3), np.uint8),
        np.zeros((240, 320), np.uint8),
    ],
)
def test_a_bad_image_is_refused_and_the_target_is_kept(image):
    tracker = Tracker.from_preset("li2007")
    tracker.start(IMAGE, BOX)
    before = tracker.estimate
    with pytest.raises(ValueError, match="image is"):
        tracker.update(image)
    assert tracker.estimate is before
    assert tracker.update(IMAGE).box == pytest.approx(BOX, abs=4)


@pytest.mark.parametrize("kind", [np.float64, np.float16, ">f4"])
def test_other_pixel_types_are_refused(kind):
    with pytest.raises(ValueError, match=r"allowed: .* uint8, uint16 or float32"):
        Tracker.from_preset("li2007").start(np.zeros((240, 320), kind), BOX)


@pytest.mark.parametrize("kind", [tuple, list, np.array, np.float32, np.uint8])
def test_a_box_of_any_numbers_is_taken(kind):
    tracker = Tracker.from_preset("li2007")
    estimate = tracker.start(IMAGE, kind((10, 12, 20, 24)))
    assert estimate.box == (10.0, 12.0, 20.0, 24.0)
    numbers = (np.float32(10), np.int64(12), np.array(20), 24.0)
    assert tracker.start(IMAGE, numbers) == estimate


@pytest.mark.parametrize(
    "interval",
    [
        *(-0.1, float("nan"), float("inf"), np.float32("nan")),
        pytest.param(10**400, id="too large for a float"),
        *("0.04", b"0.04", True, np.True_, 0.04 + 0j, np.complex64(1), object(), {}),
        *([], [0.04], (None,), np.array([0.04]), np.array([None]), np.array(None)),
        *(np.array("0.04"), timedelta(seconds=0.04), np.timedelta64(40, "ms")),
    ],
)
def test_a_bad_interval_is_refused(interval):
    tracker = Tracker.from_preset("li2007")
    tracker.start(IMAGE, BOX)
    before = tracker.estimate
    with pytest.raises(ValueError, match=r"dt is .*; allowed: a finite number of seconds from 0"):
        tracker.update(IMAGE, dt=interval)
    assert tracker.estimate is before


@pytest.mark.parametrize(
    "interval", [2, 2.0, np.float32(2), np.float64(2), np.int8(2), np.array(2)]
)
def test_any_real_number_is_an_interval(interval):
    trackers = [Tracker.from_preset("li2007") for _ in range(2)]
    for tracker in trackers:
        tracker.start(IMAGE, BOX)
    given, expected = (
        tracker.update(IMAGE, dt=dt) for tracker, dt in zip(trackers, (interval, 2.0), strict=True)
    )
    assert given == expected


@pytest.mark.parametrize("seed", [-1, 1.5, 1.0, "1", True, None, [1], np.float64(3), np.int64(-1)])
@pytest.mark.parametrize("kind", [Tracker, MultiTracker])
def test_a_bad_seed_is_refused_at_once(kind, seed):
    with pytest.raises(ValueError, match=r"seed is .*; allowed: a whole number from 0 up"):
        kind.from_preset("li2007", seed=seed)


def test_any_whole_number_is_a_seed():
    estimates = [
        Tracker.from_preset("li2007", seed).start(IMAGE, BOX)
        for seed in (7, np.uint8(7), 7 + 2**70)
    ]
    assert estimates[0] == estimates[1] != estimates[2]
