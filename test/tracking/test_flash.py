"""Jumps of the illumination, and the templates from before them."""

import numpy as np
import pytest

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.frames.exposure import Illumination

INTERVAL = 0.04


def tracked(target_filter, couple):
    """A target after five frames."""
    state = target_filter.start(couple.images[0], couple.first[0])
    for image in couple.images[1:6]:
        state = target_filter.follow(state, Frame(image), INTERVAL)
    assert state.estimate.state == "tracking"
    return state


def dazzled(target_filter, couple):
    """The target before and in an image that is three times as bright and all white."""
    state = tracked(target_filter, couple)
    white = Frame(np.full_like(couple.images[6], 255))
    white.expose(illumination=Illumination(change=3.0))
    blind = target_filter.follow(state, white, INTERVAL)
    assert blind.estimate.state != "tracking"
    return state, blind


@pytest.fixture
def target_filter(make_target_filter):
    return make_target_filter("default")


def test_the_templates_are_learned_in_the_new_illumination(target_filter, couple):
    state, blind = dazzled(target_filter, couple)
    assert blind.saved_templates.templates is state.templates
    assert blind.templates is not state.templates


def test_nothing_is_learned_where_templates_are_never_updated(make_target_filter, couple):
    state, blind = dazzled(make_target_filter("default", {"template.update_above": 1.0}), couple)
    assert blind.templates is state.templates
    assert blind.saved_templates is None


@pytest.mark.parametrize(
    ("change", "is_back"), [(1 / 3, True), (0.7, True), (0.9, False), (2, False)]
)
def test_a_jump_back_restores_the_templates(target_filter, couple, change, is_back):
    state, blind = dazzled(target_filter, couple)
    blank = Frame(np.zeros_like(couple.images[6]))
    blank.expose(illumination=Illumination(change=change))
    after = target_filter.follow(blind, blank, INTERVAL)
    # In a blank image nothing is learned.
    assert (after.templates is state.templates) == is_back
    assert (after.saved_templates is None) == is_back


def test_a_lasting_jump_is_no_flash(target_filter, couple):
    state, blind = dazzled(target_filter, couple)
    for _ in range(3):
        blind = target_filter.follow(blind, Frame(np.zeros_like(couple.images[6])), 0.7)
    assert blind.saved_templates is None
    back = Frame(np.zeros_like(couple.images[6]))
    back.expose(illumination=Illumination(change=1 / 3))
    assert target_filter.follow(blind, back, INTERVAL).templates is not state.templates
