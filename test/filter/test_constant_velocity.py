"""Constant velocity: the equations hold at every frame rate."""

import numpy as np
import pytest

from pf_tracker_ros.filter.constant_velocity import (
    ConstantVelocity,
    ConstantVelocityAndSize,
    ConstantVelocityAndSizeParameters,
    ConstantVelocityParameters,
)
from pf_tracker_ros.filter.motion import SMALLEST_SIDE

BOX = (100.0, 50.0, 40.0, 10.0)
BOX_SIZE = 20.0
STILL = ConstantVelocityParameters(position_noise=0.0, velocity_noise=0.0)


def test_without_noise_one_second_is_the_paper_s_transition_matrix():
    states = np.array([[10.0, 20.0, 3.0, -4.0], [0.0, 0.0, 1.0, 2.0]])
    transition = np.array([[1, 0, 1, 0], [0, 1, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]])
    predicted = ConstantVelocity(BOX, STILL).predict(states, 1.0, np.random.default_rng(0))
    np.testing.assert_allclose(predicted, states @ transition.T)


def test_without_noise_many_short_steps_are_one_long_step():
    states = np.array([[10.0, 20.0, 3.0, -4.0]])
    model = ConstantVelocity(BOX, STILL)
    generator = np.random.default_rng(0)
    many = states
    for _ in range(10):
        many = model.predict(many, 0.1, generator)
    np.testing.assert_allclose(many, model.predict(states, 1.0, generator))


@pytest.mark.parametrize("interval", [0.04, 0.25])
def test_noise_has_the_declared_standard_deviation_at_every_interval(interval):
    parameters = ConstantVelocityParameters(position_noise=0.5, velocity_noise=2.0)
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
        BOX, ConstantVelocityAndSizeParameters(size_noise=0.2, aspect_noise=0.0)
    ).predict(states, 0.25, generator)
    assert np.log(grown[:, 4]).std() == pytest.approx(0.1, rel=0.02)
    np.testing.assert_allclose(grown[:, 4] / grown[:, 5], 4.0)
    bent = ConstantVelocityAndSize(
        BOX, ConstantVelocityAndSizeParameters(size_noise=0.0, aspect_noise=0.2)
    ).predict(states, 0.25, generator)
    assert np.log(bent[:, 4] / bent[:, 5]).std() == pytest.approx(0.1, rel=0.02)
    np.testing.assert_allclose(bent[:, 4] * bent[:, 5], 400.0)


@pytest.mark.parametrize(
    ("model", "parameters"),
    [
        (ConstantVelocity, ConstantVelocityParameters(position_noise=0.5)),
        (ConstantVelocityAndSize, ConstantVelocityAndSizeParameters(position_noise=0.5)),
    ],
)
def test_the_center_prior_is_the_density_of_the_predicted_centers(model, parameters):
    motion = model(BOX, parameters)
    states = np.repeat(motion.sample_prior(1, np.random.default_rng(0)), 40_000, axis=0)
    predicted = motion.predict(states, 0.25, np.random.default_rng(1))
    mean, std = motion.center_prior(states, 0.25)
    np.testing.assert_allclose(predicted[:, :2].mean(axis=0), mean[0], atol=0.1)
    np.testing.assert_allclose(predicted[:, :2].std(axis=0), np.ravel(std)[0], rtol=0.02)
    # 0.5 box sizes of 20 px per square root of a second, for 0.25 s.
    assert motion.random_walk_std(0.25) * BOX_SIZE == pytest.approx(np.ravel(std)[0]) == 5.0


def test_without_noise_the_center_prior_still_has_a_standard_deviation():
    _, std = ConstantVelocity(BOX, STILL).center_prior(np.zeros((3, 4)), 1.0)
    assert (std > 0.0).all()


def test_sizes_neither_collapse_nor_grow_far_beyond_the_image():
    motion = ConstantVelocityAndSize(BOX, ConstantVelocityAndSizeParameters())
    states = np.array([[80.0, 45.0, 0.0, 0.0, 1e-9, 1e9]])
    constrained = motion.constrain(states, (160, 90))
    np.testing.assert_allclose(constrained[0, 4:], [SMALLEST_SIDE, 1.5 * 90.0])


def test_a_target_smaller_than_the_smallest_side_keeps_its_size():
    motion = ConstantVelocityAndSize((10.0, 10.0, 3.0, 4.0), ConstantVelocityAndSizeParameters())
    states = motion.sample_prior(5, np.random.default_rng(0))
    np.testing.assert_allclose(motion.constrain(states, (160, 90))[:, 4:], [[3.0, 4.0]] * 5)
