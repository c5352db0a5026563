"""A Gaussian with the two steps of the Kalman filter.

1. Predict, x_k = A x_{k-1} + w, w ~ N(0, Q): mean A m, covariance P' = A P A^T + Q.
2. Correct, z = G x + v, v ~ N(0, R): gain K = P' G^T (G P' G^T + R)^-1, mean m + K (z - G m),
   covariance in Joseph's form (I - K G) P' (I - K G)^T + K R K^T, which rounding leaves symmetric
   and positive.

For a nonlinear model, pass its Jacobian as the matrix and its value as the mean: this is the
extended Kalman filter. With a gain of 0 for a part of the state, that part is considered and not
estimated, as after Schmidt 1966; Joseph's form holds for any gain.

Source: Zhang Bo, section 3.3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray


class DegenerateError(ValueError):
    """A mean or covariance is not finite or not positive definite, as after divergent motion."""


@dataclass(frozen=True, eq=False)
class Gaussian:
    """A normal distribution of a D-dimensional state; every operation returns a new one.

    Attributes:
        mean: (D,).
        covariance: (D, D), symmetric.

    Raises:
        ValueError: The shapes do not fit together.
        DegenerateError: A number is not finite.
    """

    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]

    def __post_init__(self) -> None:
        mean = np.array(self.mean, dtype=np.float64)
        covariance = np.array(self.covariance, dtype=np.float64)
        if mean.ndim != 1 or covariance.shape != (len(mean), len(mean)):
            raise ValueError(
                f"mean has shape {mean.shape} and covariance {covariance.shape}; "
                "expected (D,) and (D, D)"
            )
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
            raise DegenerateError("mean and covariance must be finite numbers")
        mean.setflags(write=False)
        covariance.setflags(write=False)
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "covariance", covariance)

    def predict(
        self,
        transition: ArrayLike,
        noise: ArrayLike,
        mean: ArrayLike | None = None,
    ) -> Gaussian:
        """Prediction step: the state after x_k = A x_{k-1} + w.

        Args:
            transition: (D, D) A, or the Jacobian of a nonlinear motion at `self.mean`.
            noise: (D, D) covariance of w.
            mean: (D,) predicted mean; None means A times `self.mean`.
        """
        matrix = np.asarray(transition, dtype=np.float64)
        predicted = matrix @ self.mean if mean is None else np.asarray(mean, dtype=np.float64)
        return Gaussian(predicted, matrix @ self.covariance @ matrix.T + np.asarray(noise))

    def correct(
        self,
        measurement: ArrayLike,
        observation: ArrayLike,
        noise: ArrayLike,
        expected: ArrayLike | None = None,
        *,
        considered: int = 0,
    ) -> Gaussian:
        """Correction step: the state given a measurement z = G x + v.

        Args:
            measurement: (M,) z.
            observation: (M, D) G, or the Jacobian of a nonlinear measurement at `self.mean`.
            noise: (M, M) covariance of v, positive definite.
            expected: (M,) expected measurement; None means G times `self.mean`.
            considered: Numbers at the end of the state that are not estimated.
        """
        matrix = np.asarray(observation, dtype=np.float64)
        error = np.asarray(noise, dtype=np.float64)
        predicted = matrix @ self.mean if expected is None else np.asarray(expected)
        cross = matrix @ self.covariance
        gain = np.linalg.solve(cross @ matrix.T + error, cross).T
        if considered:
            gain[-considered:] = 0.0
        left = np.eye(len(self.mean)) - gain @ matrix
        return Gaussian(
            self.mean + gain @ (np.asarray(measurement, dtype=np.float64) - predicted),
            left @ self.covariance @ left.T + gain @ error @ gain.T,
        )

    def observe(self, observation: ArrayLike, noise: ArrayLike) -> Gaussian:
        """The distribution of a measurement z = G x + v; arguments as of `correct`."""
        matrix = np.asarray(observation, dtype=np.float64)
        covariance = matrix @ self.covariance @ matrix.T + np.asarray(noise)
        return Gaussian(matrix @ self.mean, covariance)

    @classmethod
    def mixture(cls, parts: Sequence[Gaussian], weights: ArrayLike) -> Gaussian:
        """The Gaussian with the mean and the covariance of a mixture of some.

        Args:
            parts: K of the same dimension.
            weights: (K,) nonnegative, not all 0.
        """
        if len(parts) == 1:
            return parts[0]
        shares = np.asarray(weights, dtype=np.float64) / np.sum(weights)
        means = np.array([one.mean for one in parts])
        mean = shares @ means
        offsets = means - mean
        within = np.tensordot(shares, [one.covariance for one in parts], axes=1)
        return cls(mean, within + (shares[:, None] * offsets).T @ offsets)

    def marginal(self, columns: NDArray[np.bool_]) -> Gaussian:
        """The distribution of the columns selected by a (D,) mask."""
        return Gaussian(self.mean[columns], self.covariance[np.ix_(columns, columns)])

    def draw(self, count: int, generator: np.random.Generator) -> NDArray[np.float64]:
        """(count, D) independent states."""
        return self.mean + generator.standard_normal((count, len(self.mean))) @ self._root.T

    def log_density(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) log densities at (N, D) states."""
        offsets = (states - self.mean) @ self._whitener.T
        constant = np.log(np.diagonal(self._root)).sum() + 0.5 * len(self.mean) * _LOG_TWO_PI
        return -0.5 * np.square(offsets).sum(axis=1) - constant

    @cached_property
    def _root(self) -> NDArray[np.float64]:
        """(D, D) Cholesky factor of the covariance, lower triangular."""
        try:
            return np.asarray(np.linalg.cholesky(self.covariance), dtype=np.float64)
        except np.linalg.LinAlgError:
            raise DegenerateError(
                "covariance is not positive definite, as a density requires"
            ) from None

    @cached_property
    def _whitener(self) -> NDArray[np.float64]:
        return np.asarray(np.linalg.inv(self._root), dtype=np.float64)


_LOG_TWO_PI = math.log(2.0 * math.pi)
