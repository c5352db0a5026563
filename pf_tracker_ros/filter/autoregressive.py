"""Second-order autoregressive motion: the next box is predicted from the last two.

1. X_k - X_0 = A1 (X_{k-1} - X_0) + A2 (X_{k-2} - X_0) + v_k, where X_0 is the first box.
2. One step of the pair (X_k, X_{k-1}) is the matrix M = [[A1, A2], [1, 0]]. An interval of t steps
   is the matrix power M^t. For t = 1 this is the equation above. Two half steps equal one step
   unless a root is negative.
3. The roots of z^2 = A1 z + A2 determine how an offset from X_0 develops. With a root of modulus
   above 1 it grows without bound, with all below 1 it decays. At 1 it stays, or grows steadily if
   both roots are 1.
4. The noise v is a random walk, of the center in box sizes and of each side relative to that side;
   its variance grows in proportion to the interval.

Source: Zhang et al. 2015, section 3.1 and equation (7).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.filter.gaussian import Gaussian
from pf_tracker_ros.filter.kalman_filter import SMALLEST_STD, KalmanFilter, LinearStep
from pf_tracker_ros.filter.motion import (
    MODEL_STEP,
    MOTION_MODELS,
    PRIOR_POSITION_STD,
    PRIOR_VELOCITY_STD,
    declared_aspect_noise,
    declared_position_noise,
    declared_size_noise,
    limit_centers,
    limit_sizes,
    model_steps,
)
from pf_tracker_ros.filter.proposals import Transition
from pf_tracker_ros.parameters import declared

# With both coefficients below this, one step leaves nothing of an offset.
_NEGLIGIBLE_COEFFICIENT = 1e-3


@dataclass(frozen=True)
class SecondOrderAutoregressiveParameters:
    """Second-order autoregressive motion."""

    position_noise: float = declared_position_noise()
    size_noise: float = declared_size_noise()
    aspect_noise: float = declared_aspect_noise()
    first_coefficient: float = declared(
        1.5,
        "Weight of the last offset from the first box (A1).",
        minimum=-3.0,
        maximum=3.0,
    )
    second_coefficient: float = declared(
        -0.5,
        "Weight of the offset before that (A2).",
        minimum=-3.0,
        maximum=3.0,
    )


@dataclass(frozen=True)
class _Autoregression:
    """The transition prior, with independent noise on every axis."""

    power: NDArray[np.float64]
    reference: NDArray[np.float64]
    position_noise: float
    side_noise: float

    def mean(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        offsets = states.reshape(-1, 2, 4) - self.reference
        return (self.power @ offsets + self.reference).reshape(-1, 8)

    def std(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        std = np.zeros((len(states), 8))
        std[:, :2] = self.position_noise * np.sqrt(states[:, 2:4].prod(axis=1, keepdims=True))
        std[:, 2:4] = self.side_noise * states[:, 2:4]
        std[:, :4] = np.maximum(std[:, :4], SMALLEST_STD)
        return std


@MOTION_MODELS.register("second_order_autoregressive", SecondOrderAutoregressiveParameters)
class SecondOrderAutoregressive:
    """State (center x, center y, width, height) now and one model step ago, pixels.

    Args:
        box: (x, y, width, height) of the target in the first frame, pixels.
        parameters: Coefficients and noise.
    """

    columns: tuple[str, ...] = (
        *("x", "y", "width", "height"),
        *("earlier_x", "earlier_y", "earlier_width", "earlier_height"),
    )

    measured_columns: int = 4

    def __init__(self, box: Box, parameters: SecondOrderAutoregressiveParameters) -> None:
        x, y, width, height = box
        self._reference = np.array([x + width / 2, y + height / 2, width, height])
        self._parameters = parameters

    def sample_prior(self, count: int, generator: np.random.Generator) -> NDArray[np.float64]:
        """See `MotionModel.sample_prior`; all have the size of the first box."""
        box_size = np.sqrt(self._reference[2:].prod())
        position, velocity = generator.standard_normal((2, count, 2)) * box_size
        states = np.tile(self._reference, (count, 2))
        states[:, :2] += position * PRIOR_POSITION_STD
        states[:, 4:6] = states[:, :2]
        states[:, 4:6] -= velocity * PRIOR_VELOCITY_STD * MODEL_STEP
        return states

    def predict(
        self, states: NDArray[np.float64], interval: float, generator: np.random.Generator
    ) -> NDArray[np.float64]:
        """See `MotionModel.predict`; source: Zhang et al. 2015, equation (7)."""
        parameters = self._parameters
        offsets = states.reshape(-1, 2, 4) - self._reference
        predicted = self._power(interval) @ offsets + self._reference

        noise = generator.standard_normal((len(states), 4)) * np.sqrt(interval)
        sizes = states[:, 2:4]
        predicted[:, 0, :2] += (
            parameters.position_noise * np.sqrt(sizes.prod(axis=1, keepdims=True)) * noise[:, :2]
        )
        size, aspect = parameters.size_noise * noise[:, 2], parameters.aspect_noise * noise[:, 3]
        predicted[:, 0, 2:] += sizes * np.stack([size + aspect / 2, size - aspect / 2], axis=1)
        return predicted.reshape(-1, 8)

    def constrain(
        self, states: NDArray[np.float64], image_size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """See `MotionModel.constrain`; the earlier box is also limited."""
        boxes = states.reshape(-1, 4)
        return np.hstack(
            [
                limit_centers(boxes[:, :2], image_size),
                limit_sizes(boxes[:, 2:], self._reference[2:], image_size),
            ]
        ).reshape(-1, 8)

    def boxes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `MotionModel.boxes`."""
        return np.hstack([states[:, :2] - states[:, 2:4] / 2, states[:, 2:4]])

    def transition(self, interval: float, belief: NDArray[np.float64] | None = None) -> Transition:
        """See `LinearizableMotion.transition`; the belief is unused.

        Unlike in `predict`, width and height have independent noise, which `Transition` requires.
        """
        root = np.sqrt(interval)
        side = np.hypot(self._parameters.size_noise, self._parameters.aspect_noise / 2.0)
        return _Autoregression(
            self._power(interval),
            self._reference,
            root * self._parameters.position_noise,
            root * side,
        )

    def linear_step(self, interval: float) -> LinearStep:
        """See `LinearizableMotion.linear_step`."""
        matrix: NDArray[np.float64] = np.zeros((8, 8))
        matrix.reshape(2, 4, 2, 4)[:, range(4), :, range(4)] = self._power(interval)
        reference = np.tile(self._reference, 2)
        std = self.transition(interval).std(reference[None])[0]
        return LinearStep(matrix, reference - matrix @ reference, std)

    def kalman_filter(self) -> KalmanFilter:
        """See `KalmanFilteredMotion.kalman_filter`."""
        width, height = self._reference[2:]
        velocity = PRIOR_VELOCITY_STD * np.sqrt(width * height)
        earlier = max(velocity * MODEL_STEP, 1.0)
        std = np.array([1.0, 1.0, 0.01 * width, 0.01 * height])
        std = np.concatenate([std, [earlier, earlier], std[2:]])
        return KalmanFilter(Gaussian(np.tile(self._reference, 2), np.diag(std**2)), self)

    def _power(self, interval: float) -> NDArray[np.float64]:
        """(2, 2) matrix M^t of an interval in seconds."""
        first, second = self._parameters.first_coefficient, self._parameters.second_coefficient
        return transition_power(first, second, model_steps(interval))


