#!/usr/bin/env python3
"""Drives a robot after the target of the nodes `pf_tracker` and `localizer`, and keeps a distance.

1. With a pose of the target: drive to keep the distance, and turn toward it.
2. Without, but with a bearing: turn toward that, and stand still.
3. With neither: turn for 1.5 s toward where its last velocity takes it, then search to that side.
4. Without odometry, or 20 s after the last pose or bearing: stand still.

It does not look for obstacles: send the velocities through a safety node, or see
docs/follow_a_person.md for Nav2. Start it in the namespace of the tracker:

    python3 follow_person.py --ros-args -r odom:=/odom -r cmd_vel:=/cmd_vel -p distance:=2.0
"""

from __future__ import annotations

import math
import time
from typing import Any

import rclpy
from geometry_msgs.msg import Twist, Vector3Stamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.utilities import try_shutdown

SPEED_GAIN, TURN_GAIN = 1.2, 2.0
# Of the search, radians per second.
SEARCH_TURN = 0.7
# Seconds for which a pose, a bearing or odometry counts, for which a velocity does, and after which
# the search ends.
FRESH, PREDICTED, GIVES_UP_AFTER = 0.3, 1.5, 20.0
PERIOD = 0.05


class Follower(Node):
    """Publishes velocities on `cmd_vel`; the pose's frame has to be that of `odom`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("follow_person", **options)
        self._distance = self.declare_parameter("distance", 2.0).value
        self._fastest = self.declare_parameter("fastest", 0.8).value
        self._fastest_turn = self.declare_parameter("fastest_turn", 1.2).value
        # Each with its arrival, by `time.monotonic`.
        self._base: tuple[float, float, float, float] | None = None
        self._target: tuple[float, float, float, float, float] | None = None
        self._heading: tuple[float, float] | None = None
        self._known_at, self._side = -math.inf, 1.0
        self._velocities = self.create_publisher(Twist, "cmd_vel", 10)
        sensor = qos_profile_sensor_data
        self.create_subscription(Odometry, "odom", self._on_base, sensor)
        self.create_subscription(Odometry, "localizer/odometry", self._on_target, 10)
        self.create_subscription(Vector3Stamped, "localizer/bearing", self._on_bearing, 10)
        # The steady clock runs on when the simulated time stops.
        self.create_timer(PERIOD, self._drive, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_base(self, message: Odometry) -> None:
        place = message.pose.pose.position
        self._base = time.monotonic(), place.x, place.y, _yaw(message)

    def _on_target(self, message: Odometry) -> None:
        place, yaw = message.pose.pose.position, _yaw(message)
        # The velocity is in the frame of the target.
        along, across = message.twist.twist.linear.x, message.twist.twist.linear.y
        x = math.cos(yaw) * along - math.sin(yaw) * across
        y = math.sin(yaw) * along + math.cos(yaw) * across
        self._target = time.monotonic(), place.x, place.y, x, y

    def _on_bearing(self, message: Vector3Stamped) -> None:
        if self._base:
            # In the optical frame x is to the right, z forward.
            angle = -math.atan2(message.vector.x, message.vector.z)
            self._heading = time.monotonic(), self._base[3] + angle

    def _drive(self) -> None:
        now, command = time.monotonic(), Twist()
        if self._base and now - self._base[0] <= FRESH:
            speed, turn = self._command(now, *self._base[1:])
            command.linear.x = min(max(speed, -self._fastest), self._fastest)
            command.angular.z = min(max(turn, -self._fastest_turn), self._fastest_turn)
        self._velocities.publish(command)

    def _command(self, now: float, x: float, y: float, yaw: float) -> tuple[float, float]:
        """Speed in m/s and turn in rad/s, for the place of the robot."""
        speed = 0.0
        unseen_for = now - self._target[0] if self._target else math.inf
        if unseen_for <= FRESH:
            angle, distance = self._toward(0.0, x, y, yaw)
            speed = SPEED_GAIN * (distance - self._distance) * max(math.cos(angle), 0.0)
            self._known_at = now
        elif self._heading and now - self._heading[0] <= FRESH:
            angle = _wrapped(self._heading[1] - yaw)
            self._known_at = now
        elif unseen_for <= PREDICTED:
            angle, _ = self._toward(unseen_for, x, y, yaw)
        elif now - self._known_at <= GIVES_UP_AFTER:
            return 0.0, self._side * SEARCH_TURN
        else:
            return 0.0, 0.0
        self._side = 1.0 if angle >= 0.0 else -1.0
        return speed, TURN_GAIN * angle

    def _toward(self, seconds: float, x: float, y: float, yaw: float) -> tuple[float, float]:
        """Angle and distance to where the target is some seconds after its last pose."""
        _, place_x, place_y, velocity_x, velocity_y = self._target or (0.0, x, y, 0.0, 0.0)
        offset_x = place_x + seconds * velocity_x - x
        offset_y = place_y + seconds * velocity_y - y
        angle = _wrapped(math.atan2(offset_y, offset_x) - yaw)
        return angle, math.hypot(offset_x, offset_y)


def _yaw(message: Odometry) -> float:
    turn = message.pose.pose.orientation
    return 2.0 * math.atan2(turn.z, turn.w)


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def main() -> None:
    """Run until the node is interrupted or ROS shuts down."""
    rclpy.init()
    try:
        rclpy.spin(Follower())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        try_shutdown()


if __name__ == "__main__":
    main()
