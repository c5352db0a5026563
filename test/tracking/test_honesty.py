"""Is it told when it is not the target? Small forms of `benchmarks/honesty.py`."""

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation import overlap

WIDTH, HEIGHT, SIDE = 240, 160, 32
INTERVAL = 0.04


def texture(seed, height, width, low=0, high=250):
    noise = np.random.default_rng(seed).integers(low, high, (height // 6, width // 6, 3))
    return cv2.resize(noise.astype(np.uint8), (width, height), interpolation=cv2.INTER_CUBIC)


GROUND, TARGET = texture(1, HEIGHT, WIDTH, 60, 160), texture(2, SIDE, SIDE)


def shown(x, y, ground=GROUND, sprite=TARGET):
    """The target at a place, cut off at the borders."""
    image = ground.copy()
    left, top, right, bottom = max(x, 0), max(y, 0), min(x + SIDE, WIDTH), min(y + SIDE, HEIGHT)
    if right > left and bottom > top:
        image[top:bottom, left:right] = sprite[top - y : bottom - y, left - x : right - x]
    return image


def box(x, y):
    return (float(x), float(y), float(SIDE), float(SIDE))


def overlap_with(estimate, x, y):
    return float(overlap(np.array([estimate.box]), np.array([box(x, y)]))[0])


def walked(seed=0, frames=30, ground=GROUND):
    """A tracker whose target has walked from (40, 40) to the right, 2 px a frame."""
    tracker = Tracker.from_preset("default", seed)
    tracker.start(shown(40, 40, ground), box(40, 40))
    for frame in range(1, frames):
        estimate = tracker.update(shown(40 + 2 * frame, 40, ground), INTERVAL)
    assert estimate.state == "tracking"
    assert overlap_with(estimate, 40 + 2 * (frames - 1), 40) > 0.8
    return tracker


@pytest.mark.parametrize("frames", [1, 3])
@pytest.mark.parametrize("seed", range(3))
def test_a_flash_in_which_the_target_looks_like_nothing_leaves_no_trace(frames, seed):
    """It saturates, so that what is seen in it is not what was learned, nor what comes after."""
    ground = texture(1, HEIGHT, WIDTH, 30, 80)[..., :1].repeat(3, axis=2)
    target = texture(2, SIDE, SIDE, 80, 200)[..., :1].repeat(3, axis=2)
    tracker = Tracker.from_preset("default", seed)
    tracker.start(shown(40, 40, ground, target), box(40, 40))
    for index in range(1, 50):
        image = shown(40 + 2 * index, 40, ground, target)
        is_flash = 20 <= index < 20 + frames
        estimate = tracker.update(
            cv2.convertScaleAbs(image, alpha=3.0 if is_flash else 1.0), INTERVAL
        )
        if index == 20:
            assert estimate.state != "tracking"
        if index >= 30:
            assert estimate.state == "tracking", index
    assert overlap_with(estimate, 40 + 2 * 49, 40) > 0.88


@pytest.mark.parametrize("gain", [0.5, 1.7])
@pytest.mark.parametrize("seed", range(3))
def test_light_that_jumps_leaves_the_target_where_it_is(gain, seed):
    """Beside the target is what has its colors once the light has changed."""
    plain = texture(4, HEIGHT, WIDTH, 60, 130)
    target = texture(5, SIDE, SIDE, 0, 40) + np.array([0, 20, 90], np.uint8)
    decoy = np.clip(target / gain, 0, 255).astype(np.uint8)

    def image(index, light):
        drawn = shown(40 + index, 40, plain, target)
        drawn[60 : 60 + SIDE, 110 : 110 + SIDE] = decoy
        return cv2.convertScaleAbs(drawn, alpha=light)

    tracker = Tracker.from_preset("default", seed)
    tracker.start(image(0, 1.0), box(40, 40))
    for index in range(1, 50):
        estimate = tracker.update(image(index, 1.0 if index < 20 else gain), INTERVAL)
        assert overlap_with(estimate, 40 + index, 40) > 0.6, index
    assert estimate.state == "tracking"


@pytest.mark.parametrize("pattern", [5, 6])
@pytest.mark.parametrize("seed", range(2))
def test_a_target_that_the_light_makes_white_is_followed_as_white(pattern, seed):
    """Nothing is left of its texture, and what was learned of it would fit anything."""
    ground = texture(4, HEIGHT, WIDTH, 40, 200)
    target = texture(pattern, SIDE + 16, SIDE + 16, 150)[8:-8, 8:-8]
    tracker = Tracker.from_preset("default", seed)
    tracker.start(shown(20, 60, ground, target), box(20, 60))
    for index in range(1, 80):
        drawn = shown(20 + 2 * index, 60, ground, target)
        lit = cv2.convertScaleAbs(drawn, alpha=1.0 if index < 20 else 1.7)
        estimate = tracker.update(lit, INTERVAL)
        assert overlap_with(estimate, 20 + 2 * index, 60) > 0.6, index


@pytest.mark.parametrize("seed", range(3))
def test_another_scene_is_not_the_target(seed):
    tracker = walked(seed)
    states = []
    for index in range(40):
        scene = np.roll(texture(9, HEIGHT, WIDTH, 0, 220), 2 * index, 1)
        estimate = tracker.update(scene, INTERVAL)
        states.append(estimate.state == "tracking" and estimate.confidence > 0.5)
    assert sum(states) <= 1


def lost(tracker, frames=80):
    """The same without the target."""
    for _ in range(frames):
        estimate = tracker.update(GROUND, INTERVAL)
    assert estimate.state == "lost"
    return estimate


@pytest.mark.parametrize("seed", range(3))
def test_a_lost_target_keeps_the_size_that_it_had_last(seed):
    tracker = walked(seed)
    before = tracker.estimate.box
    after = lost(tracker, 220).box
    assert after[2:] == pytest.approx(before[2:], rel=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_found_again_is_hidden_until_several_frames_agree(seed):
    """And then it is tracked, elsewhere, at once."""
    tracker = walked(seed)
    lost(tracker)
    told = []
    for _ in range(60):
        estimate = tracker.update(shown(20, 110), INTERVAL)
        told.append((estimate.state, overlap_with(estimate, 20, 110) > 0.5))
    found = [is_there for _, is_there in told].index(True)
    assert "tracking" not in [state for state, _ in told[found : found + 3]]
    assert told[-1] == ("tracking", True)


@pytest.mark.parametrize("seed", range(3))
def test_a_look_alike_is_left_for_the_target_itself(seed):
    """While it is gone, something with its colors in another order stands somewhere else."""
    tracker = walked(seed)
    lost(tracker)
    other = cv2.rotate(TARGET, cv2.ROTATE_180)
    decoy = shown(150, 20, sprite=other)
    for _ in range(40):
        estimate = tracker.update(decoy, INTERVAL)
    for _ in range(60):
        estimate = tracker.update(shown(20, 110, decoy), INTERVAL)
    assert estimate.state == "tracking"
    assert overlap_with(estimate, 20, 110) > 0.5


@pytest.mark.parametrize("apart", [34, 44])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("look_alike", [TARGET, np.roll(TARGET, 6, axis=1)])
def test_what_stood_beside_the_target_is_never_taken_for_it(look_alike, apart, seed):
    """Not when the target goes, not as long as it is gone; and then it is found beside it."""
    ground = shown(98 + apart, 40, sprite=look_alike)
    tracker = walked(seed, ground=ground)
    for _ in range(100):
        estimate = tracker.update(ground, INTERVAL)
        assert estimate.state != "tracking"
    for _ in range(30):
        estimate = tracker.update(shown(98, 40, ground), INTERVAL)
    assert estimate.state == "tracking"
    assert overlap_with(estimate, 98, 40) > 0.6


@pytest.mark.parametrize("seed", range(3))
def test_a_target_that_comes_into_view_before_its_look_alike_is_found_once_clear_of_it(seed):
    """It goes behind a post, beside which the other one stands."""
    ground = shown(110, 40, sprite=np.ascontiguousarray(TARGET[:, ::-1]))
    tracker = Tracker.from_preset("default", seed)
    for index in range(40):
        x = 20 + 4 * index
        image = shown(x, 40, ground)
        image[:, 70:100] = GROUND[:, 70:100]
        if tracker.started:
            estimate = tracker.update(image, INTERVAL)
        else:
            tracker.start(image, box(x, 40))
    assert estimate.state == "tracking"
    assert overlap_with(estimate, x, 40) > 0.6
