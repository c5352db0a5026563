"""How the robot follows: by the pose, by the bearing, by a prediction, else it searches."""

from __future__ import annotations

import math
from collections.abc import Callable

from follow_parts.chain import Report
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


class FollowController:
    """Keeps a distance to a person."""

    def __init__(self) -> None:
        # The last report with a pose, the last heading in the odometry's frame, and their times.
        self._posed: tuple[float, Report] | None = None
        self._heading: tuple[float, float] | None = None
        self._known_at = 0.0
        self._side = 1.0

    def take(self, time: float, base: Pose2D, report: Report) -> None:
        """Take what is published of an image of a time, where the robot was by its odometry."""
        if report.position is not None:
            self._posed = time, report
        if report.bearing is not None:
            self._heading = time, base.yaw + report.bearing

    def command(
        self, time: float, base: Pose2D, is_free: Callable[[float, float], bool]
    ) -> tuple[float, float]:
        """Speed in m/s and turn in rad/s.

        A laser scanner says whether the way is free at an angle to the left, radians, for so many
        meters. The base is the robot's by its odometry.
        """
        speed = 0.0
        if self._posed and time - self._posed[0] <= _HOLD:
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
            angle, _ = self._toward(min(time - self._posed[0], _PREDICTED), base)
        else:
            return 0.0, 0.0
        self._side = 1.0 if angle >= 0.0 else -1.0
        return speed, _TURN_GAIN * angle

    def _toward(self, seconds: float, base: Pose2D) -> tuple[float, float]:
        """Angle and distance to where the last pose is after some seconds."""
        _, report = self._posed or (0.0, None)
        if report is None or report.position is None or report.velocity is None:
            return 0.0, 0.0
        (x, y), (vx, vy) = report.position.tolist(), report.velocity.tolist()
        x, y = x + seconds * vx - base.x, y + seconds * vy - base.y
        return _wrapped(math.atan2(y, x) - base.yaw), math.hypot(x, y)


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
