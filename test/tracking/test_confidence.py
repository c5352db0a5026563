"""The confidence of a single frame, and over time."""

from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros.cues import Match
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.assessment import Confidence
from pf_tracker_ros.tracking.track_parameters import TrackParameters


def smoothed(rate, before, confidences):
    """The confidences after frames with the given confidences of their own."""
    confidence, after = Confidence(None, rate), []
    for now in confidences:
        before = confidence.update(before, now)
        after.append(before)
    return after


def test_the_confidence_falls_at_once_and_rises_by_a_share_of_each_frame():
    after = smoothed(0.25, 1.0, (0.2, 1.0, 1.0, 0.5, 0.9))
    assert after == pytest.approx([0.2, 0.4, 0.55, 0.5, 0.6])


def test_by_default_the_confidence_is_that_of_the_frame():
    similarities = [0.1, 0.3, 0.7, 0.2]
    assert smoothed(TrackParameters().confidence_rate, 0.3, similarities) == similarities


def test_the_confidence_never_rises_above_that_of_the_frames():
    assert smoothed(0.5, 0.0, [0.8] * 60)[-1] == pytest.approx(0.8)


@pytest.fixture
def target_filter(make_target_filter):
    return make_target_filter("default")


@pytest.fixture
def state(target_filter, couple):
    return target_filter.start(couple.images[0], couple.first[0])


@pytest.fixture
def assess(target_filter, state, couple):
    """A function that computes the confidence of a box in the second frame."""

    def confidence_of(box, of=state, image=couple.images[1], particle_std=None):
        box = np.array(box)
        _, region = target_filter._measurer.search_window(Frame(image), box)
        seen = target_filter._fusion.observe(region, box)
        match = target_filter._fusion.match(seen, of.templates)
        if particle_std is None:
            return target_filter._confidence.assess(of, seen, match)
        return target_filter._confidence.assess(of, seen, match, lambda: particle_std)

    return confidence_of


def test_the_confidence_is_that_of_the_box_and_not_of_the_best_place_around(assess, couple):
    """The box moves away from the target, which stays within the search window."""
    box = couple.first[1]
    there, *beside = (assess(box + [shift, 0, 0, 0]) for shift in (0, 16, 30, -30))
    assert there > 0.9
    assert max(beside) < 0.25


def test_another_target_is_another(assess, couple):
    assert assess(couple.second[1]) < 0.05


def test_a_box_without_any_response_is_not_the_target(assess, couple):
    assert assess(couple.first[1], image=np.zeros_like(couple.images[1])) == pytest.approx(0.0)


def test_the_first_templates_reveal_what_was_learned_by_mistake(
    target_filter, state, assess, couple
):
    """The current templates are all those of the other target."""
    other = target_filter.start(couple.images[0], couple.second[0])
    misled = replace(state, templates=other.templates)
    assert assess(couple.second[1], other) > 0.9
    assert assess(couple.second[1], misled) < 0.5 * assess(couple.second[1], other)


def test_a_wide_particle_cloud_lowers_the_confidence(assess, couple):
    box = couple.first[1]
    wide, medium, narrow = (assess(box, particle_std=std) for std in (0.5, 0.1, 0.02))
    assert wide < medium < narrow


def test_without_log_odds_the_confidence_is_the_similarity(make_target_filter, couple):
    target_filter = make_target_filter("zhang2015")
    state = target_filter.start(couple.images[0], couple.first[0])
    match = Match(-1.0, 0.42)
    assert target_filter._confidence.assess(state, state.templates, match) == 0.42
