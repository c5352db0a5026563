"""`/diagnostics` of the localizer."""

from __future__ import annotations

import time
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

# Seconds between two messages on /diagnostics.
_PERIOD = 1.0


class LocalizerDiagnostics:
    """The node's health on `/diagnostics`, once a second.

    Args:
        node: The publishing node.
        health: Returns level, sentence and values.
        report: Called with a sentence if a QoS override is invalid.
    """

    def __init__(
        self,
        node: Node,
        health: Callable[[], tuple[int, str, StatusValues]],
        report: ErrorCallback,
    ) -> None:
        self._node = node
        self._health = health
        self._publisher = advertise(
            node, DiagnosticArray, "/diagnostics", profile=DEFAULT_QOS, report=report
        )
        # Steady time: simulated time may stand still, which is worth a report.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(_PERIOD, self._publish, clock=clock)

    def _publish(self) -> None:
        header = Header(stamp=self._node.get_clock().now().to_msg())
        name = f"{self._node.get_fully_qualified_name().lstrip('/')}: localizer"
        status = Status(name, *self._health())
        self._publisher.publish(status_message(new_message, header, [status]))


class Rate:
    """The rate of a counter between two calls."""

    def __init__(self) -> None:
        self._last = 0, time.monotonic()

    def update(self, count: int) -> float:
        """Increase a second since the last call, Hz; 0 if the counter has started anew."""
        now = time.monotonic()
        (before, then), self._last = self._last, (count, now)
        return max(count - before, 0) / max(now - then, 1e-3)
