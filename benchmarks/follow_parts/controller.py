"""How the robot follows: distance by the pose, heading by the pose or the bearing, else a search."""

from __future__ import annotations

import math
from dataclasses import dataclass

from follow_parts.robot import Pose2D

# Distance to keep, meters.
DISTANCE = 2.0
_SPEED_GAIN, _TURN_GAIN = 1.2, 2.0
# Seconds for which the last pose or bearing counts, and after which the robot searches.
_HOLD, _SEARCH_AFTER = 0.3, 2.0
_SEARCH_TURN = 0.5


@dataclass(frozen=True)
class Perceived:
    """What the tracker and the localizer publish of an image.

    Attributes:
        time: Of the image, seconds.
        position: Of the pose in the odometry's frame, meters; None while there is none.
        heading: Direction of the bearing in the odometry's frame, radians; None while there is none.
    """

    time: float
    position: tuple[float, float] | None
    heading: float | None


class FollowController:
    """Keeps a distance to a person."""

    def __init__(self) -> None:
        self._position: tuple[float, tuple[float, float]] | None = None
        self._heading: tuple[float, float] | None = None
        self._known_at = 0.0
        self._side = 1.0

    def take(self, perceived: Perceived) -> None:
        """Take what was perceived."""
        if perceived.position is not None:
            self._position = perceived.time, perceived.position
        if perceived.heading is not None:
            self._heading = perceived.time, perceived.heading

    def command(self, time: float, base: Pose2D) -> tuple[float, float]:
        """Speed in m/s and turn in rad/s.

        Args:
            time: Seconds.
            base: The robot by its odometry.
        """
        if self._position and time - self._position[0] <= _HOLD:
            x, y = self._position[1]
            angle = _wrapped(math.atan2(y - base.y, x - base.x) - base.yaw)
            distance = math.hypot(x - base.x, y - base.y)
            speed = _SPEED_GAIN * (distance - DISTANCE) * max(math.cos(angle), 0.0)
        elif self._heading and time - self._heading[0] <= _HOLD:
            angle, speed = _wrapped(self._heading[1] - base.yaw), 0.0
        elif time - self._known_at > _SEARCH_AFTER:
            return 0.0, self._side * _SEARCH_TURN
        else:
            return 0.0, 0.0
        self._known_at, self._side = time, 1.0 if angle >= 0.0 else -1.0
        return speed, _TURN_GAIN * angle


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
