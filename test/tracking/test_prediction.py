"""Predictors: the particles of the next frame and their weights."""

from dataclasses import replace

import numpy as np
import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.filter import LONGEST_PREDICTION, Gaussian, propose_from_prediction
from pf_tracker_ros.filter.proposals import ProposalParameters
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.estimate import TrackStatus
from pf_tracker_ros.tracking.prediction import KalmanPredictor, Predictor

SIZE = (240, 160)
INTERVAL = 0.08


@pytest.fixture
def make_state(make_target_filter, couple):
    """A function that makes a state after a few frames, with particles of different weights."""

    def make(preset, parameters=None):
        target_filter = make_target_filter(
            preset, {"resampling.threshold": 0.0} | (parameters or {})
        )
        state = target_filter.start(couple.images[0], couple.first[0])
        for image in couple.images[1:4]:
            state = target_filter.follow(state, Frame(image), 0.04)
        assert np.ptp(state.particles.log_weights) > 0.1
        return state

    return make


def generator():
    return np.random.default_rng(8)


@pytest.mark.parametrize("preset", ["default", "li2007", "zhang2015", "zhang_bo"])
def test_the_transition_prior_draws_by_the_motion_model_and_keeps_the_weights(preset, make_state):
    state = make_state(preset)
    prediction = Predictor().predict(state, INTERVAL, SIZE, generator())
    states = state.motion.predict(state.particles.states, INTERVAL, generator())
    states = state.motion.constrain(states, SIZE)
    np.testing.assert_array_equal(prediction.particles.states, states)
    np.testing.assert_array_equal(prediction.particles.log_weights, state.particles.log_weights)
    assert prediction.interval == INTERVAL
    assert prediction.kalman_filter is None


@pytest.mark.parametrize("preset", ["li2007", "zhang_bo"])
def test_a_prediction_is_limited_to_the_longest_interval(preset, make_state):
    state = make_state(preset)
    predictor = KalmanPredictor(ProposalParameters()) if state.kalman_filter else Predictor()
    far, longest = (
        predictor.predict(state, seconds, SIZE, generator())
        for seconds in (10 * LONGEST_PREDICTION, LONGEST_PREDICTION)
    )
    assert far.interval == LONGEST_PREDICTION
    np.testing.assert_array_equal(far.particles.states, longest.particles.states)


@pytest.mark.parametrize("model", ["affine", "second_order_autoregressive"])
def test_the_weights_of_a_kalman_proposal_carry_p_over_q(model, make_state):
    state = make_state("zhang_bo", {"motion.model": model})
    share = 0.4
    predictor = KalmanPredictor(ProposalParameters(share=share))
    prediction = predictor.predict(state, INTERVAL, SIZE, generator())

    kalman_filter = state.kalman_filter.predict(INTERVAL)
    transition = state.motion.transition(INTERVAL, kalman_filter.belief.mean)
    before = state.particles
    proposed = propose_from_prediction(
        before.states, transition, kalman_filter.state, share, generator()
    )
    np.testing.assert_array_equal(
        prediction.particles.states, state.motion.constrain(proposed.states, SIZE)
    )
    expected = before.move(proposed.states).reweight(proposed.log_ratio)
    np.testing.assert_array_equal(prediction.particles.log_weights, expected.log_weights)
    np.testing.assert_array_equal(prediction.kalman_filter.belief.mean, kalman_filter.belief.mean)
    np.testing.assert_array_equal(
        prediction.kalman_filter.belief.covariance, kalman_filter.belief.covariance
    )

    # p and q from the densities, in the columns with noise.
    mean, std = transition.mean(before.states), transition.std(before.states)
    std = np.broadcast_to(std, mean.shape)
    noisy = std[0] > 0.0
    states, ahead = proposed.states[:, noisy], kalman_filter.state.marginal(noisy)
    p = np.exp(
        [
            Gaussian(one, np.diag(sigma**2)).log_density(sample[None])[0]
            for one, sigma, sample in zip(mean[:, noisy], std[:, noisy], states, strict=True)
        ]
    )
    q = share * np.exp(ahead.log_density(states)) + (1.0 - share) * p
    weights = before.weights * p / q
    np.testing.assert_allclose(prediction.particles.weights, weights / weights.sum(), rtol=1e-6)
    assert not np.allclose(prediction.particles.weights, before.weights)


def test_a_share_of_the_particles_is_drawn_around_the_kalman_filter(make_state):
    """Its belief is moved far away."""
    state = make_state("zhang_bo")
    belief = state.kalman_filter.belief
    away = belief.mean + [100.0, 40.0, 0.0, 0.0, 0.0, 0.0]
    kalman_filter = replace(state.kalman_filter, belief=Gaussian(away, belief.covariance))
    state = replace(state, kalman_filter=kalman_filter)
    predictor = KalmanPredictor(ProposalParameters(share=0.3))
    particles = predictor.predict(state, 0.04, SIZE, generator()).particles
    is_away = particles.states[:, 0] > state.particles.states[:, 0].max() + 40.0
    assert 0.15 < is_away.mean() < 0.45


@pytest.mark.parametrize("track_state", ["occluded", "lost"])
def test_out_of_sight_all_particles_are_drawn_from_the_transition_prior(track_state, make_state):
    state = replace(make_state("zhang_bo"), status=TrackStatus(track_state, 0.5))
    predictor = KalmanPredictor(ProposalParameters(share=0.9))
    prediction = predictor.predict(state, INTERVAL, SIZE, generator())
    np.testing.assert_array_equal(prediction.particles.log_weights, state.particles.log_weights)
    # The Kalman filter is predicted on, and its velocity moves the particles.
    kalman_filter = state.kalman_filter.predict(INTERVAL)
    transition = state.motion.transition(INTERVAL, kalman_filter.belief.mean)
    noise = generator().standard_normal(state.particles.states.shape)
    states = transition.mean(state.particles.states) + noise * transition.std(
        state.particles.states
    )
    np.testing.assert_allclose(prediction.particles.states, state.motion.constrain(states, SIZE))


@pytest.mark.parametrize("gap", [1.0, 10.0])
@pytest.mark.parametrize("occlusion_policy", ["keep_tracking", "coast"])
def test_an_unstable_motion_model_is_no_error(couple, gap, occlusion_policy):
    """With the coefficients printed in the paper, an offset grows by 10^9 in a second."""
    values = {
        "motion.model": "second_order_autoregressive",
        "motion.first_coefficient": 2.5,
        "motion.second_coefficient": -0.5,
        "cues": ("color_histogram", "gradient_orientation"),
        "track.wrong_box_cost": 0.0,
        "track.occlusion_policy": occlusion_policy,
    }
    tracker = Tracker.from_preset("zhang_bo", parameters=values)
    tracker.start(couple.images[0], couple.first[0])
    for number in range(12):
        tracker.update(couple.images[0], gap if number == 4 else 0.04)
        assert np.isfinite(tracker.estimate.box).all()
        assert np.isfinite(tracker.estimate.covariance).all()
