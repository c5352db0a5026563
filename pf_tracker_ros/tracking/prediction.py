"""Where the particles of the next frame are drawn."""

from __future__ import annotations

from dataclasses import replace
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


class Prediction(NamedTuple):
    """The particles before the frame is looked at.

    Attributes:
        particles: Drawn for this frame, their weights corrected for where that was.
        interval: Seconds since the last frame, as far as a prediction reaches.
        kalman_filter: The Kalman filter's prediction, None where none is asked for.
    """

    particles: ParticleSet
    interval: float
    kalman_filter: KalmanFilter | None = None


class Predictor:
    """Draws every particle from the motion model, the transition prior."""

    def predict(
        self,
        target: FilterState,
        interval: float,
        image_size: tuple[int, int],
        draw: np.random.Generator,
    ) -> Prediction:
        """The particles of the next frame.

        Args:
            target: After the last frame.
            interval: Seconds since then.
            image_size: (width, height), pixels.
            draw: Source of randomness.

        Source: Li et al. 2007, equation (3); Zhang et al. 2015, equation (7).
        """
        motion, interval = target.motion, min(interval, LONGEST_PREDICTION)
        states = motion.predict(target.particles.states, interval, draw)
        particles = target.particles.move(motion.constrain(states, image_size))
        return Prediction(particles, interval)


class KalmanPredictor(Predictor):
    """Draws a share of the particles around a Kalman filter's prediction.

    Args:
        parameters: The share.
    """

    def __init__(self, parameters: ProposalParameters) -> None:
        self._share = parameters.share

    def predict(
        self,
        target: FilterState,
        interval: float,
        image_size: tuple[int, int],
        draw: np.random.Generator,
    ) -> Prediction:
        """See `Predictor.predict`; the weights carry p / q.

        Source: Zhang Bo, section 3.3.
        """
        if target.kalman_filter is None:
            return super().predict(target, interval, image_size, draw)
        interval = min(interval, LONGEST_PREDICTION)
        # Out of sight, nothing corrects the filter, and its prediction is no better than the prior.
        share = self._share if target.status.state == "tracking" else 0.0
        before = target.particles.states
        try:
            kalman_filter = target.kalman_filter.predict(interval)
            proposed = kalman_filter.propose(before, interval, share, draw)
        except DegenerateError:
            kalman_filter = _begun_anew(target)
            proposed = kalman_filter.propose(before, interval, 0.0, draw)
        states = target.motion.constrain(proposed.states, image_size)
        particles = target.particles.move(states).reweight(proposed.log_ratio)
        return Prediction(particles, interval, kalman_filter)


def _begun_anew(target: FilterState) -> KalmanFilter:
    """The Kalman filter of a target as it begins, where the particles are."""
    begun = cast(KalmanFilteredMotion, target.motion).kalman_filter()
    mean = begun.belief.mean.copy()
    mean[: len(target.particles.mean)] = target.particles.mean
    return replace(begun, belief=replace(begun.belief, mean=mean))
