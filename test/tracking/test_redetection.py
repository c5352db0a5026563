"""Redetection: its windows, and what it takes for the target."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pf_tracker_ros import Tracker
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.hints import Standing
from pf_tracker_ros.tracking.redetection import Candidate, window_centers


@settings(max_examples=15)
@given(
    st.tuples(st.integers(8, 200), st.integers(8, 200)),
    st.tuples(*[st.floats(0.0, 1.0)] * 4),
    st.integers(0, 2**32 - 1),
)
def test_redetection_in_noise_is_no_error(image_size, box, seed):
    """Frames a second apart: the target counts as lost from the second one on."""
    width, height = image_size
    size = 1.0 + np.array(box[2:]) * (width - 1, height - 1)
    corner = np.array(box[:2]) * (width - 1, height - 1) - size / 2
    tracker = Tracker.from_preset("default", parameters={"redetection.windows": 3})
    generator = np.random.default_rng(seed)
    images = generator.integers(0, 256, (6, height, width, 3), np.uint8)
    tracker.start(images[0], (*corner, *size))
    for image in images[1:]:
        estimate = tracker.update(image, 1.0)
        assert np.isfinite([*estimate.box, estimate.confidence]).all()
        assert np.isfinite(estimate.covariance).all()


@given(
    st.tuples(st.integers(1, 4000), st.integers(1, 4000)),
    st.floats(60.0, 5000.0),
    st.integers(0, 10**9),
)
def test_all_windows_are_searched_before_any_is_searched_again(image_size, side, first):
    across, down = (int(np.ceil(length / (side / 2))) for length in image_size)
    centers = window_centers(image_size, side, first, across * down)
    assert len(np.unique(centers.round(6), axis=0)) == across * down
    assert (centers > 0).all()
    assert (centers < image_size).all()
    # They cover the image: at most half a side apart, also from the borders.
    for axis in range(2):
        places = np.unique(centers[:, axis].round(6))
        ends = np.concatenate([[-places[0]], places, [2 * image_size[axis] - places[-1]]])
        assert (np.diff(ends) <= side / 2 + 1e-6).all()


def test_the_next_windows_continue_the_sequence():
    together = window_centers((640, 480), 100.0, 0, 10)
    parts = [window_centers((640, 480), 100.0, first, 5) for first in (0, 5)]
    np.testing.assert_array_equal(np.vstack(parts), together)
    # Consecutive windows are far apart.
    steps = np.linalg.norm(np.diff(together, axis=0), axis=1)
    assert np.median(steps) > 150.0


def frames_of_a_target_that_comes_back():
    """20 frames with a textured square, 40 without it, 40 with it again."""
    generator = np.random.default_rng(0)
    ground, target = (
        cv2.resize(generator.integers(low, high, (side, side, 3), np.uint8), (size, size))
        for low, high, side, size in ((60, 160, 20, 160), (0, 255, 6, 32))
    )
    with_target = ground.copy()
    with_target[60:92, 60:92] = target
    return [with_target] * 20 + [ground] * 40 + [with_target] * 40


@pytest.mark.parametrize("mode", ["automatic", "ask"])
def test_a_lost_target_comes_back_by_itself_or_by_confirmation(mode):
    tracker = Tracker.from_preset("default", parameters={"redetection.mode": mode})
    images = frames_of_a_target_that_comes_back()
    tracker.start(images[0], (60, 60, 32, 32))
    estimates = [tracker.update(image, 0.1) for image in images[1:]]
    assert [estimates[index].state for index in (18, 58)] == ["tracking", "lost"]
    assert all(one.reacquired_for is None for one in estimates[:59])
    again, last = estimates[59:], estimates[-1]
    assert last.box == pytest.approx((60, 60, 32, 32), abs=2)
    if mode == "ask":
        assert {one.state for one in again} == {"lost"}
        assert last.confidence > 0.6
        tracker.start(images[-1], last.box)
        assert tracker.update(images[-1], 0.1).state == "tracking"
        return
    assert last.state == "tracking"
    found = next(index for index, one in enumerate(again) if one.state == "tracking")
    assert last.reacquired_for == pytest.approx((len(again) - 1 - found) * 0.1)


def test_the_most_confident_box_is_found_if_it_is_confident_enough(
    make_target_filter, couple, monkeypatch
):
    """Each window is searched twice, but one without anything similar."""
    target_filter = make_target_filter("default", {"redetection.windows": 3})
    redetector, confidences = target_filter._redetector, iter([])
    state = target_filter.start(couple.images[0], couple.first[0])
    measurement = SimpleNamespace(frame=Frame(couple.images[0]), cue_weights={})
    box = np.array(couple.first[0])
    monkeypatch.setattr(
        redetector, "search_around", lambda *_: Candidate(box + 50.0, next(confidences))
    )

    def found(least):
        nonlocal confidences
        confidences = iter([0.9, 0.5, 0.9, 0.7, 0.1])
        return redetector.find(state, measurement, box, least, searches_everywhere=True)

    assert found(0.84) is None
    assert found(0.64).confidence == 0.7


@pytest.mark.parametrize("has_detector", [True, False])
def test_a_lost_target_may_change_its_size_where_only_the_ground_is_known(
    make_target_filter, couple, has_detector
):
    target_filter = make_target_filter("default")
    state = target_filter.start(couple.images[0], couple.first[0])
    for seed in range(12):
        noise = np.random.default_rng(seed).integers(0, 256, couple.images[0].shape, np.uint8)
        state = replace(state, standing=Standing(horizon=20.0, slope=2.0))
        (prediction,) = target_filter.predict([(state, True)], Frame(noise), 0.3)
        state = target_filter.step(prediction, is_sized_freely=not has_detector)
    assert state.status.state == "lost"
    is_last_size = state.estimate.box[2:] == pytest.approx(state.last_seen_box[2:])
    assert is_last_size == has_detector
