"""The confidence in a look, and from frame to frame."""

from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros.cues import Match
from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.assessment import Confidence
from pf_tracker_ros.tracking.track_parameters import TrackParameters


def told(rate, before, looks):
    """The confidences after frames that alone say so much."""
    confidence, after = Confidence(None, rate), []
    for now in looks:
        before = confidence.update(before, now)
        after.append(before)
    return after


def test_it_falls_at_once_and_rises_by_its_share_of_each_frame():
    assert told(0.25, 1.0, (0.2, 1.0, 1.0, 0.5, 0.9)) == pytest.approx([0.2, 0.4, 0.55, 0.5, 0.6])


def test_by_default_it_is_what_the_frame_says():
    similarities = [0.1, 0.3, 0.7, 0.2]
    assert told(TrackParameters().confidence_rate, 0.3, similarities) == similarities


def test_it_never_rises_above_what_the_frames_say():
    assert told(0.5, 0.0, [0.8] * 60)[-1] == pytest.approx(0.8)


@pytest.fixture
def target_filter(make_target_filter):
    return make_target_filter("default")


@pytest.fixture
def target(target_filter, couple):
    draw = GeneratorState.of(np.random.default_rng(3))
    return target_filter.initialize(Frame(couple.images[0]), tuple(couple.first[0]), draw)


@pytest.fixture
def look(target_filter, target, couple):
    """What the confidence says of a box in the second frame."""

    def assess(box, of=target, image=couple.images[1], particle_std=None):
        box = np.array(box)
        _, region = target_filter._measurer.search_window(Frame(image), box)
        seen = target_filter._fusion.observe(region, box)
        match = target_filter._fusion.match(seen, of.templates)
        if particle_std is None:
            return target_filter._confidence.assess(of, seen, match)
        return target_filter._confidence.assess(of, seen, match, lambda: particle_std)

    return assess


def test_it_is_of_the_box_and_not_of_the_best_place_around(look, couple):
    """The target stays in reach of the search, as strong as before; the box moves away from it."""
    box = couple.first[1]
    there, *beside = (look(box + [shift, 0, 0, 0]) for shift in (0, 16, 30, -30))
    assert there > 0.9
    assert max(beside) < 0.25


def test_another_target_is_another(look, couple):
    assert look(couple.second[1]) < 0.05


def test_a_box_that_the_filter_answers_to_with_nothing_is_not_the_target(look, couple):
    assert look(couple.first[1], image=np.zeros_like(couple.images[1])) == pytest.approx(0.0)


def test_what_was_learned_by_mistake_is_not_what_it_was_first(target_filter, target, look, couple):
    """All templates are those of the other; those of the first frame tell."""
    draw = GeneratorState.of(np.random.default_rng(3))
    frame = Frame(couple.images[0])
    other = target_filter.initialize(frame, tuple(couple.second[0]), draw)
    misled = replace(target, templates=other.templates)
    assert look(couple.second[1], other) > 0.9
    assert look(couple.second[1], misled) < 0.5 * look(couple.second[1], other)


def test_particles_that_do_not_agree_on_a_place_speak_against_it(look, couple):
    box = couple.first[1]
    assert look(box, particle_std=0.5) < look(box, particle_std=0.1) < look(box, particle_std=0.02)


def test_where_no_cue_can_tell_it_is_the_similarity(make_target_filter, couple):
    target_filter = make_target_filter("zhang2015")
    draw = GeneratorState.of(np.random.default_rng(3))
    target = target_filter.initialize(Frame(couple.images[0]), tuple(couple.first[0]), draw)
    match = Match(-1.0, 0.42)
    assert target_filter._confidence.assess(target, target.templates, match) == 0.42
