"""Where a target goes: the place and velocity of its center, and how sure they are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

# How much a velocity changes in a second, box heights a second: people walk on.
_ACCELERATION = 0.2
# Standard deviation of a new target's velocity, heights a second.
_FIRST_SPEED = 0.3
# Seconds without a frame up to which a target is taken to have gone on as it went.
_LONGEST_STEP = 2.0
# Seconds after which a target is not expected still farther away: it may also have stood still.
_LONGEST_PAUSE = 10.0
# What is measured farther from the prediction than so many standard deviations moves it no more
# than that.
_MOST_DEVIATIONS = 3.0


@dataclass(frozen=True, eq=False)
class CenterKalmanFilter:
    """A Kalman filter of nearly constant velocity, both axes on their own; a value.

    Particles tell where a target is in the image at hand. This remembers how it has moved, over
    detections that jitter and while others hide it.

    Attributes:
        center: (2,) of the box, pixels.
        velocity: (2,) pixels per second.
        center_variance: (2,) variance of the center, px^2.
        center_velocity_covariance: (2,) covariance of center and velocity, px^2/s.
        velocity_variance: (2,) variance of the velocity, px^2/s^2.
    """

    center: NDArray[np.float64]
    velocity: NDArray[np.float64]
    center_variance: NDArray[np.float64]
    center_velocity_covariance: NDArray[np.float64]
    velocity_variance: NDArray[np.float64]

    @classmethod
    def initiate(
        cls, box: NDArray[np.float64], deviation: NDArray[np.float64]
    ) -> CenterKalmanFilter:
        """That of a target at rest, in all likelihood.

        Args:
            box: (4,) of the target, pixels.
            deviation: (2,) standard deviation of its center, pixels.
        """
        speed = np.full(2, np.square(_FIRST_SPEED * box[3]))
        return cls(box[:2] + box[2:] / 2, np.zeros(2), np.square(deviation), np.zeros(2), speed)

    def predict(self, interval: float, height: float) -> CenterKalmanFilter:
        """The course some seconds later, for a target of a height in pixels.

        After a pause nobody knows whether it has gone on as it went: it is expected around where it
        was, the less surely the faster it went and the longer that was, up to ten seconds.
        """
        if interval > _LONGEST_STEP:
            stopped = self.velocity_variance + np.square(self.velocity)
            at_rest = replace(self, velocity=np.zeros(2), velocity_variance=stopped)
            return at_rest._step(min(interval, _LONGEST_PAUSE), height)
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

    def correct(
        self, center: NDArray[np.float64], deviation: NDArray[np.float64]
    ) -> CenterKalmanFilter:
        """The course after the center was measured.

        Args:
            center: (2,) pixels.
            deviation: (2,) standard deviation of it, pixels.
        """
        total = self.center_variance + np.square(deviation)
        farthest = _MOST_DEVIATIONS * np.sqrt(total)
        surprise = np.clip(center - self.center, -farthest, farthest)
        gain, speed_gain = self.center_variance / total, self.center_velocity_covariance / total
        return CenterKalmanFilter(
            self.center + gain * surprise,
            self.velocity + speed_gain * surprise,
            (1.0 - gain) * self.center_variance,
            (1.0 - gain) * self.center_velocity_covariance,
            self.velocity_variance - speed_gain * self.center_velocity_covariance,
        )

    def compensate_camera_motion(self, camera_motion: NDArray[np.float64]) -> CenterKalmanFilter:
        """The same course, seen by a camera that has moved; see `EgoMotion.follow`.

        Args:
            camera_motion: (3, 3) similarity.
        """
        linear, shift = camera_motion[:2, :2], camera_motion[:2, 2]
        center, velocity = linear @ self.center + shift, linear @ self.velocity
        return replace(self, center=center, velocity=velocity)

    def scale(self, factors: NDArray[np.float64]) -> CenterKalmanFilter:
        """The same course in an image of another size, by (2,) factors of its width and height."""
        squares = np.square(factors)
        return CenterKalmanFilter(
            self.center * factors,
            self.velocity * factors,
            self.center_variance * squares,
            self.center_velocity_covariance * squares,
            self.velocity_variance * squares,
        )
