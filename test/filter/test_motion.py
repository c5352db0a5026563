"""Properties of every registered motion model."""

import numpy as np
import pytest

from pf_tracker_ros.filter import MOTION_MODELS, MotionParameters
from pf_tracker_ros.filter.motion import PRIOR_POSITION_STD, PRIOR_VELOCITY_STD, models_with
from pf_tracker_ros.parameters import build, declarations

BOX = (100.0, 50.0, 40.0, 10.0)
BOX_SIZE = 20.0
every_model = pytest.mark.parametrize("name", MOTION_MODELS)


def motion_model(name, box=BOX, **parameters):
    return MOTION_MODELS[name](box, MOTION_MODELS.parameters_of(name)(**parameters))


@every_model
def test_the_prior_is_gaussian_around_the_first_box(name):
    assert (PRIOR_POSITION_STD, PRIOR_VELOCITY_STD) == (0.05, 0.5)
    motion = motion_model(name)
    states = motion.sample_prior(40_000, np.random.default_rng(3))
    np.testing.assert_allclose(states[:, :2].mean(axis=0), [120.0, 55.0], atol=0.05)
    np.testing.assert_allclose(states[:, :2].std(axis=0), 0.05 * BOX_SIZE, rtol=0.02)
    if "velocity_x" in motion.columns:
        np.testing.assert_allclose(states[:, 2:4].std(axis=0), 0.5 * BOX_SIZE, rtol=0.02)
    np.testing.assert_allclose(motion.boxes(states)[:, 2:], np.tile(BOX[2:], (40_000, 1)))
    assert states.shape[1] == len(motion.columns)


@every_model
def test_the_box_lies_around_the_center(name):
    motion = motion_model(name)
    states = motion.sample_prior(200, np.random.default_rng(0))
    boxes = motion.boxes(states)
    np.testing.assert_allclose(boxes[:, :2] + boxes[:, 2:] / 2, states[:, :2])
    np.testing.assert_allclose(boxes[:, 2:], np.tile(BOX[2:], (200, 1)))
    assert motion.columns[:2] == ("x", "y")


@every_model
def test_centers_stay_in_the_image(name):
    # The prior has a standard deviation of 200 px around the corner at (0, 0).
    motion = motion_model(name, box=(-4000.0, -1000.0, 8000.0, 2000.0))
    states = motion.sample_prior(500, np.random.default_rng(0))
    constrained = motion.constrain(states, (160, 90))
    assert constrained[:, 0].min() == 0.0
    assert constrained[:, 0].max() == 160.0
    assert constrained[:, 1].min() == 0.0
    assert constrained[:, 1].max() == 90.0


@every_model
def test_the_same_seed_predicts_the_same_states(name):
    motion = motion_model(name)
    states = motion.sample_prior(20, np.random.default_rng(0))
    one, other = (motion.predict(states, 0.1, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(one, other)
    assert (one != states).any()


@every_model
def test_a_prediction_does_not_change_its_input(name):
    motion = motion_model(name)
    states = motion.sample_prior(20, np.random.default_rng(0))
    states.setflags(write=False)
    motion.constrain(motion.predict(states, 0.1, np.random.default_rng(7)), (160, 90))


@every_model
def test_exactly_a_model_s_own_parameters_are_active_with_it(name):
    known = declarations(MotionParameters)
    own = declarations(MOTION_MODELS.parameters_of(name))
    active = {other for other, one in known.items() if one.is_active({"model": name})}
    assert active == {"model", *own}
    assert "position_noise" in own
    built = build(MotionParameters, {"model": name, "position_noise": 0.25})
    assert built.of_models[name].position_noise == 0.25


def test_models_are_found_by_capability():
    assert models_with("kalman_filter") == ("affine", "second_order_autoregressive")
    assert models_with("center_prior") == ("constant_velocity", "constant_velocity_and_size")
