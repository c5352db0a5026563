"""Nodes that have the name of this one, so that nobody can tell them apart."""

from __future__ import annotations

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from pf_tracker_ros.node.qos import Report

# A topic that every node publishes on.
_OF_EVERY_NODE = "/parameter_events"
# Seconds from one look to the next.
_PERIOD = 5.0
# One that ended without a word stays in the graph for 20 s.
_LOOKS = 6


class NamesakeWatch:
    """Looks every few seconds whether another node has the node's name, and tells if that lasts.

    ROS allows it, and mixes up what both say: often it is one that was forgotten in the background.

    Attributes:
        lasting: What has been told, as long as it is so; empty otherwise.

    Args:
        node: Whose name it is.
        report: Called with a sentence once another one has had its name for half a minute.
    """

    def __init__(self, node: Node, report: Report) -> None:
        self._node = node
        self._report = report
        # How often in a row there was another one.
        self._seen = 0
        self.lasting = ""
        node.create_timer(_PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _look(self) -> None:
        node = self._node
        mine = (node.get_name(), node.get_namespace())
        # A node that has gone may stay among the names for long, but has no publishers any more.
        events = node.get_publishers_info_by_topic(_OF_EVERY_NODE)
        others = [(one.node_name, one.node_namespace) for one in events].count(mine) - 1
        self._seen = self._seen + 1 if others > 0 else 0
        if self._seen < _LOOKS:
            self.lasting = ""
        elif not self.lasting:
            name = node.get_fully_qualified_name()
            self.lasting = (
                f"another node is called {name}, too, and what both say is mixed up: end it, or "
                "give this one another name (-r __node:=another_name)"
            )
            self._report(self.lasting)