def transition_power(
    first_coefficient: float, second_coefficient: float, steps: float
) -> NDArray[np.float64]:
    """(2, 2) power M^steps of M = [[first, second], [1, 0]], for any real steps >= 0.

    With the roots a, b of z^2 = first z + second: M^t = a^t I + (b^t - a^t) / (b - a) (M - a I).
    The power of a negative root is complex unless the steps are whole; its real part is used. If
    both roots are almost 0, a part of a step is interpolated between I and M.
    """
    if steps == 0.0:
        return np.eye(2)
    transition = np.array([[first_coefficient, second_coefficient], [1.0, 0.0]])
    largest = max(abs(first_coefficient), abs(second_coefficient))
    if steps < 1.0 and largest < _NEGLIGIBLE_COEFFICIENT:
        return (1.0 - steps) * np.eye(2) + steps * transition
    half_distance = np.sqrt(complex(first_coefficient**2 / 4.0 + second_coefficient))
    a, b = first_coefficient / 2.0 + half_distance, first_coefficient / 2.0 - half_distance
    slope = (
        (b**steps - a**steps) / (b - a)
        if abs(b - a) > 1e-6
        else steps * (first_coefficient / 2.0 + 0j) ** (steps - 1.0)
    )
    return (a**steps * np.eye(2) + slope * (transition - a * np.eye(2))).real
