"""Second-order autoregressive motion: the box goes on from its last two."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.filter.limits import limited_centers, limited_sizes

if TYPE_CHECKING:
    from pf_tracker_ros.filter.motion import Box, MotionParameters

# So many steps at once are an age; more would only overflow where the coefficients diverge.
_MOST_STEPS = 200.0


class SecondOrderAutoregressive:
    """State (x, y, width, height) now and one model step ago, pixels.

    X_k - X_0 = A1 (X_{k-1} - X_0) + A2 (X_{k-2} - X_0) + v_k, X_0 the first box. As one step of
    the pair (X_k, X_{k-1}) that is a matrix M = [[A1, A2], [1, 0]]; a time of t steps takes its
    power M^t, which is the equation itself for t = 1, and makes two half steps one whole one. The
    noise is a random walk: its variance grows with the time, and it is given in box sizes.

    The roots of z^2 = A1 z + A2 say what becomes of an offset from X_0: it grows without end if one
    is above 1, stays where it is if one is 1, and fades if all are below.

    Source: Zhang et al. 2015, section 3.1 and equation (7).

    Args:
        box: (x, y, width, height) of the target in the first frame, pixels.
        parameters: Coefficients, step, noise and prior.
    """

    columns: tuple[str, ...] = (
        *("x", "y", "width", "height"),
        *("earlier_x", "earlier_y", "earlier_width", "earlier_height"),
    )

    def __init__(self, box: Box, parameters: MotionParameters) -> None:
        x, y, width, height = box
        self._reference = np.array([x + width / 2, y + height / 2, width, height])
        self._parameters = parameters

    def prior(self, count: int, generator: np.random.Generator) -> NDArray[np.float64]:
        """See `MotionModel.prior`; all sizes are that of the first box."""
        box_size = np.sqrt(self._reference[2:].prod())
        position, velocity = generator.standard_normal((2, count, 2)) * box_size
        states = np.tile(self._reference, (count, 2))
        states[:, :2] += position * self._parameters.prior_position
        states[:, 4:6] = states[:, :2]
        states[:, 4:6] -= velocity * self._parameters.prior_velocity * self._parameters.model_step
        return states

    def predict(
        self, states: NDArray[np.float64], interval: float, generator: np.random.Generator
    ) -> NDArray[np.float64]:
        """See `MotionModel.predict`; source: Zhang et al. 2015, equation (7)."""
        parameters = self._parameters
        steps = min(interval / parameters.model_step, _MOST_STEPS)
        transition = transition_power(
            parameters.first_coefficient, parameters.second_coefficient, steps
        )
        offsets = states.reshape(-1, 2, 4) - self._reference
        predicted = transition @ offsets + self._reference

        noise = generator.standard_normal((len(states), 4)) * np.sqrt(interval)
        sizes = states[:, 2:4]
        predicted[:, 0, :2] += (
            parameters.position_noise * np.sqrt(sizes.prod(axis=1, keepdims=True)) * noise[:, :2]
        )
        size, aspect = parameters.size_noise * noise[:, 2], parameters.aspect_noise * noise[:, 3]
        predicted[:, 0, 2:] += sizes * np.stack([size + aspect / 2, size - aspect / 2], axis=1)
        return predicted.reshape(-1, 8)

    def constrained(
        self, states: NDArray[np.float64], image_size: tuple[int, int]
    ) -> NDArray[np.float64]:
        """See `MotionModel.constrained`; the earlier box too, or it would pull out of the image."""
        boxes = states.reshape(-1, 4)
        return np.hstack(
            [
                limited_centers(boxes[:, :2], image_size),
                limited_sizes(boxes[:, 2:], self._reference[2:], image_size),
            ]
        ).reshape(-1, 8)

    def boxes(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `MotionModel.boxes`."""
        return np.hstack([states[:, :2] - states[:, 2:4] / 2, states[:, 2:4]])

    def foresight(self) -> None:
        """See `MotionModel.foresight`; the particles carry the box before themselves."""
        return None


def transition_power(
    first_coefficient: float, second_coefficient: float, steps: float
) -> NDArray[np.float64]:
    """(2, 2) power M^steps of M = [[first, second], [1, 0]], for any number of steps from 0 up.

    By the roots a, b of z^2 = first z + second: M^t = a^t 1 + (b^t - a^t) / (b - a) (M - a 1).
    A negative root has no real power of part of a step; its real part is taken, which is right for
    whole steps.
    """
    if steps == 0.0:
        return np.eye(2)
    transition = np.array([[first_coefficient, second_coefficient], [1.0, 0.0]])
    spread = np.sqrt(complex(first_coefficient**2 / 4.0 + second_coefficient))
    one, other = first_coefficient / 2.0 + spread, first_coefficient / 2.0 - spread
    slope = (
        (other**steps - one**steps) / (other - one)
        if abs(other - one) > 1e-6
        else steps * (first_coefficient / 2.0 + 0j) ** (steps - 1.0)
    )
    return (one**steps * np.eye(2) + slope * (transition - one * np.eye(2))).real
