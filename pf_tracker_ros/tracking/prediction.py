"""Prediction step: the particles of the next frame, before its pixels are read.

The particles are drawn from a proposal q, and the weights carry p / q, where p is the transition
prior p(x_t | x_{t-1}) of the motion model:

- `Predictor`: q = p, so the weights stay. Li et al. 2007, equation (3); Zhang et al. 2015,
  equation (7).
- `KalmanPredictor`: q is a mixture of p and a Kalman filter's predicted Gaussian. Zhang Bo, section
  3.3.

Proposals that read the image are drawn later, by `SearchingMeasurer`.
"""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np

from pf_tracker_ros.filter import (
    LONGEST_PREDICTION,
    DegenerateError,
    KalmanFilter,
    KalmanFilteredMotion,
    ParticleSet,
    ProposalParameters,
)
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.values import replace


class Prediction(NamedTuple):
    """Particles with weights times p / q, after an interval of at most `LONGEST_PREDICTION`.

    The Kalman filter is None with another proposal.
    """

    particles: ParticleSet
    interval: float
    kalman_filter: KalmanFilter | None = None


class Predictor:
    """Draws every particle from the motion model, the transition prior."""

    def predict(
        self,
        state: FilterState,
        interval: float,
        image_size: tuple[int, int],
        generator: np.random.Generator,
    ) -> Prediction:
        """The particles of the next frame.

        Source: Li et al. 2007, equation (3); Zhang et al. 2015, equation (7).
        """
        motion, interval = state.motion, min(interval, LONGEST_PREDICTION)
        states = motion.predict(state.particles.states, interval, generator)
        particles = state.particles.move(motion.constrain(states, image_size))
        return Prediction(particles, interval)


class KalmanPredictor(Predictor):
    """Draws a share of the particles from a Kalman filter's prediction."""

    def __init__(self, parameters: ProposalParameters) -> None:
        self._share = parameters.share

    def predict(
        self,
        state: FilterState,
        interval: float,
        image_size: tuple[int, int],
        generator: np.random.Generator,
    ) -> Prediction:
        """See `Predictor.predict`.

        Source: Zhang Bo, section 3.3.
        """
        if state.kalman_filter is None:
            return super().predict(state, interval, image_size, generator)
        interval = min(interval, LONGEST_PREDICTION)
        # Out of sight, nothing corrects the Kalman filter; it predicts no better than the prior.
        share = self._share if state.status.state == "tracking" else 0.0
        before = state.particles.states
        try:
            kalman_filter = state.kalman_filter.predict(interval)
            proposed = kalman_filter.propose(before, interval, share, generator)
        except DegenerateError:
            kalman_filter = _reinitialized(state)
            proposed = kalman_filter.propose(before, interval, 0.0, generator)
        states = state.motion.constrain(proposed.states, image_size)
        particles = state.particles.move(states).reweight(proposed.log_ratio)
        return Prediction(particles, interval, kalman_filter)


def _reinitialized(state: FilterState) -> KalmanFilter:
    """The initial Kalman filter, with its mean at the particles' mean."""
    initial = cast(KalmanFilteredMotion, state.motion).kalman_filter()
    mean = initial.belief.mean.copy()
    mean[: len(state.particles.mean)] = state.particles.mean
    return replace(initial, belief=replace(initial.belief, mean=mean))
