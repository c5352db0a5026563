"""Position and velocity of a target on the ground over time.

A Kalman filter with the state (x, y, velocity x, velocity y) in a fixed frame:

1. Predict: constant velocity with white-noise acceleration of spectral density q. Over an
   interval t that adds q t^3 / 3 to the variance of a position, q t to that of a velocity, and
   q t^2 / 2 to their covariance.
2. Gate: an innovation v with the covariance S is rejected where v^T S^-1 v is above the gate.
   After some time of rejections only, the filter starts anew: the target is elsewhere.
3. Correct with the measurement's covariance times (1 + r) / (1 - r), r = exp(-t / correlation
   time). Errors of boxes are correlated in time. The mean of a long series with a correlation r
   from one to the next has that many times the variance that it had without; a filter that takes
   the errors for white becomes overconfident, the more so the higher the rate.

Sources: Bar-Shalom, Li and Kirubarajan 2001, "Estimation with Applications to Tracking and
Navigation", sections 6.2 and 5.4; Bartlett 1946, for the variance of a mean of correlated values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.filter.gaussian import Gaussian

# Asymmetry of a covariance that is rounding, over its largest number.
_ROUNDING = 1e-6
# Standard deviation of the velocity of a new target, meters per second: people walk at 1.4.
_FIRST_SPEED_SD = 1.2


@dataclass(frozen=True, eq=False)
class FilteredPosition:
    """Position and velocity of a target on the ground, filtered over time.

    Attributes:
        stamp: Nanoseconds.
        position: (2,) x and y in the fixed frame, meters.
        velocity: (2,) meters per second.
        covariance: (4, 4) of x, y and their velocities.

    Example:
        >>> import numpy as np
        >>> from pf_tracker_ros.world import PositionFilter
        >>> positions = PositionFilter()
        >>> positions.update(1_000_000_000, (5.0, 0.0), 0.01 * np.eye(2))
        True
        >>> filtered = positions.predict(1_000_000_000)
        >>> filtered.position.round(2).tolist(), filtered.covariance.shape
        ([5.0, 0.0], (4, 4))
    """

    stamp: int
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    covariance: NDArray[np.float64]


class PositionFilter:
    """A filter of one target; `update` for each measurement, `predict` for the result.

    Attributes:
        normalized_innovation: Of the last measurement, squared, with two degrees of freedom; None
            before the second.
        rejected_since: Stamp of the first of the rejected measurements since the last accepted one;
            None without.

    Args:
        acceleration_density: Spectral density of the white-noise acceleration, m^2/s^3.
        correlation_time: Time in seconds after which the errors of measurements have a correlation
            of 1/e; 0 where they are independent.
        gate: Largest normalized innovation squared of a measurement, of two degrees of freedom: a
            target's own exceed 13.8 once in a thousand times.
        reset_after: Time in seconds without an accepted measurement after which a rejected one
            starts the filter anew.

    Raises:
        ValueError: A number is not finite or out of its range.

    Example:
        A target that walks along x at 1 m/s, measured ten times a second:

        >>> import numpy as np
        >>> from pf_tracker_ros.world import PositionFilter
        >>> positions = PositionFilter(correlation_time=0.0)
        >>> for step in range(50):
        ...     stamp = 1_000_000_000 + step * 100_000_000
        ...     accepted = positions.update(stamp, (5.0 + 0.1 * step, 0.0), 0.01 * np.eye(2))
        >>> filtered = positions.predict(stamp)
        >>> accepted, filtered.velocity.round(1).tolist()
        (True, [1.0, 0.0])
    """

    def __init__(
        self,
        acceleration_density: float = 0.15,
        correlation_time: float = 0.15,
        gate: float = 13.8,
        reset_after: float = 1.0,
    ) -> None:
        numbers = {
            "acceleration_density": acceleration_density,
            "correlation_time": correlation_time,
            "gate": gate,
            "reset_after": reset_after,
        }
        for name, number in numbers.items():
            if not 0.0 <= number < math.inf:
                raise ValueError(f"{name} is {number!r}; allowed: a finite number from 0 up")
        self._density, self._correlation_time = acceleration_density, correlation_time
        self._gate, self._reset_after = gate, reset_after
        self.reset()

    def reset(self) -> None:
        """Forget the target."""
        self.normalized_innovation: float | None = None
        self.rejected_since: int | None = None
        self._stamp: int | None = None
        self._state: Gaussian | None = None

    def update(self, stamp: int, position: ArrayLike, covariance: ArrayLike) -> bool:
        """Take a measurement.

        Args:
            stamp: Of the image, nanoseconds. A measurement that is not later than the last accepted
                one is ignored.
            position: (2,) or (3,) in the fixed frame, meters; z is ignored.
            covariance: (2, 2) or (3, 3), m^2.

        Returns:
            Whether the measurement was used: it is neither late nor outside the gate.

        Raises:
            ValueError: A number is not finite, or the covariance not symmetric and positive
                definite.
        """
        place, noise = _horizontal(position, covariance)
        if self._state is None or self._stamp is None:
            self._start(stamp, place, noise)
            return True
        if stamp <= self._stamp:
            return False
        interval = (stamp - self._stamp) * 1e-9
        predicted = self._predicted(interval)
        noise = noise * self._inflation(interval)
        innovation = place - predicted.mean[:2]
        squared = float(
            innovation @ np.linalg.solve(predicted.covariance[:2, :2] + noise, innovation)
        )
        self.normalized_innovation = squared
        if squared <= self._gate:
            self._state = predicted.correct(place, _OBSERVED, noise)
            self._stamp, self.rejected_since = stamp, None
            return True
        if interval >= self._reset_after:
            self._start(stamp, place, noise)
            return True
        if self.rejected_since is None:
            self.rejected_since = stamp
        return False

    def predict(self, stamp: int) -> FilteredPosition | None:
        """Position and velocity at a stamp; at the last measurement's for an earlier one.

        Returns:
            None before the first measurement.
        """
        if self._state is None or self._stamp is None:
            return None
        stamp = max(stamp, self._stamp)
        state = self._predicted((stamp - self._stamp) * 1e-9)
        return FilteredPosition(stamp, state.mean[:2], state.mean[2:], state.covariance)

    def _start(self, stamp: int, place: NDArray[np.float64], noise: NDArray[np.float64]) -> None:
        covariance = np.diag(np.full(4, _FIRST_SPEED_SD**2))
        covariance[:2, :2] = noise
        self._state = Gaussian(np.array([*place, 0.0, 0.0]), covariance)
        self._stamp, self.rejected_since = stamp, None

    def _predicted(self, interval: float) -> Gaussian:
        if self._state is None:
            raise RuntimeError("no measurement yet")
        matrix = np.eye(4)
        matrix[0, 2] = matrix[1, 3] = interval
        one_axis = [[interval**3 / 3.0, interval**2 / 2.0], [interval**2 / 2.0, interval]]
        noise = self._density * np.kron(one_axis, np.eye(2))
        return self._state.predict(matrix, noise)

    def _inflation(self, interval: float) -> float:
        """Variance of a measurement in place of one that is correlated with those before."""
        if self._correlation_time == 0.0:
            return 1.0
        return 1.0 / math.tanh(interval / (2.0 * self._correlation_time))


def _horizontal(
    position: ArrayLike, covariance: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(2,) position and (2, 2) covariance along x and y."""
    place = np.asarray(position, dtype=np.float64)
    noise = np.asarray(covariance, dtype=np.float64)
    if place.shape not in ((2,), (3,)) or noise.shape != (len(place), len(place)):
        raise ValueError(
            f"position has shape {place.shape} and covariance {noise.shape}; expected (2,) "
            "and (2, 2), or (3,) and (3, 3)"
        )
    place, noise = place[:2], noise[:2, :2]
    if not (np.isfinite(place).all() and np.isfinite(noise).all()):
        raise ValueError("position and covariance must be finite")
    is_symmetric = abs(noise[0, 1] - noise[1, 0]) <= _ROUNDING * np.abs(noise).max()
    noise = (noise + noise.T) / 2.0
    if not is_symmetric or noise[0, 0] <= 0.0 or np.linalg.det(noise) <= 0.0:
        raise ValueError("the covariance of the position must be symmetric and positive definite")
    return place, noise


_OBSERVED = np.eye(2, 4)
