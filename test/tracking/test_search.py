"""Search and redetection of a target that the motion model does not predict."""

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.filter import ParticleSet, ProposalParameters
from pf_tracker_ros.tracking import target_filter, track_assessor
from pf_tracker_ros.tracking.redetection import Redetector
from pf_tracker_ros.tracking.search import Search, mode_mean

PREDICTED = np.array([100.0, 80.0, 40.0, 40.0])


def texture(seed, height, width, low=0, high=255):
    noise = np.random.default_rng(seed).normal(size=(height, width, 3))
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.5)
    return cv2.normalize(smooth, None, low, high, cv2.NORM_MINMAX).astype(np.uint8)


BACKGROUND = texture(0, 240, 320, 80, 160)
TARGET = texture(1, 36, 36)


def frame(x, y, visible=True, background=BACKGROUND, target=TARGET):
    """A target of 36 x 36 px at (x, y)."""
    image = background.copy()
    if visible:
        image[y : y + 36, x : x + 36] = target
    return image


def off_center(box, x, y):
    return np.hypot(box[0] + box[2] / 2 - x - 18, box[1] + box[3] / 2 - y - 18)


def test_a_search_tracks_a_jump_that_the_transition_prior_misses():
    """A jump of 45 px, 1.25 box sizes, in one frame; the motion noise is 0.12 box sizes."""
    found = {}
    for method in ("transition", "search"):
        tracker = Tracker.from_preset("default", parameters={"proposal.method": method})
        tracker.start(frame(120, 100), (120, 100, 36, 36))
        for _ in range(3):
            tracker.update(frame(120, 100))
        found[method] = [tracker.update(frame(165, 100)) for _ in range(2)]
    for estimate in found["search"]:
        assert off_center(estimate.box, 165, 100) < 3.0
    assert found["search"][1].state == "tracking"
    assert off_center(found["transition"][0].box, 165, 100) > 15.0


def test_a_target_that_has_reappeared_is_not_searched_elsewhere(monkeypatch):
    """Not even while the smoothed confidence is still below the threshold."""
    searches = []
    monkeypatch.setattr(Redetector, "search", lambda *_, **__: searches.append(1) or [])
    monkeypatch.setattr(target_filter, "RISING_SHARE", 0.05)
    tracker = Tracker.from_preset("default")
    tracker.start(frame(120, 100), (120, 100, 36, 36))
    for visible in [True] * 10 + [False] * 5:
        tracker.update(frame(120, 100, visible=visible))
    assert len(searches) == 5
    states = [tracker.update(frame(120, 100)).state for _ in range(30)]
    assert len(searches) == 5
    assert states[0] == "occluded"
    assert states[-1] == "tracking"


def test_an_occluder_is_not_learned_and_the_target_is_found_nearby(monkeypatch):
    monkeypatch.setattr(target_filter, "RISING_SHARE", 1.0)
    tracker = Tracker.from_preset("default", seed=10)
    tracker.start(frame(120, 100), (120, 100, 36, 36))
    for _ in range(10):
        seen = tracker.update(frame(120, 100))
    for _ in range(15):
        hidden = tracker.update(frame(120, 100, visible=False))
        assert hidden.state == "occluded"
        assert hidden.confidence < 0.1
    sizes = np.sqrt(np.diag(hidden.covariance)) / 36
    assert (np.sqrt(np.diag(seen.covariance)) / 36 < 0.3).all()
    assert (sizes > 0.5).all()
    for _ in range(2):
        found = tracker.update(frame(140, 110))
    assert found.state == "tracking"
    assert off_center(found.box, 140, 110) < 4.0


def lost_tracker(background, **parameters):
    """A tracker that has lost its target, last seen at (60, 60), and the last estimate."""
    tracker = Tracker.from_preset("default", parameters=parameters)
    tracker.start(frame(60, 60, background=background), (60, 60, 36, 36))
    for _ in range(10):
        tracker.update(frame(60, 60, background=background))
    for _ in range(60):
        estimate = tracker.update(background)
    assert estimate.state == "lost"
    return tracker, estimate


WIDE_BACKGROUND = texture(2, 360, 480, 80, 160)
# 480 x 360 px in steps of half a window of 3.6 x 36 px.
WIDE_WINDOWS = 8 * 6


