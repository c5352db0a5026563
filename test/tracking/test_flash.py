"""Light that jumps, and what a target looked like before it did."""

import numpy as np
import pytest

from pf_tracker_ros.filter.particles import Randomness
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.frames.exposure import Light

INTERVAL = 0.04


def begin(follower, couple):
    """A target after five frames."""
    draw = Randomness.of(np.random.default_rng(3))
    target = follower.begin(Frame(couple.images[0]), tuple(couple.first[0]), draw)
    for image in couple.images[1:6]:
        target = follower.follow(target, Frame(image), INTERVAL)
    assert target.estimate.state == "tracking"
    return target


def dazzled(follower, couple):
    """The target in an image that has become three times as bright, and nothing but white."""
    target = begin(follower, couple)
    white = Frame(np.full_like(couple.images[6], 255), light=Light(change=3.0))
    blind = follower.follow(target, white, INTERVAL)
    assert blind.estimate.state != "tracking"
    return target, blind


@pytest.fixture
def follower(make_follower):
    return make_follower("default")


def test_what_is_seen_in_the_new_light_is_learned(follower, couple):
    target, blind = dazzled(follower, couple)
    assert blind.before_jump.templates is target.templates
    assert blind.templates is not target.templates


def test_nothing_is_learned_where_templates_are_never_updated(make_follower, couple):
    target, blind = dazzled(make_follower("default", {"template.update_above": 1.0}), couple)
    assert blind.templates is target.templates
    assert blind.before_jump is None


@pytest.mark.parametrize(
    ("change", "is_back"), [(1 / 3, True), (0.7, True), (0.9, False), (2, False)]
)
def test_a_jump_back_brings_back_what_was_known(follower, couple, change, is_back):
    target, blind = dazzled(follower, couple)
    blank = Frame(np.zeros_like(couple.images[6]), light=Light(change=change))
    after = follower.follow(blind, blank, INTERVAL)
    # In a blank image nothing is learned.
    assert (after.templates is target.templates) == is_back
    assert (after.before_jump is None) == is_back


def test_light_that_has_lasted_is_no_flash(follower, couple):
    target, blind = dazzled(follower, couple)
    for _ in range(3):
        blind = follower.follow(blind, Frame(np.zeros_like(couple.images[6])), 0.7)
    assert blind.before_jump is None
    back = Frame(np.zeros_like(couple.images[6]), light=Light(change=1 / 3))
    assert follower.follow(blind, back, INTERVAL).templates is not target.templates
