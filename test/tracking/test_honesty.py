"""Is it reported when the box is not the target? Short forms of `benchmarks/honesty.py`."""

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
    """An image of the target, clipped at the borders."""
    image = ground.copy()
    left, top, right, bottom = max(x, 0), max(y, 0), min(x + SIDE, WIDTH), min(y + SIDE, HEIGHT)
    if right > left and bottom > top:
        image[top:bottom, left:right] = sprite[top - y : bottom - y, left - x : right - x]
    return image


def box(x, y):
    return (float(x), float(y), float(SIDE), float(SIDE))


def overlap_with(estimate, x, y):
    return float(overlap(np.array([estimate.box]), np.array([box(x, y)]))[0])


def tracker_of_moving_target(seed=0, frames=30, ground=GROUND):
    """A tracker whose target has moved from (40, 40) to the right, 2 px a frame."""
    tracker = Tracker.from_preset("default", seed)
    tracker.start(shown(40, 40, ground), box(40, 40))
    for frame in range(1, frames):
        estimate = tracker.update(shown(40 + 2 * frame, 40, ground), INTERVAL)
    assert estimate.state == "tracking"
    assert overlap_with(estimate, 40 + 2 * (frames - 1), 40) > 0.8
    return tracker


@pytest.mark.parametrize("frames", [1, 3])
@pytest.mark.parametrize("seed", range(3))
def test_a_flash_that_saturates_the_target_has_no_lasting_effect(frames, seed):
    """The target in it matches neither the templates before nor the frames after."""
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
def test_the_target_is_tracked_through_a_jump_of_the_illumination(gain, seed):
    """Beside it is an object that has the target's colors after the jump."""
    plain = texture(4, HEIGHT, WIDTH, 60, 130)
    target = texture(5, SIDE, SIDE, 0, 40) + np.array([0, 20, 90], np.uint8)
    distractor = np.clip(target / gain, 0, 255).astype(np.uint8)

    def image(index, brightness):
        drawn = shown(40 + index, 40, plain, target)
        drawn[60 : 60 + SIDE, 110 : 110 + SIDE] = distractor
        return cv2.convertScaleAbs(drawn, alpha=brightness)

    tracker = Tracker.from_preset("default", seed)
    tracker.start(image(0, 1.0), box(40, 40))
    for index in range(1, 50):
        estimate = tracker.update(image(index, 1.0 if index < 20 else gain), INTERVAL)
        assert overlap_with(estimate, 40 + index, 40) > 0.6, index
    assert estimate.state == "tracking"


@pytest.mark.parametrize("pattern", [5, 6])
@pytest.mark.parametrize("seed", range(2))
def test_a_target_that_a_jump_of_the_illumination_saturates_is_tracked(pattern, seed):
    """Nothing is left of its texture, and templates of it would match anything."""
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
    tracker = tracker_of_moving_target(seed)
    states = []
    for index in range(40):
        scene = np.roll(texture(9, HEIGHT, WIDTH, 0, 220), 2 * index, 1)
        estimate = tracker.update(scene, INTERVAL)
        states.append(estimate.state == "tracking" and estimate.confidence > 0.5)
    assert sum(states) <= 1


def lost(tracker, frames=80):
    """The last estimate after frames without the target."""
    for _ in range(frames):
        estimate = tracker.update(GROUND, INTERVAL)
    assert estimate.state == "lost"
    return estimate


@pytest.mark.parametrize("seed", range(3))
def test_a_lost_target_keeps_its_last_size(seed):
    tracker = tracker_of_moving_target(seed)
    before = tracker.estimate.box
    after = lost(tracker, 220).box
    assert after[2:] == pytest.approx(before[2:], rel=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_a_redetected_target_is_not_tracked_until_several_frames_confirm_it(seed):
    """Then it is tracked in its new place at once."""
    tracker = tracker_of_moving_target(seed)
    lost(tracker)
    reported = []
    for _ in range(60):
        estimate = tracker.update(shown(20, 110), INTERVAL)
        reported.append((estimate.state, overlap_with(estimate, 20, 110) > 0.5))
    found = [is_there for _, is_there in reported].index(True)
    assert "tracking" not in [state for state, _ in reported[found : found + 3]]
    assert reported[-1] == ("tracking", True)


@pytest.mark.parametrize("seed", range(3))
def test_a_distractor_is_left_for_the_target(seed):
    """While the target is out of sight, an object with its colors is elsewhere."""
    tracker = tracker_of_moving_target(seed)
    lost(tracker)
    other = cv2.rotate(TARGET, cv2.ROTATE_180)
    distractor = shown(150, 20, sprite=other)
    for _ in range(40):
        estimate = tracker.update(distractor, INTERVAL)
    for _ in range(60):
        estimate = tracker.update(shown(20, 110, distractor), INTERVAL)
    assert estimate.state == "tracking"
    assert overlap_with(estimate, 20, 110) > 0.5


@pytest.mark.parametrize("apart", [34, 44])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("distractor", [TARGET, np.roll(TARGET, 6, axis=1)])
def test_a_distractor_beside_the_target_is_never_tracked(distractor, apart, seed):
    """Not while the target is out of sight; then the target is found beside it."""
    ground = shown(98 + apart, 40, sprite=distractor)
    tracker = tracker_of_moving_target(seed, ground=ground)
    for _ in range(100):
        estimate = tracker.update(ground, INTERVAL)
        assert estimate.state != "tracking"
    for _ in range(30):
        estimate = tracker.update(shown(98, 40, ground), INTERVAL)
    assert estimate.state == "tracking"
    assert overlap_with(estimate, 98, 40) > 0.6


@pytest.mark.parametrize("seed", range(3))
def test_a_target_that_reappears_at_a_distractor_is_found_once_clear_of_it(seed):
    """The target passes behind a post; the distractor stands beside the post."""
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


@pytest.mark.parametrize("seconds", [4, 16])
def test_after_a_covered_lens_the_target_is_found_within_a_second(seconds):
    """Sensor noise is no change of illumination, and nothing is learned from it."""
    tracker = tracker_of_moving_target()
    noise = np.random.default_rng(0)
    for _ in range(25 * seconds):
        dark = noise.normal(13.0, 4.0, GROUND.shape).clip(0, 255).astype(np.uint8)
        assert tracker.update(dark, INTERVAL).state != "tracking"
    estimates = [tracker.update(shown(98, 40), INTERVAL) for _ in range(25)]
    assert estimates[-1].state == "tracking"
    assert overlap_with(estimates[-1], 98, 40) > 0.8


def test_a_similar_object_in_another_scene_is_not_tracked():
    """It looks enough like the target to be tracked in the same scene."""
    other_ground = texture(3, HEIGHT, WIDTH, 60, 160)
    similar = cv2.addWeighted(TARGET, 0.5, texture(4, SIDE, SIDE), 0.5, 0.0)
    for ground, is_same in ((GROUND, True), (other_ground, False)):
        tracker = tracker_of_moving_target()
        states = [tracker.update(shown(98, 40, ground, similar), INTERVAL).state for _ in range(25)]
        assert ("tracking" in states) == is_same
