"""A Kalman filter whose prediction is a proposal for the particles of the next frame.

The Kalman filter's belief may have columns that a particle lacks, such as a velocity. In a frame

1. `predict` moves the belief: x_k = A x_{k-1} + B u + w;
2. `propose` draws a share of the particles around the predicted mean (see `proposals`);
3. the particles are weighted by the image;
4. `correct` takes their mean as the measurement z, their covariance as its noise.

Source: Zhang Bo, section 3.3.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.filter.gaussian import Gaussian
from pf_tracker_ros.filter.proposals import ProposedStates, Transition, propose_from_prediction

# Smallest standard deviation, in pixels or log scale, so that every Gaussian has a density.
SMALLEST_STD = 1e-3


class LinearStep(NamedTuple):
    """x_k = A x_{k-1} + B u + w, with independent axes of w.

    Attributes:
        matrix: A, (K, K).
        control: B u, (K,).
        std: Standard deviations of w, (K,).
    """

    matrix: NDArray[np.float64]
    control: NDArray[np.float64]
    std: NDArray[np.float64]


class LinearizableMotion(Protocol):
    """A motion model with a linear step for a Kalman filter.

    The belief has K columns. The first D are those of a particle's state, and the particles'
    estimate measures the first `measured_columns`.
    """

    columns: tuple[str, ...]
    measured_columns: int

    def linear_step(self, interval: float) -> LinearStep:
        """The Kalman filter's state transition over an interval in seconds."""

    def transition(self, interval: float, belief: NDArray[np.float64] | None = None) -> Transition:
        """The particles' transition prior over an interval, given the belief's (K,) mean."""


@dataclass(frozen=True)
class KalmanFilter:
    """The Kalman filter of a target; every operation returns a new one.

    Attributes:
        belief: Density of the K columns of the motion's linear step.
        motion: Motion model of the belief and of the particles.
    """

    belief: Gaussian
    motion: LinearizableMotion

    def propose(
        self,
        states: NDArray[np.float64],
        interval: float,
        share: float,
        generator: np.random.Generator,
    ) -> ProposedStates:
        """Draw particles around this prediction; see `propose_from_prediction`."""
        transition = self.motion.transition(interval, self.belief.mean)
        return propose_from_prediction(states, transition, self.state, share, generator)

    @property
    def state(self) -> Gaussian:
        """Density of the D columns of a particle's state."""
        return self.belief.marginal(np.arange(len(self.belief.mean)) < len(self.motion.columns))

    def predict(self, interval: float) -> KalmanFilter:
        """The belief `interval` seconds later."""
        matrix, control, std = self.motion.linear_step(interval)
        noise = np.diag(std**2 + SMALLEST_STD**2)
        mean = matrix @ self.belief.mean + control
        return replace(self, belief=self.belief.predict(matrix, noise, mean))

    def correct(self, mean: NDArray[np.float64], covariance: NDArray[np.float64]) -> KalmanFilter:
        """The belief after a measurement: the particles' (D,) mean and (D, D) covariance."""
        count = self.motion.measured_columns
        observation = np.eye(count, len(self.belief.mean))
        noise = covariance[:count, :count] + np.diag(np.full(count, SMALLEST_STD**2))
        return replace(self, belief=self.belief.correct(mean[:count], observation, noise))
