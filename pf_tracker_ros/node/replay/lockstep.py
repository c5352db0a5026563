"""Replays a recording into a tracker node over DDS, in lockstep, and collects its results."""

from __future__ import annotations

import os
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PolygonStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.messages import box_message, box_of_polygon
from pf_tracker_ros.node.messages import new_message
from pf_tracker_ros.node.replay.replay_node import ReplayNode
from pf_tracker_ros.node.replay.replay_source import make_header
from pf_tracker_ros.node.running import spinning
from pf_tracker_ros.node.tracker.tracker_node import TrackerNode
from pf_tracker_ros.ros_domains import unused_domain
from pf_tracker_ros.stamps import stamp_of

_KEEP_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
# Latched like the status, so that messages sent during discovery arrive as well.
_KEEP_ALL_LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_ALL,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
_DISCOVERY_TIMEOUT = 30.0
# Longer than the 3 s after which DDS sends a lost message again.
_STATUS_TIMEOUT = 5.0
_DISCOVERY_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


class LockstepError(RuntimeError):
    """The nodes did not discover each other, or did not reach the end."""


@dataclass
class LockstepResult:
    """The tracker's output.

    Attributes:
        statuses: Stamp of a frame, in nanoseconds, to the values of its first status.
        boxes: Stamp to (x, y, width, height) in pixels, single precision.
    """

    statuses: dict[int, dict[str, str]] = field(default_factory=dict)
    boxes: dict[int, Box] = field(default_factory=dict)


def replay_in_lockstep(
    source: Path,
    box: Box,
    stamp: int,
    *,
    tracker: Mapping[str, Any],
    replay: Mapping[str, Any],
    timeout: float = 600.0,
) -> LockstepResult:
    """Replay a recording into a tracker node, each in its own context, and collect the output.

    The nodes run in an unused ROS domain and a unique namespace, and only on this machine unless
    ROS_AUTOMATIC_DISCOVERY_RANGE is set.

    Args:
        source: Source of the replay publisher.
        box: The target, (x, y, width, height) in pixels.
        stamp: Stamp of the target's frame in nanoseconds.
        tracker: Parameters of the tracker node.
        replay: Further parameters of the replay publisher.
        timeout: Timeout of the whole replay in seconds.

    Raises:
        LockstepError: The nodes do not discover each other, or do not reach the end.
        RuntimeError: No ROS domain is unused.
    """
    namespace = f"/replay_{uuid.uuid4().hex}"
    reliable = {"image_reliability": "reliable", **tracker}
    lockstep = {"source": str(source), "lockstep": True, "lockstep_timeout": _STATUS_TIMEOUT}
    deadline = time.monotonic() + timeout
    with (
        _on_this_machine(),
        unused_domain() as domain,
        _spinning(TrackerNode, domain, namespace, reliable) as node,
        _spinning(_Client, domain, namespace, {}) as client,
    ):
        _wait(lambda: client.is_connected(node), _DISCOVERY_TIMEOUT, "the tracker was not found")
        client.send_target(box, stamp)
        with _spinning(ReplayNode, domain, namespace, {**lockstep, **replay}) as player:
            if not player.has_started:
                raise LockstepError(f"{source} cannot be replayed; see the log")
            _wait(
                lambda: not player.context.ok(),
                deadline - time.monotonic(),
                f"the replay did not end within {timeout:g} s",
            )
            if player.exit_code:
                raise LockstepError(f"{source} could not be replayed to its end")
        _wait(client.is_complete, _DISCOVERY_TIMEOUT, "a box of the tracker did not arrive")
        return client.result


class _Client(Node):
    """Sends the target to the tracker and collects its output."""

    def __init__(self, **options: Any) -> None:
        super().__init__("listener", **options)
        self.result = LockstepResult()
        self._outputs = [
            self.create_subscription(
                DiagnosticArray, "pf_tracker/status", self._on_status, _KEEP_ALL_LATCHED
            ),
            self.create_subscription(PolygonStamped, "pf_tracker/box", self._on_box, _KEEP_ALL),
        ]
        self._targets = self.create_publisher(PolygonStamped, "pf_tracker/target", 1)

    def is_connected(self, tracker: Node) -> bool:
        """Whether both nodes have discovered each other on all topics."""
        topics = {subscription.topic_name for subscription in self._outputs}
        publishers = [each for each in tracker.publishers if each.topic_name in topics]
        return (
            self._targets.get_subscription_count() > 0
            and len(publishers) == len(topics)
            and all(each.get_subscription_count() for each in publishers)
            and all(self.count_publishers(topic) for topic in topics)
        )

    def send_target(self, box: Box, stamp: int) -> None:
        """Send the target and wait for its acknowledgment."""
        self._targets.publish(box_message(new_message, make_header(stamp, "camera"), box))
        if not self._targets.wait_for_all_acked(Duration(seconds=_DISCOVERY_TIMEOUT)):
            raise LockstepError("the tracker did not receive its target")

    def is_complete(self) -> bool:
        """Whether the box of every status with a box has arrived."""
        statuses = dict(self.result.statuses)
        with_box = {
            stamp
            for stamp, values in statuses.items()
            if values["state"] in ("tracking", "occluded")
        }
        return with_box <= self.result.boxes.keys()

    def _on_status(self, message: DiagnosticArray) -> None:
        # The first is the node's; those of several targets follow.
        values = {pair.key: pair.value for pair in message.status[0].values}
        # A repeated frame has a second status, which does not count.
        self.result.statuses.setdefault(stamp_of(message.header), values)

    def _on_box(self, message: PolygonStamped) -> None:
        self.result.boxes.setdefault(stamp_of(message.header), box_of_polygon(message))


def _spinning(
    kind: Callable[..., Node], domain: int, namespace: str, parameters: Mapping[str, Any]
) -> AbstractContextManager[Any]:
    """A node that spins until the block ends."""
    overrides = [
        Parameter(name, value=list(value) if isinstance(value, tuple) else value)
        for name, value in parameters.items()
    ]
    options = {"namespace": namespace, "parameter_overrides": overrides}
    return spinning(lambda context: kind(context=context, **options), domain)


@contextmanager
def _on_this_machine() -> Iterator[None]:
    was_set = _DISCOVERY_RANGE in os.environ
    os.environ.setdefault(_DISCOVERY_RANGE, "LOCALHOST")
    try:
        yield
    finally:
        if not was_set:
            del os.environ[_DISCOVERY_RANGE]


def _wait(condition: Callable[[], bool], timeout: float, failure: str) -> None:
    deadline = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > deadline:
            raise LockstepError(failure)
        time.sleep(0.02)
