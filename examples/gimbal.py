#!/usr/bin/env python3
"""Turns a pan axis, or a robot, toward the target of the node `pf_tracker`.

1. While the state is `tracking`, the angular velocity is proportional to the offset of the box from
   the center of the image.
2. It is divided by 1 + std / 0.05, where std is the standard deviation of the box center as a share
   of the image width.
3. It is 0 when the target is occluded or lost, and after half a second without a tracked frame.

Start it in the namespace of the tracker:

    python3 gimbal.py --ros-args -r camera_info:=/camera/camera_info -r cmd_vel:=/gimbal/cmd_vel
"""

from __future__ import annotations

import time
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PolygonStamped, Twist
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.utilities import try_shutdown
from sensor_msgs.msg import CameraInfo

# Angular velocity for a target at the edge of the image, radians per second.
FASTEST_TURN = 1.0
# Standard deviation of the box center that halves the velocity, as a share of the image width.
DOUBTFUL_SPREAD = 0.05
# Seconds without a tracked frame after which to stop.
PATIENCE = 0.5
WATCHDOG_PERIOD = 0.05


class Gimbal(Node):
    """Publishes the angular velocity about z on `cmd_vel`, counterclockwise positive."""

    def __init__(self, **options: Any) -> None:
        super().__init__("gimbal", **options)
        self._width = 0
        self._center = (0, 0.0)
        self._spread = (0, 0.0)
        self._steered_at = -PATIENCE
        self._turns = self.create_publisher(Twist, "cmd_vel", 10)
        self.create_subscription(CameraInfo, "camera_info", self._on_camera, 10)
        # Volatile: a status from before the start of this node must not turn the axis.
        self.create_subscription(DiagnosticArray, "pf_tracker/status", self._on_status, 10)
        self.create_subscription(PolygonStamped, "pf_tracker/box", self._on_box, 10)
        # The steady clock runs on when the simulated time stops.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(WATCHDOG_PERIOD, self._watch, clock=steady)

    def _on_camera(self, message: CameraInfo) -> None:
        self._width = message.width

    def _on_box(self, message: PolygonStamped) -> None:
        corners = message.polygon.points
        self._center = (_stamp(message), (corners[0].x + corners[2].x) / 2)
        self._steer()

    def _on_status(self, message: DiagnosticArray) -> None:
        values = {item.key: item.value for item in message.status[0].values}
        if values["state"] == "tracking":
            self._spread = (_stamp(message), float(values["covariance_xx"]) ** 0.5)
            self._steer()
        elif values["state"] != "skipped":
            self._stop()

    def _steer(self) -> None:
        """Turn toward the target, once both box and status of a frame have arrived."""
        (box_stamp, x), (status_stamp, spread) = self._center, self._spread
        if box_stamp != status_stamp or not self._width:
            return
        error = x / (self._width / 2) - 1.0
        care = 1.0 + spread / (DOUBTFUL_SPREAD * self._width)
        self._steered_at = time.monotonic()
        self._turn(-FASTEST_TURN * error / care)

    def _watch(self) -> None:
        if time.monotonic() - self._steered_at > PATIENCE:
            self._stop()

    def _stop(self) -> None:
        self._turn(0.0)

    def _turn(self, rate: float) -> None:
        turn = Twist()
        turn.angular.z = rate
        self._turns.publish(turn)


def _stamp(message: DiagnosticArray | PolygonStamped) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def main() -> None:
    """Run until the node is interrupted or ROS shuts down."""
    rclpy.init()
    try:
        rclpy.spin(Gimbal())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        try_shutdown()


if __name__ == "__main__":
    main()
