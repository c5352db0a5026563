"""How the robot follows: by the pose, by the bearing, by a prediction, else it searches."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from follow_parts.robot import Pose2D

# Distance to keep, meters.
DISTANCE = 2.0
_SPEED_GAIN, _TURN_GAIN = 1.2, 2.0
# Seconds for which the last pose or bearing counts, and after which the robot searches.
_HOLD, _SEARCH_AFTER = 0.3, 2.0
_SEARCH_TURN = 0.7
# Seconds for which a velocity is still true.
_PREDICTED = 1.5
# Headings that are tried where the way is blocked, radians from the wanted one; that far ahead,
# meters, it has to be free.
_DETOURS, _FREE = (0.0, 0.15, -0.15, 0.3, -0.3, 0.45, -0.45), 1.2


@dataclass(frozen=True)
class Perceived:
    """What the tracker and the localizer publish of an image."""

    time: float  # of the image, seconds
    # of the pose in the odometry's frame, meters; None while there is none
    position: tuple[float, float] | None
    velocity: tuple[float, float]  # of it, m/s
    # of the bearing in the odometry's frame, radians; None while there is none
    heading: float | None


class FollowController:
    """Keeps a distance to a person."""

    def __init__(self) -> None:
        self._posed: Perceived | None = None
        self._heading: tuple[float, float] | None = None
        self._known_at = 0.0
        self._side = 1.0

    def take(self, perceived: Perceived) -> None:
        """Take what was perceived."""
        if perceived.position is not None:
            self._posed = perceived
        if perceived.heading is not None:
            self._heading = perceived.time, perceived.heading

    def command(
        self, time: float, base: Pose2D, is_free: Callable[[float, float], bool]
    ) -> tuple[float, float]:
        """Speed in m/s and turn in rad/s.

        A laser scanner says whether the way is free at an angle to the left, radians, for so many
        meters. The base is the robot's by its odometry.
        """
        speed = 0.0
        if self._posed and time - self._posed.time <= _HOLD:
            angle, distance = self._toward(0.0, base)
            speed = _SPEED_GAIN * (distance - DISTANCE) * max(math.cos(angle), 0.0)
            if speed > 0.0:
                ahead = min(distance - 1.0, _FREE)
                ways = (angle + detour for detour in _DETOURS)
                angle = next((way for way in ways if is_free(way, ahead)), angle)
            self._known_at = time
        elif self._heading and time - self._heading[0] <= _HOLD:
            angle = _wrapped(self._heading[1] - base.yaw)
            self._known_at = time
        elif time - self._known_at > _SEARCH_AFTER:
            return 0.0, self._side * _SEARCH_TURN
        elif self._posed:
            angle, _ = self._toward(min(time - self._posed.time, _PREDICTED), base)
        else:
            return 0.0, 0.0
        self._side = 1.0 if angle >= 0.0 else -1.0
        return speed, _TURN_GAIN * angle

    def _toward(self, seconds: float, base: Pose2D) -> tuple[float, float]:
        """Angle and distance to where the last pose is after some seconds."""
        if not self._posed or not self._posed.position:
            return 0.0, 0.0
        (x, y), (vx, vy) = self._posed.position, self._posed.velocity
        x, y = x + seconds * vx - base.x, y + seconds * vy - base.y
        return _wrapped(math.atan2(y, x) - base.yaw), math.hypot(x, y)


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
