"""A robot with two wheels, its odometry, and the tilt of its camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from follow_parts.rendering import CAMERA_PITCH

Array = NDArray[np.float64]

MAX_SPEED, MAX_TURN = 1.2, 1.5
# Accelerations, m/s^2 and rad/s^2.
_ACCELERATION, _TURN_ACCELERATION = 1.0, 3.0
# Odometry: relative error of distances and angles, and errors in a meter, radians.
_SCALE_SD, _TURN_SCALE_SD, _DRIFT_SD = 0.01, 0.01, math.radians(0.5)
# Error of the mounting, and wobble in motion, radians; frequency, rad/s.
_MOUNTING_SD, _WOBBLE, _WOBBLE_RATE = math.radians(0.4), math.radians(0.3), 9.0
# Distance that the robot keeps from obstacles, meters.
_KEPT = 0.5


@dataclass(frozen=True)
class Pose2D:
    """x, y in meters and yaw in radians."""

    x: float
    y: float
    yaw: float

    @property
    def position(self) -> Array:
        """(2,) meters."""
        return np.array([self.x, self.y])

    def moved(self, distance: float, turn: float) -> Pose2D:
        """The pose after a short arc."""
        middle = self.yaw + turn / 2.0
        return Pose2D(
            self.x + distance * math.cos(middle),
            self.y + distance * math.sin(middle),
            self.yaw + turn,
        )

    def inward(self, point: Array) -> Array:
        """(2,) point of the parent frame in this one."""
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        x, y = point[0] - self.x, point[1] - self.y
        return np.array([cosine * x + sine * y, -sine * x + cosine * y])

    def outward(self, point: Array) -> Array:
        """(2,) point of this frame in the parent one."""
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        return np.array(
            [
                self.x + cosine * point[0] - sine * point[1],
                self.y + sine * point[0] + cosine * point[1],
            ]
        )


class Robot:
    """A robot that drives: its pose in the room and by its wheels, speed, m/s, and turn, rad/s."""

    def __init__(self, pose: Pose2D, generator: np.random.Generator) -> None:
        self.pose, self.odometry = pose, Pose2D(0.0, 0.0, 0.0)
        self.speed = self.turn = 0.0
        self._generator = generator
        self._scale = 1.0 + generator.normal(0.0, _SCALE_SD)
        self._turn_scale = 1.0 + generator.normal(0.0, _TURN_SCALE_SD)
        self._bias = generator.normal(0.0, _DRIFT_SD / 2.0)
        self._pitch = CAMERA_PITCH + generator.normal(0.0, _MOUNTING_SD)
        self._roll = generator.normal(0.0, _MOUNTING_SD)
        self._wobble = 0.0

    def drive(
        self, interval: float, speed: float, turn: float, ranges: tuple[float, float]
    ) -> None:
        """Drive for a short time, as is wanted in m/s and rad/s.

        The ranges are free distances ahead and behind, meters.
        """
        ahead, behind = (max(one - _KEPT, 0.0) for one in ranges)
        speed = float(np.clip(speed, -min(0.4, 1.5 * behind), min(MAX_SPEED, 1.5 * ahead)))
        turn = float(np.clip(turn, -MAX_TURN, MAX_TURN))
        # Brakes are better than the motor.
        braking = 2.5 if abs(speed) < abs(self.speed) else 1.0
        change = braking * _ACCELERATION * interval
        self.speed += float(np.clip(speed - self.speed, -change, change))
        change = _TURN_ACCELERATION * interval
        self.turn += float(np.clip(turn - self.turn, -change, change))
        if (self.speed > 0.0 and ahead <= 0.0) or (self.speed < 0.0 and behind <= 0.0):
            self.speed = 0.0
        distance, angle = interval * self.speed, interval * self.turn
        self.pose = self.pose.moved(distance, angle)
        drift = self._bias * abs(distance)
        drift += self._generator.normal(0.0, _DRIFT_SD) * math.sqrt(abs(distance))
        self.odometry = self.odometry.moved(
            self._scale * distance, self._turn_scale * angle + drift
        )
        self._wobble += interval * _WOBBLE_RATE * abs(self.speed)

    @property
    def tilt(self) -> tuple[float, float]:
        """Pitch and roll of the camera, radians."""
        size = _WOBBLE * min(abs(self.speed), 1.0)
        return (
            self._pitch + size * math.sin(self._wobble),
            self._roll + 0.5 * size * math.sin(0.7 * self._wobble + 1.0),
        )
