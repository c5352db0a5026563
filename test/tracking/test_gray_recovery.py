"""After bad frames of a camera of more than 8 bits, the target is tracked again in a second."""

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Tracker

RATE = 25
KINDS = {"16 bit": (np.uint16, 7000.0, 4.0), "32 bit": (np.float32, 290.0, 0.05)}


@pytest.fixture(params=KINDS)
def kind(request):
    return request.param


@pytest.fixture
def camera(kind, moving_square):
    """A function that takes an image of the square, which does not move."""
    dtype, base, unit = KINDS[kind]
    gray = cv2.cvtColor(moving_square.images[0], cv2.COLOR_BGR2GRAY).astype(float)
    generator = np.random.default_rng(0)

    def image():
        return (base + unit * (gray + generator.normal(0.0, 1.0, gray.shape))).astype(dtype)

    return image


def bad_image(name, kind, image):
    image = image.copy()
    if name == "outliers":
        image.flat[::50] = 65535 if kind == "16 bit" else 1e9
    elif name == "noise":
        image[:] = np.random.default_rng(1).uniform(0, 60000, image.shape)
    else:
        image[:] = {"saturated": 65535, "zeros": 0}[name]
    return image


def start(camera, box):
    tracker = Tracker.from_preset("default", seed=1)
    tracker.start(camera(), box)
    for _ in range(RATE):
        estimate = tracker.update(camera(), 1 / RATE)
    assert estimate.state == "tracking"
    return tracker


def is_tracked(estimate, box):
    return estimate.state == "tracking" and np.abs(np.subtract(estimate.box, box)).max() < 6


@pytest.mark.parametrize(
    ("name", "bad_frames"),
    [
        ("saturated", 1),
        ("outliers", 1),
        ("zeros", RATE),
        ("noise", RATE),
        ("outliers", RATE),
        ("zeros", 5 * RATE),
        ("noise", 5 * RATE),
    ],
)
def test_the_target_is_tracked_again_soon_after_bad_frames(
    name, bad_frames, kind, camera, moving_square
):
    """Within a second: it may take half of it to search where the target was."""
    box = moving_square.boxes[0]
    tracker = start(camera, box)
    bad = bad_image(name, kind, camera())
    for _ in range(bad_frames):
        tracker.update(bad, 1 / RATE)
    for _ in range(RATE):
        estimate = tracker.update(camera(), 1 / RATE)
    assert is_tracked(estimate, box)
    for _ in range(RATE):
        assert is_tracked(tracker.update(camera(), 1 / RATE), box)


def test_a_new_target_is_tracked_at_once_after_bad_frames(kind, camera, moving_square):
    box = moving_square.boxes[0]
    tracker = start(camera, box)
    for name in ("zeros", "saturated", "outliers"):
        for _ in range(RATE):
            tracker.update(bad_image(name, kind, camera()), 1 / RATE)
    tracker.start(camera(), box)
    for _ in range(3):
        assert is_tracked(tracker.update(camera(), 1 / RATE), box)


@pytest.mark.parametrize("preset", ["default", "li2007", "zhang2015", "zhang_bo"])
def test_images_of_32_and_16_bits_give_the_same_estimates(preset, moving_square):
    """They have the same values."""
    trackers = [Tracker.from_preset(preset, seed=2) for _ in range(2)]
    box = moving_square.boxes[0]
    for number, image in enumerate(moving_square.images[:10]):
        gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.uint16) * 12 + 7000
        whole, real = gray, gray.astype(np.float32)
        if number:
            estimates = [t.update(i) for t, i in zip(trackers, (whole, real), strict=True)]
        else:
            estimates = [t.start(i, box) for t, i in zip(trackers, (whole, real), strict=True)]
        assert estimates[0] == estimates[1]


def test_pixels_that_are_not_finite_are_no_error(moving_square):
    tracker = Tracker.from_preset("default", seed=2)
    for number, image in enumerate(moving_square.images):
        real = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32) / 255
        real[:10], real[-10:, ::3] = np.nan, np.inf
        if number:
            estimate = tracker.update(real)
        else:
            tracker.start(real, moving_square.boxes[0])
    assert is_tracked(estimate, moving_square.boxes[-1])
