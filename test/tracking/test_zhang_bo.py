"""The preset `zhang_bo`: background model and Kalman proposal."""

import numpy as np
import pytest

from pf_tracker_ros import Tracker

FIRST = (20.0, 60.0, 20.0, 30.0)


def street(step):
    """A textured wall that a red box passes at 3 px a frame."""
    image = np.random.default_rng(0).integers(60, 140, (160, 240, 3)).astype(np.uint8)
    x = 20 + 3 * step
    image[60:90, x : x + 20] = (30, 30, 220)
    image[60:75, x : x + 20] = (200, 160, 20)
    return image


def run(seed=0, frames=50, **parameters):
    tracker = Tracker.from_preset("zhang_bo", seed=seed, parameters=parameters)
    tracker.start(street(0), FIRST)
    return [tracker.update(street(step), 0.04) for step in range(1, frames)]


@pytest.mark.parametrize(
    "parameters",
    [
        # Without the Kalman filter's velocity, only a wider random walk keeps up.
        {"proposal.method": "transition", "motion.position_noise": 1.0},
        {"motion.model": "second_order_autoregressive"},
        {"cues": ("color_histogram", "gradient_orientation", "foreground")},
        {"foreground.weight": 0.0},
        {"cues": ("foreground_color_histogram", "gradient_orientation")},
    ],
)
def test_each_part_can_be_left_out_or_extended(parameters):
    x, _, width, _ = run(**parameters)[-1].box
    assert x + width / 2 == pytest.approx(20 + 3 * 49 + 10, abs=6)


def test_an_estimate_has_the_state_of_the_background_model():
    estimates = run(frames=20)
    # The model starts with the first image.
    assert [str(e.background) for e in estimates] == ["learning"] * 14 + ["ready"] * 5
    tracker = Tracker.from_preset("zhang_bo")
    assert str(tracker.start(street(0), FIRST).background) == "learning"
    assert Tracker.from_preset("default").start(street(0), FIRST).background is None


def test_a_camera_that_moves_disables_the_background_model_until_it_has_learned_again():
    tracker = Tracker.from_preset("zhang_bo")
    tracker.start(street(0), FIRST)
    for step in range(1, 20):
        tracker.update(street(step), 0.04)
    states = []
    for step in range(20, 60):
        image = 255 - street(0)
        x = 20 + 3 * step
        image[60:90, x : x + 20] = street(step)[60:90, x : x + 20]
        states.append(tracker.update(image, 0.04).background.name)
    assert states == ["off"] * 16 + ["learning"] * 15 + ["ready"] * 9
    x, _, width, _ = tracker.estimate.box
    assert x + width / 2 == pytest.approx(20 + 3 * 59 + 10, abs=6)
