"""Kalman filter of a target's box, with a nearly constant velocity and rate of growth.

The particle filter finds the target in the current image. This filter keeps its motion and its
growth across noisy detections and occlusions. Four independent axes: the center along x and y, in
pixels, and the logarithms of the height and of the aspect ratio (width over height). A target that
comes nearer grows by a nearly constant share per second, at which its logarithm has a velocity; the
aspect ratio has none. With p and v the position and velocity along one axis, T the interval, q the
intensity of the white acceleration noise, s that of a random walk, z a measurement and r its
variance:

1. Predict: p += T v; P = F P F' + q [[T^3/3, T^2/2], [T^2/2, T]] + s [[T, 0], [0, 0]], with
   F = [[1, T], [0, 1]].
2. Correct: (p, v) += K (z - p), with K = (P_pp, P_pv) / (P_pp + r); P -= K (P_pp, P_pv).
   The innovation z - p is limited to three standard deviations.
3. Camera motion compensation: center and velocity are mapped by the similarity between the two
   images. The size stays, since the target is not at the distance of the background.

Sources: Bar-Shalom, Li and Kirubarajan 2001, "Estimation with Applications to Tracking and
Navigation", 6.2.2; Aharon, Orfaig and Bobrovsky 2022, "BoT-SORT".
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

CENTER_STD = np.array([0.15, 0.1])
"""(2,) standard deviation of a detection's center, in widths and heights of its box."""
# Those of the logarithms of its height and aspect ratio.
_LOG_SIZE_STD = np.array([0.1, 0.2])
# Square root of the acceleration noise's intensity: change of velocity per second, in heights
# along x and y, and for the logarithms of the size.
_ACCELERATION = np.array([0.2, 0.2, 0.05, 0.0])
# Standard deviation of the velocity of a new target, in the same units per second.
_INITIAL_VELOCITY_STD = np.array([0.3, 0.3, 0.08, 0.0])
# Standard deviation of the random walk in one second: people bend and turn.
_RANDOM_WALK_STD = np.array([0.0, 0.0, 0.02, 0.2])
# Seconds without a frame up to which the velocity counts.
_MAX_STEP = 2.0
# Seconds after which the uncertainty of the position grows no further.
_MAX_PAUSE = 10.0
# Largest innovation, standard deviations.
_MAX_DEVIATIONS = 3.0


