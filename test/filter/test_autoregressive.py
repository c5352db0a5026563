"""Second-order autoregressive motion: equation (7), its roots, and intervals of any length."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.filter import Gaussian, KalmanFilter
from pf_tracker_ros.filter.autoregressive import (
    SecondOrderAutoregressive,
    SecondOrderAutoregressiveParameters,
    transition_power,
)

BOX = (100.0, 50.0, 40.0, 10.0)
REFERENCE = np.array([120.0, 55.0, 40.0, 10.0])
STEP = 0.04
SHIPPED, PRINTED = (1.5, -0.5), (2.5, -0.5)
NOISE = {"position_noise": 0.5, "size_noise": 0.2, "aspect_noise": 0.1}


def with_noise(first=1.5, second=-0.5, **noise):
    """Parameters with the given noise and no other."""
    values = {"position_noise": 0.0, "size_noise": 0.0, "aspect_noise": 0.0} | noise
    values |= {"first_coefficient": first, "second_coefficient": second}
    return SecondOrderAutoregressiveParameters(**values)


def run(parameters, states, steps, interval=STEP):
    model = SecondOrderAutoregressive(BOX, parameters)
    generator = np.random.default_rng(0)
    for _ in range(steps):
        states = model.predict(states, interval, generator)
    return states


def state(now, earlier):
    return np.concatenate([now, earlier])[None]


@pytest.mark.parametrize("coefficients", [SHIPPED, PRINTED, (0.3, 0.2), (1.0, -0.5), (0.5, 1.0)])
def test_one_step_is_equation_7(coefficients):
    first, second = coefficients
    now, earlier = np.array([130.0, 50.0, 44.0, 11.0]), np.array([126.0, 52.0, 42.0, 10.0])
    predicted = run(with_noise(first, second), state(now, earlier), 1)
    expected = REFERENCE + first * (now - REFERENCE) + second * (earlier - REFERENCE)
    np.testing.assert_allclose(predicted, state(expected, now))


def test_the_printed_coefficients_diverge_and_the_shipped_ones_do_not():
    """z^2 = 2.5 z - 0.5 has the root 2.28, z^2 = 1.5 z - 0.5 the roots 1 and 0.5."""
    assert max(np.roots([1, -2.5, 0.5])) == pytest.approx(2.28, abs=0.002)
    np.testing.assert_allclose(sorted(np.roots([1, -1.5, 0.5])), [0.5, 1.0])
    now = REFERENCE + (1.0, 0.0, 0.0, 0.0)
    printed = [run(with_noise(*PRINTED), state(now, REFERENCE), steps)[0, 0] for steps in (10, 11)]
    assert printed[0] - REFERENCE[0] > 1000.0
    assert (printed[1] - REFERENCE[0]) / (printed[0] - REFERENCE[0]) == pytest.approx(
        2.28, abs=0.01
    )
    # The displacement of 1 px halves with each step: 1 + 1/2 + 1/4 + ... = 2.
    shipped = [
        run(with_noise(*SHIPPED), state(now, REFERENCE), steps)[0, 0] for steps in (1, 2, 300)
    ]
    np.testing.assert_allclose(shipped - REFERENCE[0], [1.5, 1.75, 2.0])


def test_the_shipped_coefficients_keep_an_offset_and_smaller_ones_let_it_decay():
    far = REFERENCE + (60.0, 30.0, 5.0, -2.0)
    np.testing.assert_allclose(run(with_noise(*SHIPPED), state(far, far), 100), state(far, far))
    drawn = run(with_noise(1.4, -0.5), state(far, far), 300)
    np.testing.assert_allclose(drawn, state(REFERENCE, REFERENCE), atol=1e-3)


@given(
    st.floats(-3.0, 3.0).map(lambda value: round(value, 2)),
    st.floats(-3.0, 3.0).map(lambda value: round(value, 2)),
    st.integers(0, 12),
)
def test_whole_steps_are_powers_of_the_matrix(first, second, steps):
    expected = np.linalg.matrix_power(np.array([[first, second], [1.0, 0.0]]), steps)
    power = transition_power(first, second, float(steps))
    np.testing.assert_allclose(power, expected, atol=1e-6 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("coefficients", [SHIPPED, PRINTED, (1.0, -0.25), (1.0, -0.5)])
def test_without_noise_many_short_steps_are_one_long_step(coefficients):
    """Roots of any kind: real, equal, complex."""
    start = state(REFERENCE + (8.0, -3.0, 2.0, 1.0), REFERENCE + (5.0, 0.0, 1.0, 1.0))
    many = run(with_noise(*coefficients), start, 10, interval=0.1 * STEP)
    np.testing.assert_allclose(many, run(with_noise(*coefficients), start, 1), rtol=1e-9)


@pytest.mark.parametrize("coefficients", [(0.0, 0.0), (1e-200, 0.0), (-1e-9, 1e-9)])
def test_with_negligible_coefficients_part_of_a_step_is_interpolated(coefficients):
    for part in (0.01, 0.25, 0.83, 0.999):
        power = transition_power(*coefficients, part)
        np.testing.assert_allclose(power, [[1 - part, 0.0], [part, 1 - part]], atol=1e-8)
    np.testing.assert_allclose(transition_power(*coefficients, 1.0), [[0, 0], [1, 0]], atol=1e-8)
    np.testing.assert_allclose(transition_power(*coefficients, 1.5), np.zeros((2, 2)), atol=0.01)


@pytest.mark.parametrize("interval", [0.04, 0.25])
def test_noise_has_the_declared_standard_deviation_at_every_interval(interval):
    states = np.tile(REFERENCE, (40_000, 2))
    predicted = run(with_noise(position_noise=0.5, size_noise=0.2), states, 1, interval)
    # In units of the box size, 20 px, and of width and height.
    expected = np.sqrt(interval) * np.array([10.0, 10.0, 8.0, 2.0])
    np.testing.assert_allclose(predicted[:, :4].std(axis=0), expected, rtol=0.02)
    np.testing.assert_allclose(predicted[:, :4].mean(axis=0), REFERENCE, atol=0.1)
    np.testing.assert_allclose(predicted[:, 3] / predicted[:, 2], 0.25)


def test_aspect_noise_changes_the_shape():
    predicted = run(with_noise(aspect_noise=0.2), np.tile(REFERENCE, (40_000, 2)), 1, 0.25)
    aspect = np.log(predicted[:, 2] / predicted[:, 3])
    assert aspect.std() == pytest.approx(0.1, rel=0.02)


def test_the_random_walk_is_the_same_at_every_frame_rate():
    parameters, start = with_noise(position_noise=0.5), np.tile(REFERENCE, (4_000, 2))
    slow = run(parameters, start, 50, interval=STEP)[:, 0].std()
    fast = run(parameters, start, 200, interval=STEP / 4)[:, 0].std()
    assert fast == pytest.approx(slow, rel=0.06)


def test_the_prior_s_velocity_is_between_its_two_boxes():
    model = SecondOrderAutoregressive(BOX, with_noise())
    states = model.sample_prior(40_000, np.random.default_rng(3))
    moved = (states[:, :2] - states[:, 4:6]) / STEP
    np.testing.assert_allclose(moved.std(axis=0), 10.0, rtol=0.02)
    np.testing.assert_allclose(states[:, 6:], np.tile(BOX[2:], (40_000, 1)))


def test_both_boxes_stay_limited_with_divergent_coefficients_after_an_hour():
    model = SecondOrderAutoregressive(BOX, with_noise(3.0, 3.0, **NOISE))
    generator = np.random.default_rng(0)
    states = model.sample_prior(50, generator)
    for _ in range(3):
        states = model.constrain(model.predict(states, 3600.0, generator), (160, 90))
    assert np.isfinite(states).all()
    boxes = states.reshape(-1, 4)
    assert (boxes >= [0.0, 0.0, 6.0, 6.0]).all()
    assert (boxes <= [160.0, 90.0, 1.5 * 160.0, 1.5 * 90.0]).all()


def test_the_kalman_filter_predicts_by_equation_7():
    now, earlier = REFERENCE + (10.0, -4.0, 4.0, 1.0), REFERENCE + (6.0, -2.0, 2.0, 0.0)
    model = SecondOrderAutoregressive(BOX, with_noise(*SHIPPED))
    belief = Gaussian(np.concatenate([now, earlier]), np.diag([4.0] * 4 + [1.0] * 4))
    ahead = KalmanFilter(belief, model).predict(STEP)
    # 1.5 (10, -4, 4, 1) - 0.5 (6, -2, 2, 0), and the box before is the one that was now.
    expected = REFERENCE + (12.0, -5.0, 5.0, 1.5)
    np.testing.assert_allclose(ahead.state.mean, np.concatenate([expected, now]))
    # Variance 1.5^2 x 4 + 0.5^2 x 1 = 9.25, covariance with the box before 1.5 x 4.
    covariance = ahead.belief.covariance
    np.testing.assert_allclose(np.diagonal(covariance), [9.25] * 4 + [4.0] * 4, atol=1e-4)
    np.testing.assert_allclose(np.diagonal(covariance, 4), 6.0, atol=1e-4)
    # Measured 4 px further with the same variance: half way for the box, 6 / 9.25 / 2 before.
    measured = np.concatenate([expected + 4.0, now])
    corrected = ahead.correct(measured, np.diag([9.25] * 8)).belief.mean
    np.testing.assert_allclose(corrected[:4], expected + 2.0, atol=1e-3)
    np.testing.assert_allclose(corrected[4:], now + 4.0 * 6.0 / 18.5, atol=1e-3)


def test_the_transition_prior_is_the_density_that_predict_draws_from():
    model = SecondOrderAutoregressive(BOX, with_noise(**NOISE))
    states = np.tile(np.concatenate([REFERENCE + 5.0, REFERENCE]), (40_000, 1))
    transition = model.transition(0.25)
    predicted = model.predict(states, 0.25, np.random.default_rng(0))
    np.testing.assert_allclose(transition.mean(states[:1])[0], predicted.mean(axis=0), atol=0.2)
    std = transition.std(states[:1])[0]
    np.testing.assert_allclose(std[:4], predicted[:, :4].std(axis=0), rtol=0.02)
    np.testing.assert_array_equal(std[4:], 0.0)
