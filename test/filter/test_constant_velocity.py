"""Motion models: what the equations say, whatever the frame rate."""

import numpy as np
import pytest

from pf_tracker_ros.filter import MOTION_MODELS, MotionParameters
from pf_tracker_ros.filter.limits import SMALLEST_SIDE
from pf_tracker_ros.filter.motion import ConstantVelocity, ConstantVelocityAndSize

BOX = (100.0, 50.0, 40.0, 10.0)
BOX_SIZE = 20.0
STILL = MotionParameters(position_noise=0.0, velocity_noise=0.0, size_noise=0.0, aspect_noise=0.0)
every_model = pytest.mark.parametrize("model", MOTION_MODELS.values())


def test_without_noise_one_second_is_the_paper_s_transition_matrix():
    states = np.array([[10.0, 20.0, 3.0, -4.0], [0.0, 0.0, 1.0, 2.0]])
    transition = np.array([[1, 0, 1, 0], [0, 1, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]])
    predicted = ConstantVelocity(BOX, STILL).predict(states, 1.0, np.random.default_rng(0))
    np.testing.assert_allclose(predicted, states @ transition.T)


def test_without_noise_many_short_steps_are_one_long_step():
    states = np.array([[10.0, 20.0, 3.0, -4.0]])
    model = ConstantVelocity(BOX, MotionParameters(position_noise=0.0, velocity_noise=0.0))
    generator = np.random.default_rng(0)
    many = states
    for _ in range(10):
        many = model.predict(many, 0.1, generator)
    np.testing.assert_allclose(many, model.predict(states, 1.0, generator))


@pytest.mark.parametrize("interval", [0.04, 0.25])
def test_noise_has_the_declared_spread_at_every_interval(interval):
    parameters = MotionParameters(position_noise=0.5, velocity_noise=2.0)
    states = np.zeros((40_000, 4))
    predicted = ConstantVelocity(BOX, parameters).predict(
        states, interval, np.random.default_rng(1)
    )
    expected = BOX_SIZE * np.sqrt(interval) * np.array([0.5, 0.5, 2.0, 2.0])
    np.testing.assert_allclose(predicted.std(axis=0), expected, rtol=0.02)
    np.testing.assert_allclose(predicted.mean(axis=0), 0.0, atol=5 * expected.max() / 200)


def test_size_noise_changes_size_and_aspect_noise_only_the_shape():
    states = np.tile([0.0, 0.0, 0.0, 0.0, 40.0, 10.0], (40_000, 1))
    generator = np.random.default_rng(2)
    grown = ConstantVelocityAndSize(
        BOX, MotionParameters(size_noise=0.2, aspect_noise=0.0)
    ).predict(states, 0.25, generator)
    assert np.log(grown[:, 4]).std() == pytest.approx(0.1, rel=0.02)
    np.testing.assert_allclose(grown[:, 4] / grown[:, 5], 4.0)
    bent = ConstantVelocityAndSize(BOX, MotionParameters(size_noise=0.0, aspect_noise=0.2)).predict(
        states, 0.25, generator
    )
    assert np.log(bent[:, 4] / bent[:, 5]).std() == pytest.approx(0.1, rel=0.02)
    np.testing.assert_allclose(bent[:, 4] * bent[:, 5], 400.0)


def test_velocities_fade_at_the_declared_rate():
    model = ConstantVelocity(
        BOX, MotionParameters(position_noise=0.0, velocity_noise=0.0, velocity_damping=2.0)
    )
    predicted = model.predict(np.array([[0.0, 0.0, 8.0, 0.0]]), 0.5, np.random.default_rng(0))
    assert predicted[0, 2] == pytest.approx(8.0 / np.e)


@every_model
def test_the_prior_is_gaussian_around_the_first_box(model):
    parameters = MotionParameters(prior_position=0.1, prior_velocity=0.5)
    motion = model(BOX, parameters)
    states = motion.prior(40_000, np.random.default_rng(3))
    np.testing.assert_allclose(states[:, :2].mean(axis=0), [120.0, 55.0], atol=0.05)
    np.testing.assert_allclose(states[:, :2].std(axis=0), 2.0, rtol=0.02)
    if "velocity_x" in motion.columns:
        np.testing.assert_allclose(states[:, 2:4].std(axis=0), 10.0, rtol=0.02)
    np.testing.assert_allclose(motion.boxes(states)[:, 2:], np.tile(BOX[2:], (40_000, 1)))
    assert states.shape[1] == len(motion.columns)


@every_model
def test_the_box_lies_around_the_center(model):
    motion = model(BOX, MotionParameters(prior_position=0.0, prior_velocity=0.0))
    states = motion.prior(1, np.random.default_rng(0))
    np.testing.assert_allclose(motion.boxes(states), [BOX])


@every_model
def test_centers_stay_in_the_image(model):
    motion = model(BOX, MotionParameters(prior_position=10.0))
    states = motion.prior(500, np.random.default_rng(0))
    constrained = motion.constrain(states, (160, 90))
    assert constrained[:, 0].min() == 0.0
    assert constrained[:, 0].max() == 160.0
    assert constrained[:, 1].min() == 0.0
    assert constrained[:, 1].max() == 90.0


def test_sizes_neither_collapse_nor_outgrow_the_image():
    motion = ConstantVelocityAndSize(BOX, MotionParameters())
    states = np.array([[80.0, 45.0, 0.0, 0.0, 1e-9, 1e9]])
    constrained = motion.constrain(states, (160, 90))
    np.testing.assert_allclose(constrained[0, 4:], [SMALLEST_SIDE, 90.0])


def test_a_target_smaller_than_the_smallest_side_keeps_its_size():
    motion = ConstantVelocityAndSize((10.0, 10.0, 3.0, 4.0), MotionParameters())
    states = motion.prior(5, np.random.default_rng(0))
    np.testing.assert_allclose(motion.constrain(states, (160, 90))[:, 4:], [[3.0, 4.0]] * 5)
