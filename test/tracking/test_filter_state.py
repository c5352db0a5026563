"""A target is a value: to follow it changes nothing in it, and meets the same chances again."""

import copy
import itertools
from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.presets import PRESETS

INTERVAL = 0.04
every_preset = pytest.mark.parametrize("preset", sorted(PRESETS))


def same(one, other):
    """Whether two values are the same to the bit, whatever they are made of."""
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
    """The target in each image, and the frames; the first one is where it begins."""
    frames = [Frame(image) for image in images]
    draw = GeneratorState.of(np.random.default_rng(seed))
    targets = [target_filter.initialize(frames[0], box, draw)]
    for frame in frames[1:]:
        targets.append(target_filter.follow(targets[-1], frame, INTERVAL))
    return targets, frames


def test_what_differs_is_told_apart(make_target_filter, couple):
    targets, _ = followed(make_target_filter("default"), couple.images[:3], tuple(couple.first[0]))
    assert same(targets[1], copy.deepcopy(targets[1]))
    for earlier, later in itertools.pairwise(targets):
        for field in ("particles", "templates", "generator_state", "estimate", "followed_frames"):
            assert not same(getattr(earlier, field), getattr(later, field))


@every_preset
def test_following_changes_nothing_in_the_target_followed(preset, make_target_filter, couple):
    """Through an occlusion and out of it again."""
    target_filter = make_target_filter(preset, {"track.lost_after": 0.1})
    targets, _ = followed(target_filter, couple.images[:1], tuple(couple.first[0]))
    states = []
    for image in couple.images[1:]:
        before = targets[-1]
        kept = copy.deepcopy(before)
        targets.append(target_filter.follow(before, Frame(image), INTERVAL))
        assert same(before, kept)
        states.append(targets[-1].estimate.state)
    if preset != "zhang_bo":
        assert set(states) == {"tracking", "occluded", "lost"}


@every_preset
def test_following_twice_from_one_frame_gives_the_same_bits(preset, make_target_filter, couple):
    target_filter = make_target_filter(preset)
    images = couple.images
    targets, frames = followed(target_filter, images, tuple(couple.first[0]))
    # In another order than the first time, and in frames that were looked at already or were not.
    for index in reversed(range(1, len(images))):
        for frame in (frames[index], Frame(images[index])):
            assert same(target_filter.follow(targets[index - 1], frame, INTERVAL), targets[index])


@pytest.mark.parametrize("preset", ["default", "zhang_bo"])
def test_a_follower_holds_nothing_of_a_target(preset, make_target_filter, couple):
    """Two targets in turn by one follower, and each by one of its own."""
    boxes = tuple(couple.first[0]), tuple(couple.second[0])
    one = make_target_filter(preset)
    apart = [followed(make_target_filter(preset), couple.images, box)[0] for box in boxes]
    frames = [Frame(image) for image in couple.images]
    draw = GeneratorState.of(np.random.default_rng(3))
    together = [[one.initialize(frames[0], box, draw)] for box in boxes]
    for frame in frames[1:]:
        for targets in together:
            targets.append(one.follow(targets[-1], frame, INTERVAL))
    for targets, expected in zip(together, apart, strict=True):
        assert all(same(*pair) for pair in zip(targets, expected, strict=True))


def test_a_target_of_a_tracker_stays_as_it_was(couple):
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
