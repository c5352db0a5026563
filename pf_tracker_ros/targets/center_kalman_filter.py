"""Kalman filter of a target's center, with a nearly constant velocity.

The particle filter finds the target in the current image. This filter keeps its motion across noisy
detections and occlusions. With p and v the position and velocity along one axis, T the interval,
q the intensity of the white acceleration noise, z a measured center and r its variance:

1. Predict: p += T v; P = F P F' + q [[T^3/3, T^2/2], [T^2/2, T]], with F = [[1, T], [0, 1]].
2. Correct: (p, v) += K (z - p), with K = (P_pp, P_pv) / (P_pp + r); P -= K (P_pp, P_pv).
   The innovation z - p is limited to three standard deviations.
3. Camera motion compensation: p and v are mapped by the similarity between the two images.

Sources: Bar-Shalom, Li and Kirubarajan 2001, "Estimation with Applications to Tracking and
Navigation", 6.2.2; Aharon, Orfaig and Bobrovsky 2022, "BoT-SORT".
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

# Square root of the acceleration noise's intensity, box heights: the change of velocity per second.
_ACCELERATION = 0.2
# Standard deviation of a new target's velocity, heights per second.
_INITIAL_VELOCITY_STD = 0.3
# Seconds without a frame up to which the velocity counts.
_MAX_STEP = 2.0
# Seconds after which the uncertainty of the position grows no further.
_MAX_PAUSE = 10.0
# Largest innovation, standard deviations.
_MAX_DEVIATIONS = 3.0


@dataclass(frozen=True, eq=False)
class CenterKalmanFilter:
    """State of the filter, with independent axes; a value.

    Attributes:
        center: (2,) of the box, pixels.
        velocity: (2,) pixels per second.
        center_variance: (2,) px^2.
        center_velocity_covariance: (2,) px^2/s.
        velocity_variance: (2,) px^2/s^2.
    """

    center: NDArray[np.float64]
    velocity: NDArray[np.float64]
    center_variance: NDArray[np.float64]
    center_velocity_covariance: NDArray[np.float64]
    velocity_variance: NDArray[np.float64]

    @classmethod
    def initiate(cls, box: NDArray[np.float64], std: NDArray[np.float64]) -> CenterKalmanFilter:
        """The filter of a new target, which is most likely at rest.

        Args:
            box: (4,) of the target, pixels.
            std: (2,) standard deviation of its center, pixels.
        """
        velocity_variance = np.full(2, np.square(_INITIAL_VELOCITY_STD * box[3]))
        center = box[:2] + box[2:] / 2
        return cls(center, np.zeros(2), np.square(std), np.zeros(2), velocity_variance)

    def predict(self, interval: float, height: float) -> CenterKalmanFilter:
        """The filter after an interval in seconds, for a target of a height in pixels.

        After a pause of more than two seconds the target may have stopped. Its predicted center is
        then the last one, and the velocity adds to the variance, for up to ten seconds.
        """
        if interval > _MAX_STEP:
            variance = self.velocity_variance + np.square(self.velocity)
            at_rest = replace(self, velocity=np.zeros(2), velocity_variance=variance)
            return at_rest._step(min(interval, _MAX_PAUSE), height)
        return self._step(interval, height)

    def _step(self, interval: float, height: float) -> CenterKalmanFilter:
        noise = np.square(_ACCELERATION * height) * interval
        return replace(
            self,
            center=self.center + interval * self.velocity,
            center_variance=self.center_variance
            + 2.0 * interval * self.center_velocity_covariance
            + interval**2 * self.velocity_variance
            + noise * interval**2 / 3.0,
            center_velocity_covariance=self.center_velocity_covariance
            + interval * self.velocity_variance
            + noise * interval / 2.0,
            velocity_variance=self.velocity_variance + noise,
        )

    def correct(self, center: NDArray[np.float64], std: NDArray[np.float64]) -> CenterKalmanFilter:
        """The filter after a measurement of the center.

        Args:
            center: (2,) pixels.
            std: (2,) standard deviation of the measurement, pixels.
        """
        variance = self.center_variance + np.square(std)
        largest = _MAX_DEVIATIONS * np.sqrt(variance)
        innovation = np.clip(center - self.center, -largest, largest)
        gain = self.center_variance / variance
        velocity_gain = self.center_velocity_covariance / variance
        return CenterKalmanFilter(
            self.center + gain * innovation,
            self.velocity + velocity_gain * innovation,
            (1.0 - gain) * self.center_variance,
            (1.0 - gain) * self.center_velocity_covariance,
            self.velocity_variance - velocity_gain * self.center_velocity_covariance,
        )

    def compensate_camera_motion(self, camera_motion: NDArray[np.float64]) -> CenterKalmanFilter:
        """The filter in the image of a camera that has moved; see `EgoMotion.update`.

        Args:
            camera_motion: (3, 3) similarity.
        """
        linear, shift = camera_motion[:2, :2], camera_motion[:2, 2]
        center, velocity = linear @ self.center + shift, linear @ self.velocity
        return replace(self, center=center, velocity=velocity)

    def scale(self, factors: NDArray[np.float64]) -> CenterKalmanFilter:
        """The filter in an image of another size, by (2,) factors of its width and height."""
        squares = np.square(factors)
        return CenterKalmanFilter(
            self.center * factors,
            self.velocity * factors,
            self.center_variance * squares,
            self.center_velocity_covariance * squares,
            self.velocity_variance * squares,
        )
