"""Targets that are taken on, moved and learned by what is known beside their frame's pixels."""

import numpy as np
import pytest

from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.frames import Frame

INTERVAL = 0.04
PRESETS = ("default", "li2007", "zhang2015", "zhang_bo")


@pytest.fixture(params=PRESETS)
def target_filter(request, make_target_filter):
    return make_target_filter(request.param)


@pytest.fixture
def target(target_filter, couple):
    """After five frames."""
    draw = GeneratorState.of(np.random.default_rng(3))
    target = target_filter.initialize(Frame(couple.images[0]), tuple(couple.first[0]), draw)
    for image in couple.images[1:6]:
        target = target_filter.follow(target, Frame(image), INTERVAL)
    return target


def center(box):
    return np.array(box[:2]) + np.array(box[2:]) / 2


def test_a_target_coasts_by_its_motion_whatever_the_image_shows(target_filter, target, couple):
    frames = [Frame(image) for image in (couple.images[6], np.zeros_like(couple.images[6]))]
    seen, dark = (target_filter.operations.coast(target, frame, INTERVAL) for frame in frames)
    assert seen.estimate.box == dark.estimate.box
    np.testing.assert_array_equal(seen.particles.states, dark.particles.states)
    assert (seen.estimate.state, seen.frames_since_seen) == ("occluded", 1)
    assert seen.templates is target.templates
    assert seen.last_seen_box == target.last_seen_box
    assert seen.followed_frames == target.followed_frames + 1
    # It draws other numbers in the next frame.
    assert seen.generator_state.state != target.generator_state.state
    np.testing.assert_allclose(
        seen.estimate.box, target.motion.boxes(seen.particles.mean[None])[0], rtol=0, atol=1e-9
    )


def test_a_coasting_target_is_half_as_sure_after_each_time_that_loses_it(
    target_filter, target, couple
):
    lost_after = target_filter.parameters.track.lost_after
    sure = target.estimate.confidence
    assert sure > 0.5
    for seconds in (0.25, 0.75, 1.0):
        target = target_filter.operations.coast(
            target, Frame(couple.images[6]), seconds * lost_after
        )
    assert target.estimate.confidence == pytest.approx(0.25 * sure)


@pytest.mark.parametrize("target_filter", ["default"], indirect=True)
def test_what_is_lost_at_once_is_not_believed_unseen(make_target_filter, target, couple):
    operations = make_target_filter("default", {"track.lost_after": 0.0}).operations
    assert operations.coast(target, Frame(couple.images[6]), INTERVAL).estimate.confidence == 0.0


def test_a_coasting_target_is_hidden_no_longer_than_until_it_counts_as_lost(
    target_filter, target, couple
):
    lost_after = target_filter.parameters.track.lost_after
    frame = Frame(couple.images[6])
    spread = [np.trace(target.estimate.covariance)]
    for _ in range(3):
        target = target_filter.operations.coast(target, frame, 0.45 * lost_after)
        spread.append(np.trace(target.estimate.covariance))
    assert target.status.time_since_seen == lost_after
    assert spread == sorted(spread)


def test_a_moved_target_brings_its_particles_along_with_their_velocities(target_filter, target):
    x, y, width, height = target.estimate.box
    box = (x + 7.0, y - 4.0, width, height)
    moved = target_filter.operations.move_to(target, box)
    assert moved.estimate.box == moved.last_seen_box == box
    columns = target.motion.columns
    shift = moved.particles.states - target.particles.states
    for name, expected in (("x", 7.0), ("y", -4.0), ("velocity_x", 0.0), ("velocity_y", 0.0)):
        if name in columns:
            np.testing.assert_allclose(shift[:, columns.index(name)], expected, atol=1e-9)
    np.testing.assert_array_equal(moved.particles.log_weights, target.particles.log_weights)
    apart = moved.estimate.particle_boxes - target.estimate.particle_boxes
    np.testing.assert_allclose(apart, np.tile([7.0, -4.0, 0.0, 0.0], (len(apart), 1)), atol=1e-9)


def test_a_moved_target_has_the_size_that_it_is_given(target_filter, target):
    """Also one whose particles have shrunk or grown since the first frame, and moved twice."""
    for factor in ((1.5, 0.8), (0.9, 1.1)):
        x, y, width, height = target.estimate.box
        box = (x, y, factor[0] * width, factor[1] * height)
        moved = target_filter.operations.move_to(target, box)
        before, after = (
            one.motion.boxes(one.particles.mean[None])[0, 2:] for one in (target, moved)
        )
        np.testing.assert_allclose(after, before * factor, rtol=1e-9)
        # Parameters that change do not bring back the box that it was started on.
        again = target_filter.reconfigure(moved)
        np.testing.assert_array_equal(again.motion.boxes(again.particles.mean[None])[0, 2:], after)
        target = moved


def test_the_foresight_of_a_moved_target_moves_with_it(make_target_filter, couple):
    target_filter = make_target_filter("zhang_bo")
    target = target_filter.initialize(
        Frame(couple.images[0]), tuple(couple.first[0]), GeneratorState.of(np.random.default_rng(3))
    )
    for image in couple.images[1:6]:
        target = target_filter.follow(target, Frame(image), INTERVAL)
    x, y, width, height = target.estimate.box
    moved = target_filter.operations.move_to(target, (x + 30.0, y - 20.0, 2 * width, 2 * height))
    before, after = target.kalman_filter.belief.mean, moved.kalman_filter.belief.mean
    scale = np.log(width / target.first_box[2])
    np.testing.assert_allclose(
        after - before,
        [30.0 + width / 2, -20.0 + height / 2, -scale, 0.0, 0.0, 0.0],
        atol=1e-9,
    )
    ahead = target_filter.operations.coast(moved, Frame(couple.images[6]), INTERVAL)
    assert np.linalg.norm(center(ahead.estimate.box) - center(moved.estimate.box)) < 8.0
    np.testing.assert_allclose(ahead.estimate.box[2:], (2 * width, 2 * height), rtol=0.05)


def test_a_hidden_target_that_is_moved_was_not_seen_there(target_filter, target, couple):
    hidden = target_filter.operations.coast(target, Frame(couple.images[6]), INTERVAL)
    x, y, width, height = hidden.estimate.box
    moved = target_filter.operations.move_to(hidden, (x + 3.0, y, width, height))
    assert moved.last_seen_box == target.last_seen_box
    assert moved.estimate.state == "occluded"


def test_what_is_learned_again_is_what_is_in_the_box_now(target_filter, target, couple):
    elsewhere = target_filter.operations.move_to(target, tuple(couple.second[6]))
    frame = Frame(couple.images[6])
    learned = target_filter.operations.relearn(elsewhere, frame)
    assert learned.templates.keys() == target.templates.keys()
    assert learned.first_templates is learned.templates
    # From there on the other one is followed.
    for number in (7, 8):
        learned = target_filter.follow(learned, Frame(couple.images[number]), INTERVAL)
    apart = np.linalg.norm(center(learned.estimate.box) - center(couple.second[8]))
    assert apart < 8.0
