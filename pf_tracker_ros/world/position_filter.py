"""Position and velocity on the ground over time: a Kalman filter with constant velocity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class FilteredPosition:
    """Position and velocity of a target on the ground, filtered over time.

    Attributes:
        stamp: Nanoseconds.
        position: (2,) x and y in the fixed frame, meters.
        velocity: (2,) meters per second.
        covariance: (4, 4) of x, y and their velocities.
    """

    stamp: int
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    covariance: NDArray[np.float64]


class PositionFilter:
    """A filter of one target.

    Args:
        acceleration_density: Spectral density of the white-noise acceleration, m^2/s^3.
        correlation_time: Time in seconds after which the errors of measurements have a correlation
            of 1/e.
        gate: Largest normalized innovation squared of a measurement.
        reset_after: Number of consecutive measurements outside the gate after which the filter
            starts anew.
    """

    def __init__(
        self,
        acceleration_density: float = 0.3,
        correlation_time: float = 0.15,
        gate: float = 13.8,
        reset_after: int = 5,
    ) -> None:
        self.normalized_innovation: float | None = None  # of the last measurement, squared
        self.rejected = 0  # consecutive measurements outside the gate

    def update(self, stamp: int, position: ArrayLike, covariance: ArrayLike) -> bool:
        """Take a measurement.

        Args:
            stamp: Of the image, nanoseconds. One that is not later than the last is ignored.
            position: (2,) or (3,) in the fixed frame, meters; z is ignored.
            covariance: (2, 2) or (3, 3), m^2.

        Returns:
            Whether it was used: it was inside the gate, and not late.
        """
        raise NotImplementedError

    def predict(self, stamp: int) -> FilteredPosition | None:
        """Position and velocity at a stamp, from the last one on; None before a measurement."""
        raise NotImplementedError

    def reset(self) -> None:
        """Forget the target."""
        raise NotImplementedError
