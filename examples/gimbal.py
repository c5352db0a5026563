#!/usr/bin/env python3
"""Turns a pan axis, or a robot, toward the target of the nodes `pf_tracker` and `localizer`.

1. The localizer gives the direction of the target while the tracker is sure of it. The angular
   velocity is proportional to its angle to the left of the optical axis.
2. It is divided by 1 + std / 0.05, where std is the standard deviation of that angle in radians,
   from the localizer's status.
3. It is 0 when the target is occluded or lost, and after half a second without a direction.

Start it in the namespace of the tracker; with `-p stamped:=true` it sends TwistStamped:

    python3 gimbal.py --ros-args -r cmd_vel:=/gimbal/cmd_vel
"""

from __future__ import annotations

import math
import time
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped, Vector3Stamped
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.utilities import try_shutdown

# Angular velocity for each radian of the angle, and the fastest one, radians per second.
GAIN, FASTEST_TURN = 1.5, 1.0
# Standard deviation of the angle that halves the velocity, radians.
DOUBTFUL_SPREAD = 0.05
# Seconds without a direction after which to stop.
PATIENCE = 0.5
WATCHDOG_PERIOD = 0.05


class Gimbal(Node):
    """Publishes the angular velocity about z on `cmd_vel`, counterclockwise positive."""

    def __init__(self, **options: Any) -> None:
        super().__init__("gimbal", **options)
        self._bearing = (0, 0.0)
        self._spread = (0, 0.0)
        self._steered_at = -PATIENCE
        kind = ParameterDescriptor(description="Send TwistStamped, not Twist", read_only=True)
        self._stamped = self.declare_parameter("stamped", False, kind).value
        message_type = TwistStamped if self._stamped else Twist
        self._turns = self.create_publisher(message_type, "cmd_vel", 10)
        self.create_subscription(Vector3Stamped, "localizer/bearing", self._on_bearing, 10)
        # Volatile: a status from before the start of this node must not turn the axis.
        self.create_subscription(DiagnosticArray, "localizer/status", self._on_status, 10)
        # The steady clock runs on when the simulated time stops.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(WATCHDOG_PERIOD, self._watch, clock=steady)

    def _on_bearing(self, message: Vector3Stamped) -> None:
        # In the optical frame x is to the right, z forward.
        angle = -math.atan2(message.vector.x, message.vector.z)
        self._bearing = (_stamp(message), angle)
        self._steer()

    def _on_status(self, message: DiagnosticArray) -> None:
        values = [{item.key: item.value for item in one.values} for one in message.status]
        for target in values[1:]:
            if target["id"] != values[0]["selected"]:
                continue
            if target["state"] == "tracking" and "bearing_covariance_xx" in target:
                spread = float(target["bearing_covariance_xx"]) ** 0.5
                self._spread = (_stamp(message), spread)
                self._steer()
            else:
                self._turn(0.0)

    def _steer(self) -> None:
        """Turn toward the target, once both bearing and status of a frame have arrived."""
        (bearing_stamp, angle), (status_stamp, spread) = self._bearing, self._spread
        if bearing_stamp != status_stamp:
            return
        turn = GAIN * angle / (1.0 + spread / DOUBTFUL_SPREAD)
        self._steered_at = time.monotonic()
        self._turn(min(max(turn, -FASTEST_TURN), FASTEST_TURN))

    def _watch(self) -> None:
        if time.monotonic() - self._steered_at > PATIENCE:
            self._turn(0.0)

    def _turn(self, rate: float) -> None:
        command = TwistStamped()
        command.header.stamp = self.get_clock().now().to_msg()
        command.twist.angular.z = rate
        self._turns.publish(command if self._stamped else command.twist)


def _stamp(message: DiagnosticArray | Vector3Stamped) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def main() -> None:
    """Run until the node is interrupted or ROS shuts down."""
    rclpy.init()
    try:
        rclpy.spin(Gimbal())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except ParameterException as error:
        raise SystemExit(f"gimbal: {error}") from None
    finally:
        try_shutdown()


if __name__ == "__main__":
    main()
