"""Windows of the redetection, and boxes that challenge the current one."""

import math
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pf_tracker_ros import MultiTracker, Tracker
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking import redetection
from pf_tracker_ros.tracking.hints import Standing
from pf_tracker_ros.tracking.redetection import Candidate, Redetector, window_centers


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


def test_a_window_with_something_similar_is_searched_twice(make_target_filter, couple, monkeypatch):
    target_filter = make_target_filter("default", {"redetection.windows": 3})
    redetector, confidences = target_filter._redetector, iter([0.9, 0.5, 0.9, 0.7, 0.1])
    state = target_filter.start(couple.images[0], couple.first[0])
    measurement = SimpleNamespace(state=state, frame=Frame(couple.images[0]), cue_weights={})
    box = np.array(couple.first[0])
    monkeypatch.setattr(
        redetector, "search_around", lambda *_: Candidate(box + 50.0, next(confidences))
    )
    assessment = SimpleNamespace(box=box, known_distractor=None)
    candidates = redetector.search(measurement, assessment, searches_everywhere=True)
    assert [one.confidence for one in candidates] == [0.5, 0.7, 0.1]


@pytest.fixture
def challenge(make_target_filter, couple, monkeypatch):
    """A function that runs a frame of 0.1 s in which the box has a confidence of 0.1.

    The window around the second peak has the given box, with the given confidence.
    """
    target_filter = make_target_filter("default")
    redetector = target_filter._redetector
    state = target_filter.start(couple.images[0], couple.first[0])
    box = np.array(couple.first[0])

    def run(before, offset, confidence, hidden_for=1.0):
        found = Candidate(box + [offset, 0, 0, 0], confidence)
        monkeypatch.setattr(redetector, "search_around", lambda *_: found)
        measurement = SimpleNamespace(
            state=replace(state, challenger=before),
            frame=None,
            frame_prediction=SimpleNamespace(interval=0.1),
            cue_weights={},
            second_peak=found.box,
        )
        status = state.status._replace(hidden_for=hidden_for)
        assessment = SimpleNamespace(box=box, known_distractor=None, status=status)
        return redetector.challenger(measurement, assessment, [], confidence=0.1)

    return run


def test_a_challenger_wins_once_it_has_been_likelier_for_long_enough(challenge):
    """The log ratio is ln 9; a fifth of the rest is added in each frame, until 1."""
    challenger = None
    for number in range(1, 5):
        challenger = challenge(challenger, 100.0, 0.5)
        assert challenger.lead == pytest.approx(math.log(9.0) * (1.0 - 0.8**number))
        assert challenger.wins == (number >= 3)
    # Another place has no lead yet.
    assert challenge(challenger, 200.0, 0.5).lead == pytest.approx(math.log(9.0) / 5)


def test_what_is_no_challenger(challenge):
    assert challenge(None, 100.0, 0.5, hidden_for=0.4) is None
    assert challenge(None, 0.0, 0.5) is None, "it is the current box"
    unlikely = None
    for _ in range(30):
        unlikely = challenge(unlikely, 100.0, 0.25)
    assert unlikely.lead > 1.0
    assert not unlikely.wins, "too unlike the target, even if less so than the current box"


@pytest.mark.parametrize("wins_above", [redetection._WINS_ABOVE, math.inf])
def test_the_box_of_a_hidden_target_goes_to_what_is_likelier_without_a_claim(
    wins_above, monkeypatch
):
    """The target comes back 50 px away with a third of its contrast: too little for a claim."""
    monkeypatch.setattr(redetection, "_WINS_ABOVE", wins_above)
    images = frames_of_a_target_that_comes_back()
    with_target, ground = images[0], images[30]
    faint = ground.copy()
    faint[60:92, 110:142] = cv2.addWeighted(
        with_target[60:92, 60:92], 0.35, ground[60:92, 110:142], 0.65, 0.0
    )
    tracker = Tracker.from_preset("default")
    tracker.start(with_target, (60, 60, 32, 32))
    for image in [with_target] * 20 + [ground] * 10:
        tracker.update(image, 0.1)
    estimates = [tracker.update(faint, 0.1) for _ in range(20)]
    is_there = [math.dist(one.box[:2], (110, 60)) < 3.0 for one in estimates]
    if wins_above == math.inf:
        assert not any(is_there)
    else:
        assert all(is_there[15:])
        assert estimates[is_there.index(True)].state == "lost"


@pytest.mark.parametrize("count", [1, 2])
def test_only_a_single_target_is_challenged(count, monkeypatch):
    """The boxes of other targets would be the likeliest challengers."""
    challenged = []
    monkeypatch.setattr(Redetector, "challenger", lambda *_, **__: challenged.append(1))
    images = frames_of_a_target_that_comes_back()
    tracker = MultiTracker.from_preset("default")
    for number in range(count):
        tracker.start(images[0], (60 + 40 * number, 60, 32, 32))
    for image in images[1:40]:
        tracker.update(image, 0.1)
    assert bool(challenged) == (count == 1)


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
        state = target_filter.step(prediction, is_challenged=not has_detector)
    assert state.status.state == "lost"
    is_last_size = state.estimate.box[2:] == pytest.approx(state.last_seen_box[2:])
    assert is_last_size == has_detector
