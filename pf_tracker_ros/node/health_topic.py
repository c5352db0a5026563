"""The topic `/diagnostics`: the health of a node, once a second."""

from __future__ import annotations

from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from std_msgs.msg import Header

from pf_tracker_ros.messages import Status, status_message
from pf_tracker_ros.node.messages import new_message
from pf_tracker_ros.node.qos import DEFAULT_QOS, ErrorCallback, advertise
from pf_tracker_ros.topics import StatusValues

PERIOD = 1.0
"""Seconds between two messages."""


class HealthTopic:
    """Publishes the health of a node.

    Args:
        node: The publishing node.
        role: Last word of the status name, such as "tracker".
        health: Returns level, sentence and values.
        report: Called with a sentence if a QoS override is invalid.
    """

    def __init__(
        self,
        node: Node,
        role: str,
        health: Callable[[], tuple[int, str, StatusValues]],
        report: ErrorCallback,
    ) -> None:
        self._node = node
        self._role = role
        self._health = health
        self._publisher = advertise(
            node, DiagnosticArray, "/diagnostics", profile=DEFAULT_QOS, report=report
        )
        # Steady time: simulated time may stand still, which is worth a report.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(PERIOD, self._publish, clock=clock)

    def _publish(self) -> None:
        header = Header(stamp=self._node.get_clock().now().to_msg())
        name = f"{self._node.get_fully_qualified_name().lstrip('/')}: {self._role}"
        status = Status(name, *self._health())
        self._publisher.publish(status_message(new_message, header, [status]))
