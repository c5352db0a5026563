"""The Kalman filter's Gaussian: prediction, correction and density against values by hand."""

import numpy as np
import pytest

from pf_tracker_ros.filter import Gaussian


def test_prediction_by_hand():
    # Position 1 and velocity 2 with variances 4 and 1, one second on: the position becomes 3 with
    # variance 4 + 1 + 0.5, the covariance with the velocity 1.
    state = Gaussian([1.0, 2.0], np.diag([4.0, 1.0]))
    predicted = state.predict([[1.0, 1.0], [0.0, 1.0]], np.diag([0.5, 0.25]))
    np.testing.assert_allclose(predicted.mean, [3.0, 2.0])
    np.testing.assert_allclose(predicted.covariance, [[5.5, 1.0], [1.0, 1.25]])


def test_correction_by_hand():
    # The gain is 3 / (3 + 1) for the measured column and 1 / (3 + 1) for the correlated one.
    state = Gaussian([0.0, 10.0], [[3.0, 1.0], [1.0, 2.0]])
    corrected = state.correct([4.0], [[1.0, 0.0]], [[1.0]])
    np.testing.assert_allclose(corrected.mean, [3.0, 11.0])
    np.testing.assert_allclose(corrected.covariance, [[0.75, 0.25], [0.25, 1.75]])


def test_a_nonlinear_model_passes_its_value_and_its_jacobian():
    # x^2 / 20 at x = 10 is 5 with slope 1; 6 was measured with variance 1, so the gain is 1/2.
    state = Gaussian([3.0], [[4.0]]).predict([[0.5]], [[0.0]], mean=[10.0])
    np.testing.assert_allclose(state.covariance, [[1.0]])
    corrected = state.correct([6.0], [[1.0]], [[1.0]], expected=[5.0])
    np.testing.assert_allclose(corrected.mean, [10.5])
    np.testing.assert_allclose(corrected.covariance, [[0.5]])


def test_a_state_without_variance_is_not_corrected():
    still = Gaussian([1.0], [[0.0]]).correct([5.0], [[1.0]], [[1.0]])
    np.testing.assert_allclose(still.mean, [1.0])
    np.testing.assert_allclose(still.covariance, [[0.0]])


def test_density_by_hand():
    # At one standard deviation along each axis: exp(-1) / (2 pi * 2 * 3).
    density = Gaussian([1.0, -1.0], np.diag([4.0, 9.0])).log_density(np.array([[3.0, 2.0]]))
    np.testing.assert_allclose(np.exp(density), [np.exp(-1) / (12 * np.pi)])


def test_draws_have_the_mean_and_the_covariance():
    gaussian = Gaussian([5.0, -3.0], [[4.0, 1.5], [1.5, 1.0]])
    states = gaussian.draw(40_000, np.random.default_rng(0))
    np.testing.assert_allclose(states.mean(axis=0), gaussian.mean, atol=0.05)
    np.testing.assert_allclose(np.cov(states.T), gaussian.covariance, atol=0.1)


def test_a_mixture_and_a_measurement_have_the_moments_of_what_is_drawn_from_them():
    generator = np.random.default_rng(0)
    parts = [
        Gaussian([0.0, 1.0], [[1.0, 0.5], [0.5, 2.0]]),
        Gaussian([3.0, -1.0], [[0.2, 0.0], [0.0, 0.1]]),
    ]
    mixture = Gaussian.mixture(parts, [3.0, 1.0])
    states = np.vstack([parts[0].draw(90_000, generator), parts[1].draw(30_000, generator)])
    assert mixture.mean == pytest.approx(states.mean(axis=0), abs=0.02)
    assert mixture.covariance == pytest.approx(np.cov(states.T), abs=0.03)
    observed = mixture.observe([[2.0, 1.0]], [[0.5]])
    assert observed.mean == pytest.approx([2.0 * 0.75 + 0.5])
    assert observed.covariance == pytest.approx(np.var(states @ [2.0, 1.0]) + 0.5, abs=0.1)


def test_marginal_keeps_the_named_columns():
    gaussian = Gaussian([1.0, 2.0, 3.0], [[1.0, 0.1, 0.2], [0.1, 2.0, 0.3], [0.2, 0.3, 3.0]])
    marginal = gaussian.marginal(np.array([True, False, True]))
    np.testing.assert_allclose(marginal.mean, [1.0, 3.0])
    np.testing.assert_allclose(marginal.covariance, [[1.0, 0.2], [0.2, 3.0]])


@pytest.mark.parametrize(
    ("mean", "covariance", "complaint"),
    [
        ([0.0, 0.0], [[1.0]], r"expected \(D,\) and \(D, D\)"),
        ([[0.0]], [[1.0]], r"expected \(D,\) and \(D, D\)"),
        ([np.nan], [[1.0]], "finite"),
        ([0.0], [[np.inf]], "finite"),
    ],
)
def test_wrong_shapes_and_infinite_numbers_are_rejected(mean, covariance, complaint):
    with pytest.raises(ValueError, match=complaint):
        Gaussian(mean, covariance)


def test_a_singular_covariance_has_no_density():
    with pytest.raises(ValueError, match="positive definite"):
        Gaussian([0.0], [[0.0]]).log_density(np.zeros((1, 1)))
