"""A Kalman filter on the target's motion: where the particles will be wanted in the next frame.

Source: Zhang Bo, section 3.3.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.filter.gaussian import Gaussian
from pf_tracker_ros.filter.proposals import ProposedStates, Transition, propose_from_prediction

# Pixels and parts of a scale so small that a Gaussian with them still has a density.
SMALLEST_STD = 1e-3


class LinearStep(NamedTuple):
    """x_k = A x_{k-1} + B u + w, w with independent axes.

    Attributes:
        matrix: (B, B) A.
        control: (B,) B u.
        std: (B,) standard deviations of w.
    """

    matrix: NDArray[np.float64]
    control: NDArray[np.float64]
    std: NDArray[np.float64]


class LinearizableMotion(Protocol):
    """A motion model that a Kalman filter can follow.

    The filter's belief has B columns, the first of which are the D of a particle's state; the
    particles' estimate measures the first `measured_columns` of them.
    """

    columns: tuple[str, ...]
    measured_columns: int

    def linear_step(self, interval: float) -> LinearStep:
        """The Kalman filter's state transition over an interval in seconds."""

    def transition(self, interval: float, belief: NDArray[np.float64] | None = None) -> Transition:
        """The particles' transition prior over an interval, given the (B,) mean of the belief."""


@dataclass(frozen=True)
class KalmanFilter:
    """The Kalman filter on a target; every operation returns another.

    Attributes:
        belief: Over the B columns of the motion's linear step.
        motion: How the belief and the particles go on.
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
        """Particles drawn around this prediction; arguments as of `propose_from_prediction`."""
        transition = self.motion.transition(interval, self.belief.mean)
        return propose_from_prediction(states, transition, self.state, share, generator)

    @property
    def state(self) -> Gaussian:
        """The D columns of a particle's state."""
        return self.belief.marginal(np.arange(len(self.belief.mean)) < len(self.motion.columns))

    def predict(self, interval: float) -> KalmanFilter:
        """The belief `interval` seconds later."""
        matrix, control, std = self.motion.linear_step(interval)
        noise = np.diag(std**2 + SMALLEST_STD**2)
        mean = matrix @ self.belief.mean + control
        return replace(self, belief=self.belief.predict(matrix, noise, mean))

    def correct(self, mean: NDArray[np.float64], covariance: NDArray[np.float64]) -> KalmanFilter:
        """The belief after the particles' (D,) mean, taken as a measurement with their spread."""
        count = self.motion.measured_columns
        observation = np.eye(count, len(self.belief.mean))
        error = covariance[:count, :count] + np.diag(np.full(count, SMALLEST_STD**2))
        return replace(self, belief=self.belief.correct(mean[:count], observation, error))