def test_a_lost_target_is_found_anywhere_in_the_image():
    tracker, estimate = lost_tracker(WIDE_BACKGROUND)
    found = []
    for number in range(WIDE_WINDOWS + 20):
        estimate = tracker.update(frame(390 - number, 270, background=WIDE_BACKGROUND))
        found.append(estimate.state == "tracking")
        if found[-1]:
            assert off_center(estimate.box, 390 - number, 270) < 5.0
    # Each window is searched once; a few frames later the target is confirmed and then tracked.
    assert any(found[: WIDE_WINDOWS + 6])
    assert all(found[found.index(True) :])
    assert estimate.confidence > 0.7
    np.testing.assert_allclose(estimate.box[2:], 36.0, rtol=0.1)


def test_without_redetection_a_lost_target_is_found_only_where_it_was_lost():
    tracker, _ = lost_tracker(WIDE_BACKGROUND, **{"redetection.windows": 0})
    for _ in range(WIDE_WINDOWS):
        estimate = tracker.update(frame(390, 270, background=WIDE_BACKGROUND))
    assert estimate.state == "lost"


def test_another_object_is_not_redetected(monkeypatch):
    """Another pattern in the same colors, all over the image, even with less to be asked for."""
    monkeypatch.setattr(track_assessor, "_ACCEPT_ABOVE", 0.7)
    tracker, _ = lost_tracker(WIDE_BACKGROUND)
    other = cv2.rotate(TARGET, cv2.ROTATE_90_CLOCKWISE)
    for number in range(WIDE_WINDOWS + 20):
        x, y = 60 + 100 * (number % 4), 200 + 3 * number % 100
        estimate = tracker.update(frame(x, y, background=WIDE_BACKGROUND, target=other))
        assert estimate.state == "lost"


@pytest.mark.parametrize("hidden", [15, 16, 17])
def test_a_target_that_returns_where_it_was_last_seen_is_found_within_three_frames(hidden):
    """Meanwhile a darker distractor of its colors is followed out of the search window."""
    mixed = TARGET.reshape(-1, 3) // 2 + 30
    np.random.default_rng(0).shuffle(mixed)
    tracker = Tracker.from_preset("default")
    tracker.start(frame(60, 60, background=WIDE_BACKGROUND), (60, 60, 36, 36))
    for _ in range(5):
        tracker.update(frame(60, 60, background=WIDE_BACKGROUND))
    for number in range(hidden):
        away = frame(60 + 15 * number, 60, True, WIDE_BACKGROUND, mixed.reshape(36, 36, 3))
        estimate = tracker.update(away)
        # In the first of these frames, it is at the target's place.
        assert number == 0 or estimate.state == "occluded"
    assert off_center(estimate.box, 60, 60) > 150.0
    for _ in range(3):
        estimate = tracker.update(frame(64, 58, background=WIDE_BACKGROUND))
    assert estimate.state == "tracking"
    assert off_center(estimate.box, 64, 58) < 3.0


def test_the_cues_of_a_search_can_be_replaced_while_tracking():
    """In the first frame after that, the cue that can search has no template."""
    parameters = {"cues": ("color_histogram", "color_contrast")}
    tracker = Tracker.from_preset("default", parameters=parameters)
    tracker.start(frame(120, 100), (120, 100, 36, 36))
    tracker.update(frame(122, 100))
    tracker.set_parameters({"cues": ("color_histogram", "correlation_response")})
    for step in range(3):
        estimate = tracker.update(frame(124 + 2 * step, 100))
    assert off_center(estimate.box, 128, 100) < 4.0
    assert off_center(tracker.update(frame(165, 100)).box, 165, 100) < 4.0


@pytest.mark.parametrize("method", ["transition", "search"])
def test_boxes_of_very_different_sizes_are_no_error(method):
    """All are measured at the predicted size, which exceeds the small ones."""
    parameters = {"proposal.method": method, "motion.size_noise": 3.0}
    parameters |= {"motion.position_noise": 5.0}
    tracker = Tracker.from_preset("default", parameters=parameters)
    tracker.start(frame(120, 100), (120, 100, 36, 36))
    for _ in range(10):
        estimate = tracker.update(frame(120, 100))
    assert np.isfinite(estimate.box).all()


def test_the_cue_weights_move_to_the_cue_without_a_distractor():
    """A patch of the target's colors in another pattern is a distractor of the color cue alone."""
    cue_weights = []
    for image in (frame(120, 100), frame(120, 100)):
        if cue_weights:
            mixed = TARGET.reshape(-1, 3).copy()
            np.random.default_rng(0).shuffle(mixed)
            image[100:136, 190:226] = mixed.reshape(36, 36, 3)
        tracker = Tracker.from_preset("default", parameters={"proposal.window": 5.0})
        tracker.start(image, (120, 100, 36, 36))
        for _ in range(3):
            estimate = tracker.update(image)
        cue_weights.append(estimate.cue_weights["correlation_response"])
    assert cue_weights[1] > cue_weights[0] + 0.02


