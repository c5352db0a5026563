#!/usr/bin/env python3
"""Drives a robot after the target of the nodes `pf_tracker` and `localizer`, and keeps a distance.

1. With a pose of the target: drive to keep the distance, and turn toward it.
2. Without, but with a bearing: turn toward that, and stand still.
3. With neither: turn for 1.5 s toward where its last velocity takes it, then search to that side.
4. Without odometry or localizer, if their frames differ, or after 20 s of 3: stand still.

It does not look for obstacles: send the velocities through a safety node, or see
docs/follow_a_person.md for Nav2. Start it in the namespace of the tracker:

    python3 follow_person.py --ros-args -r odom:=/odom -r cmd_vel:=/cmd_vel -p distance:=2.0
"""

import cmath
import math
import time
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped, Vector3Stamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.utilities import try_shutdown

# Of the search in radians per second.
SPEED_GAIN, TURN_GAIN, SEARCH_TURN = 1.2, 2.0, 0.7
# Seconds for which odometry, a pose or a bearing counts, and a velocity; seconds after which the
# search ends, without a status after which tracker or localizer are gone, and between velocities.
FRESH, PREDICTED, GIVES_UP_AFTER, GONE_AFTER, PERIOD = 0.3, 1.5, 20.0, 0.5, 0.05
# Default, minimum, maximum and description.
LIMITS = {
    "distance": (2.0, 0.5, 20.0, "Distance to keep, m"),
    "fastest": (0.8, 0.0, 5.0, "Maximum speed forward, m/s"),
    "fastest_backward": (0.0, 0.0, 5.0, "Maximum speed backward, m/s"),
    "fastest_turn": (1.2, 0.0, 6.0, "Maximum turn, rad/s"),
}


class Follower(Node):
    """Publishes velocities on `cmd_vel`; the pose's frame has to be that of `odom`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("follow_person", **options)
        for name, (default, least, most, text) in LIMITS.items():
            limits = [FloatingPointRange(from_value=least, to_value=most)]
            kind = ParameterDescriptor(description=text, floating_point_range=limits)
            self.declare_parameter(name, default, kind)
        kind = ParameterDescriptor(description="Send TwistStamped, not Twist", read_only=True)
        self._stamped = self.declare_parameter("stamped", False, kind).value
        # By `time.monotonic`: place and direction, place and velocity, direction; as x + iy.
        self._base: tuple[float, complex, complex] | None = None
        self._target: tuple[float, complex, complex] | None = None
        self._heading: tuple[float, complex] | None = None
        self._heard_at, self._side = -math.inf, 1.0
        self._frames = ["", ""]  # of the odometry and of the target
        message_type = TwistStamped if self._stamped else Twist
        self._velocities = self.create_publisher(message_type, "cmd_vel", 10)
        self.create_subscription(Odometry, "odom", self._on_base, qos_profile_sensor_data)
        self.create_subscription(Odometry, "localizer/odometry", self._on_target, 10)
        self.create_subscription(Vector3Stamped, "localizer/bearing", self._on_bearing, 10)
        # Volatile: a status from before the start of this node must not count.
        self.create_subscription(DiagnosticArray, "localizer/status", self._on_status, 10)
        # The steady clock runs on when the simulated time stops.
        self.create_timer(PERIOD, self._drive, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_status(self, _: DiagnosticArray) -> None:
        self._heard_at = time.monotonic()

    def _on_base(self, message: Odometry) -> None:
        self._frames[0], pose = message.header.frame_id, _pose(message)
        if all(map(cmath.isfinite, pose)):
            self._base = time.monotonic(), *pose

    def _on_target(self, message: Odometry) -> None:
        self._frames[1], (place, direction) = message.header.frame_id, _pose(message)
        # The velocity is in the frame of the target.
        velocity = direction * complex(message.twist.twist.linear.x, message.twist.twist.linear.y)
        if cmath.isfinite(place) and cmath.isfinite(velocity):
            self._target = time.monotonic(), place, velocity

    def _on_bearing(self, message: Vector3Stamped) -> None:
        # In the optical frame x is to the right, z forward.
        now, ahead = time.monotonic(), complex(message.vector.z, -message.vector.x)
        if self._base and now - self._base[0] <= FRESH and cmath.isfinite(ahead):
            self._heading = now, self._base[2] * ahead

    def _drive(self) -> None:
        now, command, value = time.monotonic(), TwistStamped(), self.get_parameter
        frame, other = self._frames
        if frame and other and frame != other:
            text = f"standing still: set the localizer's fixed_frame to '{frame}'; it is '{other}'"
            self.get_logger().error(text, throttle_duration_sec=60.0)  # type: ignore[no-untyped-call]
        elif now - self._heard_at <= GONE_AFTER and self._base and now - self._base[0] <= FRESH:
            speed, turn = self._command(now, *self._base[1:])
            speed = min(max(speed, -value("fastest_backward").value), value("fastest").value)
            most = value("fastest_turn").value
            command.twist.linear.x, command.twist.angular.z = speed, min(max(turn, -most), most)
        command.header.stamp = self.get_clock().now().to_msg()
        self._velocities.publish(command if self._stamped else command.twist)

    def _command(self, now: float, base: complex, direction: complex) -> tuple[float, float]:
        """Speed in m/s and turn in rad/s, for the place and direction of the robot."""
        speed = 0.0
        seen_at, place, velocity = self._target or (-math.inf, base, 0j)
        headed_at, heading = self._heading or (-math.inf, direction)
        if now - seen_at <= FRESH:
            way = (place - base) / direction
            gap = abs(way) - self.get_parameter("distance").value
            speed = SPEED_GAIN * gap * max(math.cos(cmath.phase(way)), 0.0)
        elif now - headed_at <= FRESH:
            way = heading / direction
        elif now - seen_at <= PREDICTED:
            way = (place + (now - seen_at) * velocity - base) / direction
        else:
            has_ended = now - max(seen_at, headed_at) > GIVES_UP_AFTER
            return 0.0, 0.0 if has_ended else self._side * SEARCH_TURN
        self._side = 1.0 if way.imag >= 0.0 else -1.0
        return speed, TURN_GAIN * cmath.phase(way)


def _pose(message: Odometry) -> tuple[complex, complex]:
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    # The quaternion has half the angle.
    return complex(place.x, place.y), cmath.rect(1.0, 2.0 * math.atan2(turn.z, turn.w))


def main() -> None:
    """Run until the node is interrupted or ROS shuts down."""
    rclpy.init()
    try:
        rclpy.spin(Follower())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except ParameterException as error:
        raise SystemExit(f"follow_person: {error} (numbers need a point: 2.0)") from None
    finally:
        try_shutdown()


if __name__ == "__main__":
    main()
