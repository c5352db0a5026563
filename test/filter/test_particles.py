"""The particle set: weights, moments and degenerate likelihoods."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pf_tracker_ros.filter import ParticleSet

finite_logs = st.floats(-700, 700)


def test_mean_and_covariance_by_hand():
    particles = ParticleSet(np.array([[0.0, 0.0], [4.0, 2.0]]), np.log([3.0, 1.0]))
    np.testing.assert_allclose(particles.weights, [0.75, 0.25])
    np.testing.assert_allclose(particles.mean, [1.0, 0.5])
    # 0.75 * (-1)^2 + 0.25 * 3^2 = 3, and so on.
    np.testing.assert_allclose(particles.covariance, [[3.0, 1.5], [1.5, 0.75]])


def test_effective_sample_size_by_hand():
    # 1 / (0.5^2 + 0.25^2 + 0.25^2) = 8 / 3
    particles = ParticleSet(np.zeros((3, 1)), np.log([2.0, 1.0, 1.0]))
    assert particles.effective_sample_size == pytest.approx(8 / 3)


@given(arrays(float, st.integers(1, 40), elements=finite_logs))
def test_weights_sum_to_one_and_the_effective_sample_size_lies_between_one_and_n(log_weights):
    particles = ParticleSet(np.zeros((len(log_weights), 2)), log_weights)
    assert particles.weights.sum() == pytest.approx(1.0)
    assert 1.0 - 1e-9 <= particles.effective_sample_size <= len(log_weights) + 1e-9


@given(arrays(float, 5, elements=finite_logs), st.floats(-1e6, 1e6))
def test_a_constant_factor_of_the_likelihood_changes_nothing(log_likelihood, constant):
    particles = ParticleSet.uniform(np.arange(5.0)[:, None])
    one = particles.reweight(log_likelihood)
    other = particles.reweight(log_likelihood + constant)
    np.testing.assert_allclose(one.weights, other.weights, atol=1e-6)


def test_likelihoods_far_below_the_smallest_float_keep_their_ratio():
    particles = ParticleSet.uniform(np.zeros((2, 1))).reweight([-10_000.0, -10_000.0 + np.log(3)])
    np.testing.assert_allclose(particles.weights, [0.25, 0.75])


def test_weights_carry_over_from_one_measurement_to_the_next():
    particles = ParticleSet.uniform(np.zeros((2, 1)))
    twice = particles.reweight(np.log([0.2, 0.6])).reweight(np.log([0.5, 0.5]))
    np.testing.assert_allclose(twice.weights, [0.25, 0.75])


@pytest.mark.parametrize("nothing", [-np.inf, np.nan])
def test_a_likelihood_of_zero_everywhere_leaves_the_weights(nothing):
    particles = ParticleSet(np.zeros((2, 1)), np.log([0.3, 0.7]))
    np.testing.assert_allclose(particles.reweight([nothing, nothing]).weights, [0.3, 0.7])


def test_particles_of_infinite_likelihood_share_all_of_the_weight():
    particles = ParticleSet(np.zeros((4, 1)), np.log([0.1, 0.2, 0.3, 0.4]))
    weighted = particles.reweight([np.inf, 0.0, np.nan, np.inf])
    np.testing.assert_allclose(weighted.weights, [0.5, 0.0, 0.0, 0.5])


def test_a_particle_of_nan_likelihood_gets_no_weight():
    particles = ParticleSet.uniform(np.zeros((3, 1))).reweight([0.0, np.nan, 0.0])
    np.testing.assert_allclose(particles.weights, [0.5, 0.0, 0.5])


def test_a_set_cannot_be_changed_in_place():
    states = np.zeros((2, 1))
    particles = ParticleSet.uniform(states)
    states[0] = 9.0
    assert particles.states[0] == 0.0
    for array in (particles.states, particles.log_weights, particles.weights, particles.mean):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize("shape", [(0, 2), (3,)])
def test_states_of_a_wrong_shape_are_refused(shape):
    with pytest.raises(ValueError, match=r"expected \(N, D\)"):
        ParticleSet(np.zeros(shape), np.zeros(shape[0]))


def test_weights_of_a_wrong_shape_are_refused():
    with pytest.raises(ValueError, match=r"expected \(3,\)"):
        ParticleSet(np.zeros((3, 2)), np.zeros(2))


def test_moved_particles_keep_their_weights_and_must_be_as_many():
    particles = ParticleSet(np.zeros((2, 1)), np.log([3.0, 1.0]))
    moved = particles.move([[5.0, 6.0], [7.0, 8.0]])
    np.testing.assert_allclose(moved.weights, [0.75, 0.25])
    np.testing.assert_allclose(moved.mean, [5.5, 6.5])
    for states in (np.zeros((3, 1)), np.zeros(2)):
        with pytest.raises(ValueError, match=r"expected \(2, D\)"):
            particles.move(states)


def test_resampled_particles_have_equal_weights():
    particles = ParticleSet(np.array([[1.0], [2.0]]), np.log([3.0, 1.0]))
    resampled = particles.resample(np.array([1, 1, 0]))
    np.testing.assert_allclose(resampled.weights, 1 / 3)
    np.testing.assert_array_equal(resampled.states, [[2.0], [2.0], [1.0]])


@pytest.mark.parametrize("shape", [(3, 1), (1, 3), (2,), (4,), (3, 3)])
def test_likelihoods_of_another_shape_are_refused(shape):
    particles = ParticleSet.uniform(np.zeros((3, 2)))
    with pytest.raises(ValueError, match=r"expected \(3,\)"):
        particles.reweight(np.zeros(shape))
