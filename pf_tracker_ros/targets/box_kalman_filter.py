"""Kalman filter of a target's box.

The particle filter finds the target in the current image. This filter keeps its motion and its
growth across noisy detections and occlusions. Its four axes are independent: the center along x and
y, in pixels, and the logarithms of the height and of the aspect ratio (width over height). With p
and v the position and velocity along one axis and T the interval:

1. Predict: p += b v, v *= a; P = F P F' + Q, with F = [[1, b], [0, a]].
   - Center, nearly constant velocity: a = 1, b = T, Q = q [[T^3/3, T^2/2], [T^2/2, T]] for a white
     acceleration noise of the intensity q.
   - Height: a target that comes nearer grows by a share per second. This rate has the variance s^2
     among the targets of the scene, and changes within a time constant u: a = exp(-T/u),
     b = u (1 - a), Q = s^2 [[2 u T - u^2 (3 - 4 a + a^2), u (1 - a)^2], [u (1 - a)^2, 1 - a^2]].
   - Aspect ratio: a random walk; v = 0.
2. Correct by a measurement z of variance r: (p, v) += K (z - p), P -= K (P_pp, P_pv), with
   K = (P_pp, P_pv) / (P_pp + r). The innovation z - p is limited to three standard deviations.
3. Camera motion compensation: center and velocity are mapped by the similarity between the two
   images. The size stays, since the target is not at the distance of the background.

Sources: Bar-Shalom, Li and Kirubarajan 2001, "Estimation with Applications to Tracking and
Navigation", 6.2.2 and 8.2.3; Aharon, Orfaig and Bobrovsky 2022, "BoT-SORT".
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

CENTER_STD = np.array([0.15, 0.1])
"""(2,) standard deviation of a detection's center, in widths and heights of its box."""
IMAGE_CENTER_STD = np.array([0.3, 0.2])
"""(2,) that of a center measured in the image."""
# Those of the logarithms of its height and aspect ratio.
_LOG_SIZE_STD = np.array([0.1, 0.2])
# Standard deviation of the logarithm of a height measured in the image.
_IMAGE_LOG_HEIGHT_STD = 0.15
# Seconds within which errors of the height correlate: people bend, and detectors repeat errors.
_CORRELATION_TIME = 0.1
# Square root of the acceleration noise's intensity along x and y: change of velocity per second, in
# heights. On the ground, targets move across the image more than up and down.
_ACCELERATION = np.array([0.3, 0.1])
# Standard deviation of the velocity of a new target along x and y, heights per second.
_INITIAL_VELOCITY_STD = np.array([0.6, 0.3])
GROWTH_VARIANCE = 0.12**2
"""Prior of the variance of the rate of growth, 1/s^2."""
# Time constant of the rate of growth, seconds.
_GROWTH_TIME = 10.0
# Standard deviation of the random walk of the aspect ratio's logarithm in one second.
_ASPECT_NOISE = 0.2
# Seconds without a frame up to which the velocity counts.
_MAX_STEP = 2.0
# Seconds after which the uncertainty of the position grows no further.
_MAX_PAUSE = 10.0
# Largest innovation, standard deviations.
_MAX_DEVIATIONS = 3.0


class BoxKalmanFilter(NamedTuple):
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
    def initiate(
        cls, box: NDArray[np.float64], growth_variance: float = GROWTH_VARIANCE
    ) -> BoxKalmanFilter:
        """The filter of a new target in a (4,) box, pixels, which is most likely at rest.

        The variance of the rate of growth is in 1/s^2.
        """
        std = np.concatenate([CENTER_STD * box[2:], _LOG_SIZE_STD])
        velocity_variance = np.concatenate(
            [np.square(_INITIAL_VELOCITY_STD * box[3]), [growth_variance, 0.0]]
        )
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

    def predict(
        self, interval: float, height: float, growth_variance: float = GROWTH_VARIANCE
    ) -> BoxKalmanFilter:
        """The filter of a target of a height in pixels, after an interval.

        After a pause of more than two seconds the target may have stopped. Its predicted box is
        then the last one, and the velocity adds to the variance, for up to ten seconds. The
        variance of the rate of growth is in 1/s^2.
        """
        if interval > _MAX_STEP:
            variance = self.velocity_variance + np.square(self.velocity)
            at_rest = self._replace(velocity=np.zeros(4), velocity_variance=variance)
            return at_rest._step(min(interval, _MAX_PAUSE), height, growth_variance)
        return self._step(interval, height, growth_variance)

    def _step(self, interval: float, height: float, growth_variance: float) -> BoxKalmanFilter:
        decay = math.exp(-interval / _GROWTH_TIME)
        rest = _GROWTH_TIME * (1.0 - decay)
        growth = growth_variance * np.array(
            [
                2.0 * _GROWTH_TIME * interval - _GROWTH_TIME**2 * (3.0 - 4.0 * decay + decay**2),
                (1.0 - decay) * rest,
                1.0 - decay**2,
            ]
        )
        # Rows: of the position, its covariance with the velocity, the velocity.
        noises = np.zeros((3, 4))
        noises[:, :2] = np.square(_ACCELERATION * height) * interval
        noises[:2, :2] *= np.array([[interval**2 / 3.0], [interval / 2.0]])
        noises[:, 2] = growth
        noises[0, 3] = _ASPECT_NOISE**2 * interval
        step = np.array([interval, interval, rest, 0.0])
        factor = np.array([1.0, 1.0, decay, 0.0])
        return BoxKalmanFilter(
            self.mean + step * self.velocity,
            factor * self.velocity,
            self.variance
            + 2.0 * step * self.covariance
            + step**2 * self.velocity_variance
            + noises[0],
            factor * (self.covariance + step * self.velocity_variance) + noises[1],
            factor**2 * self.velocity_variance + noises[2],
        )

    def correct(self, box: NDArray[np.float64], interval: float = math.inf) -> BoxKalmanFilter:
        """The filter after a (4,) detection, pixels, `interval` seconds after the last one.

        Detections in quick succession repeat errors.
        """
        std = np.concatenate([CENTER_STD * box[2:], _LOG_SIZE_STD])
        std[2] *= math.sqrt(1.0 + 2.0 * _CORRELATION_TIME / max(interval, 1e-3))
        return self._correct(_position(box), std)

    def correct_center(
        self, center: NDArray[np.float64], std: NDArray[np.float64]
    ) -> BoxKalmanFilter:
        """The filter after a measured (2,) center with (2,) standard deviations, pixels."""
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
        """The filter with another (2,) width and height, measured in the image.

        The image sees how a size changes better than the size itself, which a detection corrects.
        """
        variance = self.variance.copy()
        variance[2] = max(variance[2], _IMAGE_LOG_HEIGHT_STD**2)
        mean = np.concatenate([self.center, _log_size(size)])
        return self._replace(mean=mean, variance=variance)

    def compensate_camera_motion(self, camera_motion: NDArray[np.float64]) -> BoxKalmanFilter:
        """The filter after the camera has moved by a (3, 3) similarity, see `EgoMotion.update`."""
        linear, shift = camera_motion[:2, :2], camera_motion[:2, 2]
        mean, velocity = self.mean.copy(), self.velocity.copy()
        mean[:2] = linear @ self.center + shift
        velocity[:2] = linear @ self.velocity[:2]
        return self._replace(mean=mean, velocity=velocity)

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


def _position(box: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4,) position of a (4,) box along the axes of the filter."""
    return np.concatenate([box[:2] + box[2:] / 2, _log_size(box[2:])])


def _log_size(size: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2,) logarithms of the height and of the aspect ratio."""
    return np.log([size[1], size[0] / size[1]])
