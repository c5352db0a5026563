#!/usr/bin/env python3
"""Turns a pan axis, or a robot, toward the target: a node between `pf_tracker` and what it moves.

It steers by the boxes of frames that show the target, more carefully the less is known of its
place. It stands still at once when the target is hidden or lost, and after half a second without a
frame that shows it, whether frames are skipped or nothing comes at all. Start it in the namespace
of the tracker:

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

# Radians a second for a target at the edge of the image.
FASTEST_TURN = 1.0
# Standard deviation of the target's place, as a share of the image's width, that halves the turn.
DOUBTFUL_SPREAD = 0.05
# Seconds without a frame that shows the target, after which to stand still.
PATIENCE = 0.5
WATCHDOG_PERIOD = 0.05


class Gimbal(Node):
    """Publishes the turn on `cmd_vel`, angular velocity about z, counterclockwise."""

    def __init__(self, **options: Any) -> None:
        super().__init__("gimbal", **options)
        self._width = 0
        self._center = (0, 0.0)
        self._spread = (0, 0.0)
        self._steered_at = -PATIENCE
        self._turns = self.create_publisher(Twist, "cmd_vel", 10)
        self.create_subscription(CameraInfo, "camera_info", self._on_camera, 10)
        # Not latched: what the tracker said before this node came is no reason to turn.
        self.create_subscription(DiagnosticArray, "pf_tracker/status", self._on_status, 10)
        self.create_subscription(PolygonStamped, "pf_tracker/box", self._on_box, 10)
        # By the wall's clock: the one of the camera may stand still.
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
        """Turn toward the target, once both the box and the status of a frame are here."""
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
    """Run until it is told to stop."""
    rclpy.init()
    try:
        rclpy.spin(Gimbal())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        try_shutdown()


if __name__ == "__main__":
    main()
