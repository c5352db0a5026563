"""Affine motion with Gaussian noise, and the Kalman filter that foresees it.

The particles follow the affine model; the Kalman filter keeps a velocity beside the state, which
the particles have not, so that its prediction runs ahead of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.filter.gaussian import Gaussian
from pf_tracker_ros.filter.limits import SMALLEST_SIDE
from pf_tracker_ros.filter.proposals import (
    Proposed,
    Transition,
    propose_from_prediction,
    propose_from_transition,
)

if TYPE_CHECKING:
    from pf_tracker_ros.filter.motion import Box, MotionParameters

# Pixels and parts of a scale so small that a Gaussian with them still has a density.
_SMALLEST_SPREAD = 1e-3


@dataclass(frozen=True)
class _Walk:
    """x_k = x_{k-1} + u."""

    deviation: NDArray[np.float64]

    def mean(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        return states.copy()

    def spread(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.deviation


class AffineMotion:
    """State (x, y, log_scale): the center in pixels, the logarithm of size over first size.

    x_k = a x_{k-1} + b + u with a = 1 and b = 0, the axes' noise independent.

    Source: Zhang Bo, equation (4).

    Args:
        box: (x, y, width, height) of the target in the first frame, pixels.
        parameters: Noise and prior.
    """

    columns: tuple[str, ...] = ("x", "y", "log_scale")

    def __init__(self, box: Box, parameters: MotionParameters) -> None:
        x, y, width, height = box
        self._first = np.array([x + width / 2, y + height / 2, 0.0])
        self._size = np.array([width, height])
        self._box_size = float(np.sqrt(width * height))
        self._parameters = parameters

    def prior(self, count: int, generator: np.random.Generator) -> NDArray[np.float64]:
        """See `MotionModel.prior`."""
        spread = self._parameters.prior_position * self._box_size
        return self._first + generator.standard_normal((count, 3)) * [spread, spread, 0.0]

    def transition(self, interval: float) -> Transition:
        """The transition prior over an interval in seconds."""
        position = self._parameters.position_noise * self._box_size
        noise = np.array([position, position, self._parameters.size_noise])
        return _Walk(np.maximum(np.sqrt(interval) * noise, _SMALLEST_SPREAD))

    def predict(
        self, states: NDArray[np.float64], interval: float, generator: np.random.Generator
    ) -> NDArray[np.float64]:
        """See `MotionModel.predict`; source: Zhang Bo, equation (4)."""
        return propose_from_transition(states, self.transition(interval), generator).states

    def constrained(
        self, states: NDArray[np.float64], image_size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """See `MotionModel.constrained`; sides stay between `SMALLEST_SIDE` and the image's."""
        smallest = min(1.0, float((SMALLEST_SIDE / self._size).max()))
        largest = max(1.0, float((image_size / self._size).min()))
        lower = [0.0, 0.0, np.log(smallest)]
        return np.clip(states, lower, [*image_size, np.log(largest)])

    def boxes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `MotionModel.boxes`."""
        sizes = np.exp(states[:, 2:]) * self._size
        return np.hstack([states[:, :2] - sizes / 2, sizes])

    def foresight(self) -> KalmanForesight:
        """The Kalman filter for the first frame: at the first box, at rest."""
        rest = self._parameters.prior_velocity * self._box_size
        spread = np.array([1.0, 1.0, 0.01, rest, rest, 0.1])
        agility = self._parameters.velocity_noise * self._box_size
        noise = np.array([0.0, 0.0, 0.0, agility, agility, self._parameters.size_noise])
        return KalmanForesight(
            belief=Gaussian(np.concatenate([self._first, np.zeros(3)]), np.diag(spread**2)),
            noise=noise,
            transition=self.transition,
        )


@dataclass(frozen=True)
class KalmanForesight:
    """A Kalman filter on (state, velocity) of D columns each; every operation returns another.

    Source: Zhang Bo, section 3.3, with constant velocity as the state transition A.

    Attributes:
        belief: Over 2 D columns, units per second for the velocities.
        noise: (2 D,) standard deviations of the process noise over one second.
        transition: The particles' transition prior over an interval in seconds.
    """

    belief: Gaussian
    noise: NDArray[np.float64]
    transition: Callable[[float], Transition]

    def proposed(
        self,
        states: NDArray[np.float64],
        interval: float,
        share: float,
        generator: np.random.Generator,
    ) -> Proposed:
        """Particles drawn around this prediction; arguments as of `propose_from_prediction`."""
        return propose_from_prediction(
            states, self.transition(interval), self.state, share, generator
        )

    @property
    def state(self) -> Gaussian:
        """The D columns of the state."""
        return self.belief.marginal(np.arange(len(self.noise)) < len(self.noise) // 2)

    def predicted(self, interval: float) -> KalmanForesight:
        """The belief `interval` seconds later."""
        count = len(self.noise) // 2
        transition = np.eye(2 * count)
        transition[:count, count:] = interval * np.eye(count)
        noise = np.diag(interval * self.noise**2 + _SMALLEST_SPREAD**2)
        return replace(self, belief=self.belief.predicted(transition, noise))

    def corrected(
        self, mean: NDArray[np.float64], covariance: NDArray[np.float64]
    ) -> KalmanForesight:
        """The belief after the particles' (D,) mean, taken as a measurement with their spread."""
        count = len(mean)
        observation = np.eye(count, 2 * count)
        error = covariance + np.diag(np.full(count, _SMALLEST_SPREAD**2))
        return replace(self, belief=self.belief.corrected(mean, observation, error))
