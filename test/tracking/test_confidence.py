"""The confidence of a single frame, and over time."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros.cues import Match
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.assessment import (
    AssessedBox,
    Confidence,
)


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


@pytest.mark.parametrize(("preset", "share"), [("li2007", 1.0), ("default", 0.2)])
def test_only_with_a_search_the_confidence_rises_slowly(make_target_filter, preset, share):
    confidence = make_target_filter(preset)._confidence
    assert confidence.update(0.5, 1.0) == pytest.approx(0.5 + 0.5 * share)
    assert confidence.update(0.5, 0.25) == 0.25


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
        spread = {} if particle_std is None else {"particle_std": lambda: particle_std}
        assessed = AssessedBox(Frame(image), box, seen, match, **spread)
        return target_filter._confidence.assess(of, assessed)

    return confidence_of


def test_the_confidence_is_that_of_the_box_and_not_of_the_best_place_around(assess, couple):
    """The box moves away from the target, which stays within the search window."""
    box = couple.first[1]
    there, *beside = (assess(box + [shift, 0, 0, 0]) for shift in (0, 16, 30, -30))
    assert there > 0.9
    assert max(beside) < 0.25


def test_another_target_is_another(target_filter, assess, couple):
    assert assess(couple.second[1]) < target_filter.parameters.track.tracked_above


def test_a_box_without_any_response_is_not_the_target(assess, couple):
    assert assess(couple.first[1], image=np.zeros_like(couple.images[1])) < 2e-4


def test_the_exemplars_reveal_what_was_learned_by_mistake(target_filter, state, assess, couple):
    """The current templates are all those of the other target."""
    other = target_filter.start(couple.images[0], couple.second[0])
    misled = replace(state, templates=other.templates)
    doubt, trust = (1.0 - assess(couple.second[1], one) for one in (misled, other))
    assert trust < 0.05
    assert doubt > 3.0 * trust


def test_a_wide_particle_cloud_lowers_the_confidence(assess, couple):
    box = couple.first[1]
    wide, medium, narrow = (assess(box, particle_std=std) for std in (0.5, 0.1, 0.02))
    assert wide < medium < narrow


def test_a_rival_counts_by_its_similarity_to_the_target(target_filter, state, couple):
    """One that fits as well halves the share of the evidence; background takes none of it."""
    image, box = couple.images[0], np.array(couple.first[0])
    copied, place = image.copy(), box + [0, -45, 0, 0]
    x, y, width, height = (int(side) for side in box)
    copied[y - 45 : y - 45 + height, x : x + width] = image[y : y + height, x : x + width]

    def odds(image, rival):
        _, region = target_filter._measurer.search_window(Frame(image), box)
        seen = target_filter._fusion.observe(region, box)
        assessed = AssessedBox(Frame(image), box, seen, Match(0.0, 1.0), rival=rival)
        return target_filter._confidence.log_odds(state, assessed)["rival"]

    assert odds(image, None) == 0.0
    assert odds(copied, place) == pytest.approx(1.3 * math.log(0.5), abs=0.05)
    assert odds(image, place) > -0.05


def test_looks_count_against_the_target(target_filter, state):
    """One look at first and one more each half second."""
    frame, box = Frame(np.full((120, 160), 90, np.uint8)), np.array([60.0, 50.0, 30.0, 30.0])
    _, region = target_filter._measurer.search_window(frame, box)
    assessed = AssessedBox(frame, box, target_filter._fusion.observe(region, box), Match(0.0, 1.0))

    def odds(hidden_for):
        hidden = replace(state, status=state.status._replace(hidden_for=hidden_for))
        return target_filter._confidence.log_odds(hidden, assessed)["looks"]

    assert odds(0.0) == 0.0
    assert odds(1.5) == pytest.approx(2 * odds(0.5))
    assert odds(0.5) < -0.3


def test_without_log_odds_the_confidence_is_the_similarity(make_target_filter, couple):
    target_filter = make_target_filter("zhang2015")
    state = target_filter.start(couple.images[0], couple.first[0])
    box = np.array(couple.first[0])
    assessed = AssessedBox(Frame(couple.images[0]), box, state.templates, Match(-1.0, 0.42))
    assert target_filter._confidence.assess(state, assessed) == 0.42
