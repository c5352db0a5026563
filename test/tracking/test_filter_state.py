"""A filter state is an immutable value: a step repeated from it gives the same result."""

import copy
import itertools
from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.presets import PRESETS

INTERVAL = 0.04
every_preset = pytest.mark.parametrize("preset", sorted(PRESETS))


def same(one, other):
    """Whether two values of any type are the same to the bit."""
    if type(one) is not type(other):
        return False
    if is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    return one == other if not hasattr(one, "__dict__") else same(vars(one), vars(other))


def followed(target_filter, images, box, seed=3):
    """The states after each image, and the frames."""
    frames = [Frame(image) for image in images]
    states = [target_filter.start(images[0], box, seed)]
    for frame in frames[1:]:
        states.append(target_filter.follow(states[-1], frame, INTERVAL))
    return states, frames


def test_different_states_are_not_the_same(make_target_filter, couple):
    states, _ = followed(make_target_filter("default"), couple.images[:3], tuple(couple.first[0]))
    assert same(states[1], copy.deepcopy(states[1]))
    for earlier, later in itertools.pairwise(states):
        for field in ("particles", "templates", "generator_state", "estimate", "followed_frames"):
            assert not same(getattr(earlier, field), getattr(later, field))


@every_preset
def test_a_step_does_not_change_the_state_before(preset, make_target_filter, couple):
    """Through an occlusion and out of it again."""
    target_filter = make_target_filter(preset, {"track.lost_after": 0.1})
    states, _ = followed(target_filter, couple.images[:1], tuple(couple.first[0]))
    track_states = []
    for image in couple.images[1:]:
        before = states[-1]
        kept = copy.deepcopy(before)
        states.append(target_filter.follow(before, Frame(image), INTERVAL))
        assert same(before, kept)
        track_states.append(states[-1].estimate.state)
    if preset != "zhang_bo":
        assert set(track_states) == {"tracking", "occluded", "lost"}


@every_preset
def test_a_repeated_step_gives_the_same_bits(preset, make_target_filter, couple):
    target_filter = make_target_filter(preset)
    images = couple.images
    states, frames = followed(target_filter, images, tuple(couple.first[0]))
    # In reverse order, in the frames of the first time and in fresh ones.
    for index in reversed(range(1, len(images))):
        for frame in (frames[index], Frame(images[index])):
            assert same(target_filter.follow(states[index - 1], frame, INTERVAL), states[index])


@pytest.mark.parametrize("preset", ["default", "zhang_bo"])
def test_a_target_filter_holds_nothing_of_a_target(preset, make_target_filter, couple):
    """Two targets in turn by one filter, and each by its own filter."""
    boxes = tuple(couple.first[0]), tuple(couple.second[0])
    one = make_target_filter(preset)
    apart = [followed(make_target_filter(preset), couple.images, box)[0] for box in boxes]
    frames = [Frame(image) for image in couple.images]
    together = [[one.start(couple.images[0], box)] for box in boxes]
    for frame in frames[1:]:
        for states in together:
            states.append(one.follow(states[-1], frame, INTERVAL))
    for states, expected in zip(together, apart, strict=True):
        assert all(same(*pair) for pair in zip(states, expected, strict=True))


def test_a_tracker_does_not_change_earlier_states(couple):
    tracker = Tracker.from_preset("zhang_bo", seed=3)
    tracker.start(couple.images[0], couple.first[0])
    held, kept = [], []

    def hold():
        (track,) = tracker._manager._track_set.tracks
        held.append(track.filter_state)
        kept.append(copy.deepcopy(track.filter_state))

    hold()
    for image in couple.images[1:6]:
        tracker.update(image)
        hold()
    tracker.set_parameters({"motion.position_noise": 3.0, "cues": ("hog",)})
    tracker.update(couple.images[6])
    tracker.stop()
    assert all(same(*pair) for pair in zip(held, kept, strict=True))
