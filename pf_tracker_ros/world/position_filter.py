"""Position and velocity of a target on the ground over time.

A Kalman filter with the state (x, y, velocity x, velocity y) in a fixed frame, and errors of the
measurements:

1. Predict: constant velocity with white-noise acceleration of spectral density q. Over an
   interval t that adds q t^3 / 3 to the variance of a position, q t to that of a velocity, and
   q t^2 / 2 to their covariance.
2. Gate: an innovation v with the covariance S is rejected where v^T S^-1 v is above the gate.
   After rejections alone for some time, the filter starts anew: the target is elsewhere.
3. Correct. Errors of boxes are correlated in time: a measurement z with the covariance R has
   z = position + R^1/2 (u_1 + ... + u_n) / n^1/2. Each u is a pair of normal variables with
   variance 1 and the correlation exp(-t / T) after an interval t, with a correlation time T of its
   own; with T = 0 it is white. A filter that takes all errors for white becomes overconfident of
   the position, as it averages errors that do not average out. One that estimates the errors takes
   the start of a walk for an error, and stays behind. So they are considered, after Schmidt: their
   correlation with the state is kept, and they are never estimated.

Of a target that may stand there are two such filters, interacting multiple models: one moves as
above, one stands. Before step 1, each starts from the mixture of both, by the chance that the
target has started or stopped meanwhile. Those who are slow stop soon: nobody walks at 0.1 m/s, but
slow errors look like it. The measurement's density under each gives their odds, and both together
are one normal distribution with the mean and the covariance of the mixture.

Sources: Bar-Shalom, Li and Kirubarajan 2001, "Estimation with Applications to Tracking and
Navigation", sections 6.2, 5.4 and 11.6.6, and chapter 8 for autocorrelated noise; Schmidt 1966,
"Application of State-Space Methods to Navigation Problems", for considered errors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.filter.gaussian import Gaussian

# Asymmetry of a covariance that is rounding, over its largest number.
_ROUNDING = 1e-6
# Largest number of the input, in its unit; squares and cubes of larger ones would overflow.
_LARGEST = 1e12
# Standard deviation of the velocity of a new target, meters per second: people walk at 1.4.
_FIRST_SPEED_SD = 1.2
# Least white share of a measurement's covariance: boxes are rounded, also at high rates.
_LEAST_WHITE = 0.02
# Speed below which a target stops soon, m/s, and how soon at least, seconds.
_SLOW, _STOPS_WITHIN = 0.2, 0.3
# Standard deviation of the velocity along each axis of who starts to walk, and of who stands, m/s.
_START_SD, _STANDING_SD = 0.7, 0.05
# Who stands sways: standard deviation of the place after a second, meters.
_SWAY_SD = 0.05
# Least probability that a target moves, and that it stands.
_LEAST_SHARE = 1e-6


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
        log_density: Logarithm of the density of that measurement given its prediction, 1/m^2; None
            before the second.
        rejected_since: Stamp of the first of the rejected measurements since the last accepted one;
            None without.

        has_restarted: Whether the filter has started anew with the last measurement.

    Args:
        acceleration_density: Spectral density of the white-noise acceleration, m^2/s^3.
        correlation_times: Times in seconds after which a part of the errors of measurements has a
            correlation of 1/e with itself, 0 where it is white; all parts have the same variance.
            (0.0,) is for independent errors.
        gate: Largest normalized innovation squared of a measurement, of two degrees of freedom: a
            target's own exceed 13.8 once in a thousand times.
        reset_after: Time in seconds of rejections alone after which the filter starts anew.
        stands_for: Time in seconds for which a target stands on average, before it moves again; 0
            for one that never does.

    Raises:
        ValueError: A number is not finite or out of its range.

    Example:
        A target that walks along x at 1 m/s, measured ten times a second:

        >>> import numpy as np
        >>> from pf_tracker_ros.world import PositionFilter
        >>> positions = PositionFilter(correlation_times=(0.0,))
        >>> for step in range(50):
        ...     stamp = 1_000_000_000 + step * 100_000_000
        ...     accepted = positions.update(stamp, (5.0 + 0.1 * step, 0.0), 0.01 * np.eye(2))
        >>> filtered = positions.predict(stamp)
        >>> accepted, filtered.velocity.round(1).tolist()
        (True, [1.0, 0.0])
    """

    def __init__(
        self,
        acceleration_density: float = 0.3,
        correlation_times: Sequence[float] = (0.1, 2.0),
        gate: float = 13.8,
        reset_after: float = 0.5,
        stands_for: float = 0.0,
    ) -> None:
        times = np.array(correlation_times, dtype=np.float64)
        if times.ndim != 1 or not times.size or not ((times >= 0.0) & (times <= _LARGEST)).all():
            raise ValueError(
                f"correlation_times is {correlation_times!r}; expected numbers from 0 to "
                f"{_LARGEST:g}, in seconds"
            )
        numbers = {
            "acceleration_density": acceleration_density,
            "gate": gate,
            "reset_after": reset_after,
            "stands_for": stands_for,
        }
        for name, number in numbers.items():
            if not 0.0 <= number <= _LARGEST:
                raise ValueError(f"{name} is {number!r}; allowed: a number from 0 to {_LARGEST:g}")
        self._density = acceleration_density
        # Of each number in the state that is an error.
        self._times = np.repeat(times[times > 0.0], 2)
        self._share = 1.0 / len(times)
        self._white = max(self._share * float((times == 0.0).sum()), _LEAST_WHITE)
        self._gate, self._reset_after, self._stands_for = gate, reset_after, stands_for
        self.reset()

    def reset(self) -> None:
        """Forget the target."""
        self.normalized_innovation: float | None = None
        self.log_density: float | None = None
        self.rejected_since: int | None = None
        self.has_restarted = False
        self._stamp: int | None = None
        self._models: _Models | None = None

    def interrupt(self) -> None:
        """Nothing is measured for a while: rejections before and after that are not of one run."""
        self.rejected_since = None

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
        if self._models is None or self._stamp is None:
            self._start(stamp, place, noise)
            return True
        if stamp <= self._stamp:
            return False
        models = self._predicted(self._models, (stamp - self._stamp) * 1e-9)
        observed, white = self._observed(noise), self._white * noise
        expected = models.merged.observe(observed, white)
        squared, self.log_density = _compared(expected, place)
        self.normalized_innovation, self.has_restarted = squared, False
        if squared <= self._gate:
            densities = [_compared(one.observe(observed, white), place)[1] for one in models.states]
            odds = models.shares * np.exp(np.subtract(densities, max(densities)))
            shares = np.maximum(odds / odds.sum(), _LEAST_SHARE)
            considered = len(self._times)
            self._models = _Models(
                tuple(
                    one.correct(place, observed, white, considered=considered)
                    for one in models.states
                ),
                shares / shares.sum(),
            )
            self._stamp, self.rejected_since = stamp, None
            return True
        if self.rejected_since is None:
            self.rejected_since = stamp
        if (stamp - self.rejected_since) * 1e-9 < self._reset_after:
            return False
        self._start(stamp, place, noise)
        self.has_restarted = True
        return True

    def predict(self, stamp: int) -> FilteredPosition | None:
        """Position and velocity at a stamp; at the last measurement's for an earlier one.

        Returns:
            None before the first measurement.
        """
        if self._models is None or self._stamp is None:
            return None
        stamp = max(stamp, self._stamp)
        state = self._predicted(self._models, (stamp - self._stamp) * 1e-9).merged
        return FilteredPosition(stamp, state.mean[:2], state.mean[2:4], state.covariance[:4, :4])

    def _start(self, stamp: int, place: NDArray[np.float64], noise: NDArray[np.float64]) -> None:
        mean = np.zeros(4 + len(self._times))
        mean[:2] = place
        covariance = np.eye(len(mean))
        covariance[:2, :2] = noise
        covariance[2:4, 2:4] *= _FIRST_SPEED_SD**2
        # The position is the measurement less its error.
        covariance[:2, 4:] = -self._observed(noise)[:, 4:]
        covariance[4:, :2] = covariance[:2, 4:].T
        states = [Gaussian(mean, covariance)]
        if self._stands_for:
            states.append(_at_rest(states[0], _STANDING_SD))
        self._models = _Models(tuple(states), np.full(len(states), 1.0 / len(states)))
        self._stamp, self.rejected_since = stamp, None

    def _predicted(self, models: _Models, interval: float) -> _Models:
        if not interval:
            return models
        (moving, *standing), shares = self._mixed(models, interval)
        diagonal = np.ones(4 + len(self._times))
        diagonal[4:] = np.exp(-interval / self._times)
        matrix, noise = np.diag(diagonal), np.diag(1.0 - diagonal**2)
        noise[[0, 1], [0, 1]] = _SWAY_SD**2 * interval
        stands = [one.predict(matrix, noise) for one in standing]
        matrix[0, 2] = matrix[1, 3] = interval
        noise[[0, 1], [0, 1]] = self._density * interval**3 / 3.0
        noise[[0, 1, 2, 3], [2, 3, 0, 1]] = self._density * interval**2 / 2.0
        noise[[2, 3], [2, 3]] = self._density * interval
        return _Models((moving.predict(matrix, noise), *stands), shares)

    def _mixed(self, models: _Models, interval: float) -> _Models:
        """The models after starts and stops within an interval."""
        if not self._stands_for:
            return models
        moving, standing = models.states
        velocity = moving.mean[2:4]
        slowness = math.exp(-0.5 * float(velocity @ velocity) / _SLOW**2)
        stops = -math.expm1(-interval * slowness / _STOPS_WITHIN)
        starts = -math.expm1(-interval / self._stands_for)
        # From a model, a row, to a model, a column.
        flows = models.shares[:, None] * [[1.0 - stops, stops], [starts, 1.0 - starts]]
        states = (
            Gaussian.mixture((moving, _at_rest(standing, _START_SD)), flows[:, 0]),
            Gaussian.mixture((_at_rest(moving, _STANDING_SD), standing), flows[:, 1]),
        )
        return _Models(states, flows.sum(axis=0))

    def _observed(self, noise: NDArray[np.float64]) -> NDArray[np.float64]:
        """(2, D) derivative of a measurement by the state."""
        # The symmetric root of a 2 x 2 matrix, by the theorem of Cayley and Hamilton.
        determinant = float(noise[0, 0] * noise[1, 1] - noise[0, 1] * noise[1, 0])
        root_of_determinant = math.sqrt(max(determinant, 0.0))
        root = noise + root_of_determinant * np.eye(2)
        root *= math.sqrt(self._share / (noise[0, 0] + noise[1, 1] + 2.0 * root_of_determinant))
        errors = np.tile(root, len(self._times) // 2)
        return np.hstack([_POSITION, errors])


class _Models(NamedTuple):
    """The states of a target if it moves and, where it may, if it stands; their probabilities."""

    states: tuple[Gaussian, ...]
    shares: NDArray[np.float64]

    @property
    def merged(self) -> Gaussian:
        """Both as one normal distribution."""
        return Gaussian.mixture(self.states, self.shares)


def _at_rest(state: Gaussian, sd: float) -> Gaussian:
    """A state with a velocity of 0 and its standard deviation, whatever it was."""
    mean, covariance = state.mean.copy(), state.covariance.copy()
    mean[2:4] = covariance[2:4] = covariance[:, 2:4] = 0.0
    covariance[[2, 3], [2, 3]] = sd**2
    return Gaussian(mean, covariance)


def _compared(expected: Gaussian, place: NDArray[np.float64]) -> tuple[float, float]:
    """Normalized squared innovation of a measurement, and its log density."""
    innovation = place - expected.mean
    squared = float(innovation @ np.linalg.solve(expected.covariance, innovation))
    size = float(np.linalg.slogdet(2.0 * math.pi * expected.covariance)[1])
    return squared, -0.5 * (squared + size)


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
    if np.abs(place).max() > _LARGEST or np.abs(noise).max() > _LARGEST**2:
        raise ValueError(
            f"position is {place.tolist()} and covariance {noise.tolist()}; allowed: up to "
            f"{_LARGEST:g} m and its square"
        )
    is_symmetric = abs(noise[0, 1] - noise[1, 0]) <= _ROUNDING * np.abs(noise).max()
    noise = (noise + noise.T) / 2.0
    if not is_symmetric or noise[0, 0] <= 0.0 or np.linalg.det(noise) <= 0.0:
        raise ValueError("the covariance of the position must be symmetric and positive definite")
    return place, noise


_POSITION = np.eye(2, 4)
