"""States that coast, move and relearn."""

import numpy as np
import pytest

from pf_tracker_ros.frames import Frame

INTERVAL = 0.04
PRESETS = ("default", "li2007", "zhang2015", "zhang_bo")


@pytest.fixture(params=PRESETS)
def target_filter(request, make_target_filter):
    return make_target_filter(request.param)


@pytest.fixture
def state(target_filter, couple):
    """After five frames."""
    state = target_filter.start(couple.images[0], couple.first[0])
    for image in couple.images[1:6]:
        state = target_filter.follow(state, Frame(image), INTERVAL)
    return state


def center(box):
    return np.array(box[:2]) + np.array(box[2:]) / 2


def test_a_target_coasts_by_its_motion_model_whatever_the_image_shows(target_filter, state, couple):
    frames = [Frame(image) for image in (couple.images[6], np.zeros_like(couple.images[6]))]
    seen, dark = (target_filter.operations.coast(state, frame, INTERVAL) for frame in frames)
    assert seen.estimate.box == dark.estimate.box
    np.testing.assert_array_equal(seen.particles.states, dark.particles.states)
    assert (seen.estimate.state, seen.frames_since_seen) == ("occluded", 1)
    assert seen.templates is state.templates
    assert seen.last_seen_box == state.last_seen_box
    assert seen.followed_frames == state.followed_frames + 1
    # The next frame draws other random numbers.
    assert seen.generator_state.state != state.generator_state.state
    np.testing.assert_allclose(
        seen.estimate.box, state.motion.boxes(seen.particles.mean[None])[0], rtol=0, atol=1e-9
    )


def test_the_confidence_of_a_coasting_target_halves_in_each_lost_after(
    target_filter, state, couple
):
    lost_after = target_filter.parameters.track.lost_after
    before = state.estimate.confidence
    assert before > 0.5
    for seconds in (0.25, 0.75, 1.0):
        state = target_filter.operations.coast(state, Frame(couple.images[6]), seconds * lost_after)
    assert state.estimate.confidence == pytest.approx(0.25 * before)


@pytest.mark.parametrize("target_filter", ["default"], indirect=True)
def test_with_lost_after_zero_a_coasting_target_has_no_confidence(
    make_target_filter, state, couple
):
    operations = make_target_filter("default", {"track.lost_after": 0.0}).operations
    assert operations.coast(state, Frame(couple.images[6]), INTERVAL).estimate.confidence == 0.0


def test_the_time_since_a_coasting_target_was_seen_ends_at_lost_after(target_filter, state, couple):
    lost_after = target_filter.parameters.track.lost_after
    frame = Frame(couple.images[6])
    traces = [np.trace(state.estimate.covariance)]
    for _ in range(3):
        state = target_filter.operations.coast(state, frame, 0.45 * lost_after)
        traces.append(np.trace(state.estimate.covariance))
    assert state.status.time_since_seen == lost_after
    assert traces == sorted(traces)


def test_a_moved_target_moves_its_particles_and_keeps_their_velocities(target_filter, state):
    x, y, width, height = state.estimate.box
    box = (x + 7.0, y - 4.0, width, height)
    moved = target_filter.operations.move_to(state, box)
    assert moved.estimate.box == moved.last_seen_box == box
    columns = state.motion.columns
    shift = moved.particles.states - state.particles.states
    for name, expected in (("x", 7.0), ("y", -4.0), ("velocity_x", 0.0), ("velocity_y", 0.0)):
        if name in columns:
            np.testing.assert_allclose(shift[:, columns.index(name)], expected, atol=1e-9)
    np.testing.assert_array_equal(moved.particles.log_weights, state.particles.log_weights)
    apart = moved.estimate.particle_boxes - state.estimate.particle_boxes
    np.testing.assert_allclose(apart, np.tile([7.0, -4.0, 0.0, 0.0], (len(apart), 1)), atol=1e-9)


def test_a_moved_target_has_the_given_size(target_filter, state):
    """Also if its size has changed since the first frame, and after a second move."""
    for factor in ((1.5, 0.8), (0.9, 1.1)):
        x, y, width, height = state.estimate.box
        box = (x, y, factor[0] * width, factor[1] * height)
        moved = target_filter.operations.move_to(state, box)
        before, after = (
            one.motion.boxes(one.particles.mean[None])[0, 2:] for one in (state, moved)
        )
        np.testing.assert_allclose(after, before * factor, rtol=1e-9)
        # Other parameters do not restore the size of the first frame.
        again = target_filter.reconfigure(moved)
        np.testing.assert_array_equal(again.motion.boxes(again.particles.mean[None])[0, 2:], after)
        state = moved


@pytest.mark.parametrize("target_filter", ["zhang_bo"], indirect=True)
def test_the_kalman_filter_of_a_moved_target_moves_with_it(target_filter, state, couple):
    x, y, width, height = state.estimate.box
    moved = target_filter.operations.move_to(state, (x + 30.0, y - 20.0, 2 * width, 2 * height))
    before, after = state.kalman_filter.belief.mean, moved.kalman_filter.belief.mean
    scale = np.log(width / state.first_box[2])
    np.testing.assert_allclose(
        after - before, [30.0 + width / 2, -20.0 + height / 2, -scale, 0.0, 0.0, 0.0], atol=1e-9
    )
    ahead = target_filter.operations.coast(moved, Frame(couple.images[6]), INTERVAL)
    assert np.linalg.norm(center(ahead.estimate.box) - center(moved.estimate.box)) < 8.0
    np.testing.assert_allclose(ahead.estimate.box[2:], (2 * width, 2 * height), rtol=0.05)


def test_a_move_of_an_occluded_target_keeps_the_last_seen_box(target_filter, state, couple):
    hidden = target_filter.operations.coast(state, Frame(couple.images[6]), INTERVAL)
    x, y, width, height = hidden.estimate.box
    moved = target_filter.operations.move_to(hidden, (x + 3.0, y, width, height))
    assert moved.last_seen_box == state.last_seen_box
    assert moved.estimate.state == "occluded"


def test_relearned_templates_are_those_of_the_current_box(target_filter, state, couple):
    elsewhere = target_filter.operations.move_to(state, tuple(couple.second[6]))
    frame = Frame(couple.images[6])
    learned = target_filter.operations.relearn(elsewhere, frame)
    assert learned.templates.keys() == state.templates.keys()
    box = np.array(learned.estimate.box)
    assert learned.exemplars.similarities(frame, box[None]) == pytest.approx(1.0)
    assert learned.exemplars.similarities(frame, couple.first[6][None]) < 0.9
    # From there on the other target is tracked.
    for number in (7, 8):
        learned = target_filter.follow(learned, Frame(couple.images[number]), INTERVAL)
    apart = np.linalg.norm(center(learned.estimate.box) - center(couple.second[8]))
    assert apart < 8.0
