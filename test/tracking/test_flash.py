"""Illumination that jumps, and what a target looked like before it did."""

import numpy as np
import pytest

from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.frames.exposure import Illumination

INTERVAL = 0.04


def begin(target_filter, couple):
    """A target after five frames."""
    draw = GeneratorState.of(np.random.default_rng(3))
    target = target_filter.initialize(Frame(couple.images[0]), tuple(couple.first[0]), draw)
    for image in couple.images[1:6]:
        target = target_filter.follow(target, Frame(image), INTERVAL)
    assert target.estimate.state == "tracking"
    return target


def dazzled(target_filter, couple):
    """The target in an image that has become three times as bright, and nothing but white."""
    target = begin(target_filter, couple)
    white = Frame(np.full_like(couple.images[6], 255), illumination=Illumination(change=3.0))
    blind = target_filter.follow(target, white, INTERVAL)
    assert blind.estimate.state != "tracking"
    return target, blind


@pytest.fixture
def target_filter(make_target_filter):
    return make_target_filter("default")


def test_what_is_seen_in_the_new_light_is_learned(target_filter, couple):
    target, blind = dazzled(target_filter, couple)
    assert blind.saved_templates.templates is target.templates
    assert blind.templates is not target.templates


def test_nothing_is_learned_where_templates_are_never_updated(make_target_filter, couple):
    target, blind = dazzled(make_target_filter("default", {"template.update_above": 1.0}), couple)
    assert blind.templates is target.templates
    assert blind.saved_templates is None


@pytest.mark.parametrize(
    ("change", "is_back"), [(1 / 3, True), (0.7, True), (0.9, False), (2, False)]
)
def test_a_jump_back_brings_back_what_was_known(target_filter, couple, change, is_back):
    target, blind = dazzled(target_filter, couple)
    blank = Frame(np.zeros_like(couple.images[6]), illumination=Illumination(change=change))
    after = target_filter.follow(blind, blank, INTERVAL)
    # In a blank image nothing is learned.
    assert (after.templates is target.templates) == is_back
    assert (after.saved_templates is None) == is_back


def test_light_that_has_lasted_is_no_flash(target_filter, couple):
    target, blind = dazzled(target_filter, couple)
    for _ in range(3):
        blind = target_filter.follow(blind, Frame(np.zeros_like(couple.images[6])), 0.7)
    assert blind.saved_templates is None
    back = Frame(np.zeros_like(couple.images[6]), illumination=Illumination(change=1 / 3))
    assert target_filter.follow(blind, back, INTERVAL).templates is not target.templates