@dataclass(frozen=True, eq=False)
class BoxKalmanFilter:
    """State of the filter; a value.

    Axes: center x and y, pixels; logarithms of the height in pixels and of width over height.

    Attributes:
        mean: (4,) position along each axis.
        velocity: (4,) per second.
        variance: (4,) of the position.
        covariance: (4,) of position and velocity.
        velocity_variance: (4,) of the velocity.
    """

    mean: NDArray[np.float64]
    velocity: NDArray[np.float64]
    variance: NDArray[np.float64]
    covariance: NDArray[np.float64]
    velocity_variance: NDArray[np.float64]

    @classmethod
    def initiate(cls, box: NDArray[np.float64]) -> BoxKalmanFilter:
        """The filter of a new target in a (4,) box, which is most likely at rest."""
        std = np.concatenate([CENTER_STD * box[2:], _LOG_SIZE_STD])
        velocity_variance = np.square(_INITIAL_VELOCITY_STD * _units(box[3]))
        return cls(_position(box), np.zeros(4), np.square(std), np.zeros(4), velocity_variance)

    @property
    def center(self) -> NDArray[np.float64]:
        """(2,) pixels."""
        return self.mean[:2]

    @property
    def center_variance(self) -> NDArray[np.float64]:
        """(2,) px^2."""
        return self.variance[:2]

    @property
    def size(self) -> NDArray[np.float64]:
        """(2,) width and height, pixels."""
        height = np.exp(self.mean[2])
        return np.array([height * np.exp(self.mean[3]), height])

    def predict(self, interval: float, height: float) -> BoxKalmanFilter:
        """The filter after an interval in seconds, for a target of a height in pixels.

        After a pause of more than two seconds the target may have stopped. Its predicted box is
        then the last one, and the velocity adds to the variance, for up to ten seconds.
        """
        if interval > _MAX_STEP:
            variance = self.velocity_variance + np.square(self.velocity)
            at_rest = replace(self, velocity=np.zeros(4), velocity_variance=variance)
            return at_rest._step(min(interval, _MAX_PAUSE), height)
        return self._step(interval, height)

    def _step(self, interval: float, height: float) -> BoxKalmanFilter:
        noise = np.square(_ACCELERATION * _units(height)) * interval
        return replace(
            self,
            mean=self.mean + interval * self.velocity,
            variance=self.variance
            + 2.0 * interval * self.covariance
            + interval**2 * self.velocity_variance
            + noise * interval**2 / 3.0
            + np.square(_RANDOM_WALK_STD) * interval,
            covariance=self.covariance + interval * self.velocity_variance + noise * interval / 2.0,
            velocity_variance=self.velocity_variance + noise,
        )

    def correct(self, box: NDArray[np.float64]) -> BoxKalmanFilter:
        """The filter after a detection in a (4,) box."""
        std = np.concatenate([CENTER_STD * box[2:], _LOG_SIZE_STD])
        return self._correct(_position(box), std)

    def correct_center(
        self, center: NDArray[np.float64], std: NDArray[np.float64]
    ) -> BoxKalmanFilter:
        """The filter after a measurement of the center alone.

        Args:
            center: (2,) pixels.
            std: (2,) standard deviation of the measurement, pixels.
        """
        measured = np.concatenate([center, self.mean[2:]])
        return self._correct(measured, np.concatenate([std, [np.inf, np.inf]]))

    def _correct(self, measured: NDArray[np.float64], std: NDArray[np.float64]) -> BoxKalmanFilter:
        variance = self.variance + np.square(std)
        largest = _MAX_DEVIATIONS * np.sqrt(variance)
        innovation = np.clip(measured - self.mean, -largest, largest)
        gain = self.variance / variance
        velocity_gain = self.covariance / variance
        return BoxKalmanFilter(
            self.mean + gain * innovation,
            self.velocity + velocity_gain * innovation,
            (1.0 - gain) * self.variance,
            (1.0 - gain) * self.covariance,
            self.velocity_variance - velocity_gain * self.covariance,
        )

    def with_size(self, size: NDArray[np.float64]) -> BoxKalmanFilter:
        """The filter with another (2,) width and height, measured in the image."""
        return replace(self, mean=np.concatenate([self.center, _log_size(size)]))

    def compensate_camera_motion(self, camera_motion: NDArray[np.float64]) -> BoxKalmanFilter:
        """The filter in the image of a camera that has moved; see `EgoMotion.update`.

        Args:
            camera_motion: (3, 3) similarity.
        """
        linear, shift = camera_motion[:2, :2], camera_motion[:2, 2]
        mean, velocity = self.mean.copy(), self.velocity.copy()
        mean[:2] = linear @ self.center + shift
        velocity[:2] = linear @ self.velocity[:2]
        return replace(self, mean=mean, velocity=velocity)

    def scale(self, factors: NDArray[np.float64]) -> BoxKalmanFilter:
        """The filter in an image of another size, by (2,) factors of its width and height."""
        factors, shift = np.concatenate([factors, [1.0, 1.0]]), _log_size(factors)
        squares = np.square(factors)
        return BoxKalmanFilter(
            self.mean * factors + np.concatenate([[0.0, 0.0], shift]),
            self.velocity * factors,
            self.variance * squares,
            self.covariance * squares,
            self.velocity_variance * squares,
        )


def _units(height: float) -> NDArray[np.float64]:
    """(4,) units of the noise: the height of the target along x and y, pixels."""
    return np.array([height, height, 1.0, 1.0])


def _position(box: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4,) position of a (4,) box along the axes of the filter."""
    return np.concatenate([box[:2] + box[2:] / 2, _log_size(box[2:])])


def _log_size(size: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2,) logarithms of the height and of the aspect ratio."""
    return np.log([size[1], size[0] / size[1]])