def test_the_search_grid_is_centered_on_the_predicted_box_and_inside_the_image():
    parameters = ProposalParameters(window=3.0)
    search = Search(PREDICTED, parameters, (320, 240))
    centers = search.boxes[:, :2] + search.boxes[:, 2:] / 2
    np.testing.assert_allclose(centers.mean(axis=0), [120.0, 100.0])
    # Centers of 40 cells over 3 box sizes.
    np.testing.assert_allclose(np.ptp(centers, axis=0), 3.0 * 40.0 * 39 / 40)
    assert (search.boxes[:, 2:] == PREDICTED[2:]).all()
    edge = Search(np.array([-10.0, 200.0, 40.0, 40.0]), parameters, (320, 240))
    centers = edge.boxes[:, :2] + edge.boxes[:, 2:] / 2
    assert centers.min() >= 0.0
    assert centers[:, 1].max() <= 240.0


def test_the_covered_area_contains_every_box_that_can_be_proposed():
    search = Search(PREDICTED, ProposalParameters(), (320, 240))
    boxes = np.array([[10.0, 20.0, 10.0, 90.0], [150.0, 90.0, 60.0, 20.0]])
    covered = search.cover(boxes)
    first = covered[:, :2].min(axis=0)
    last = (covered[:, :2] + covered[:, 2:]).max(axis=0)
    for one in (boxes, search.boxes):
        assert (one[:, :2] >= first).all()
        assert (one[:, :2] + one[:, 2:] <= last).all()


def peaks(search, *places_and_heights):
    """Responses on the grid of a search: peaks around (x, y) with the given heights."""
    centers = search.boxes[:, :2] + search.boxes[:, 2:] / 2
    return np.max(
        [
            height * np.exp(-np.square(centers - (x, y)).sum(axis=1) / 200.0)
            for x, y, height in places_and_heights
        ],
        axis=0,
    )


def test_the_distractor_is_the_peak_of_all_cues_beside_the_target():
    search = Search(PREDICTED, ProposalParameters(window=3.0), (320, 240))
    at_target = {"first": np.array([0.8]), "second": np.array([0.5])}
    responses = {
        "first": peaks(search, (120, 100, 0.8), (160, 105, 0.6), (90, 70, 0.7)),
        "second": peaks(search, (120, 100, 0.5), (160, 105, 0.4), (90, 130, 0.5)),
    }
    found = search.distractor_box(PREDICTED, at_target, responses, 0.5)
    np.testing.assert_allclose(found[:2] + found[2:] / 2, [160.0, 105.0], atol=2.0)
    np.testing.assert_allclose(found[2:], PREDICTED[2:])
    assert search.distractor_box(PREDICTED, at_target, responses, 0.9) is None


@pytest.mark.parametrize("place", [(120, 100), (130, 108), (180, 100)])
def test_a_slope_towards_the_target_or_the_border_of_the_grid_is_no_distractor(place):
    search = Search(PREDICTED, ProposalParameters(window=3.0), (320, 240))
    responses = {"one": peaks(search, (120, 100, 1.0), (*place, 1.0))}
    assert search.distractor_box(PREDICTED, {"one": np.array([1.0])}, responses, 0.3) is None


def test_a_target_without_a_response_has_no_distractor():
    search = Search(PREDICTED, ProposalParameters(window=3.0), (320, 240))
    nothing = {"one": np.full(len(search.boxes), -0.2)}
    assert search.distractor_box(PREDICTED, {"one": np.array([-0.2])}, nothing, 0.3) is None


def test_the_mean_of_a_mode_excludes_the_other_mode():
    states = np.array([[10.0, 10.0, 1.0], [12.0, 10.0, 3.0], [80.0, 10.0, 9.0]])
    boxes = np.hstack([states[:, :2] - 20.0, np.full((3, 2), 40.0)])
    particles = ParticleSet(states, np.log([0.2, 0.3, 0.5]))
    np.testing.assert_allclose(mode_mean(particles, boxes, 0), [11.2, 10.0, 2.2])
    np.testing.assert_allclose(mode_mean(particles, boxes, 2), states[2])
