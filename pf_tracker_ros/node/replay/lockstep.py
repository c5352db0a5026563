"""A recording through the real nodes over DDS, in lockstep, and what the tracker answers."""

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

_EVERYTHING = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
# As latched as the status is: what is sent while the two get acquainted comes as well.
_EVERY_STATUS = QoSProfile(
    history=HistoryPolicy.KEEP_ALL,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
_MEETING_TIMEOUT = 30.0
# Longer than the 3 s after which DDS sends again what was lost on the way.
_ANSWER_TIMEOUT = 5.0
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


class LockstepError(RuntimeError):
    """The nodes did not meet, or did not come to the end; the message says which."""


@dataclass
class LockstepResult:
    """What the tracker published.

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
    """Replay a recording into a tracker node, each in a context of its own, and listen.

    They meet in a ROS domain in which nobody else on this machine is, in a namespace that nobody
    else has, and on this machine alone unless ROS_AUTOMATIC_DISCOVERY_RANGE says otherwise.

    Args:
        source: What `replay` plays.
        box: The target, (x, y, width, height) in pixels.
        stamp: Of the frame that it is in, nanoseconds.
        tracker: Parameters of the tracker node.
        replay: Parameters of the replay publisher beside the source and lockstep.
        timeout: Longest time that all of it may take, in seconds.

    Raises:
        LockstepError: The nodes do not meet, or do not come to the end.
        RuntimeError: There is somebody in every ROS domain.
    """
    namespace = f"/replay_{uuid.uuid4().hex}"
    reliably = {"image_reliability": "reliable", **tracker}
    lockstep = {"source": str(source), "lockstep": True, "lockstep_timeout": _ANSWER_TIMEOUT}
    deadline = time.monotonic() + timeout
    with (
        _on_this_machine(),
        unused_domain() as domain,
        _spinning(TrackerNode, domain, namespace, reliably) as node,
        _spinning(_Listener, domain, namespace, {}) as listener,
    ):
        _wait(lambda: listener.knows(node), _MEETING_TIMEOUT, "the tracker was not found")
        listener.send(box, stamp)
        with _spinning(ReplayNode, domain, namespace, {**lockstep, **replay}) as player:
            if not player.has_started:
                raise LockstepError(f"{source} cannot be replayed; the log says why")
            _wait(
                lambda: not player.context.ok(),
                deadline - time.monotonic(),
                f"the replay did not end within {timeout:g} s",
            )
            if player.exit_code:
                raise LockstepError(f"{source} could not be replayed to its end")
        _wait(listener.is_complete, _MEETING_TIMEOUT, "a box of the tracker did not arrive")
        return listener.answers


class _Listener(Node):
    """Hears what the tracker says of each frame, and sends it its target."""

    def __init__(self, **options: Any) -> None:
        super().__init__("listener", **options)
        self.answers = LockstepResult()
        self._heard = [
            self.create_subscription(
                DiagnosticArray, "pf_tracker/status", self._on_status, _EVERY_STATUS
            ),
            self.create_subscription(PolygonStamped, "pf_tracker/box", self._on_box, _EVERYTHING),
        ]
        self._targets = self.create_publisher(PolygonStamped, "pf_tracker/target", 1)

    def knows(self, tracker: Node) -> bool:
        """Whether both sides know each other, on all topics."""
        heard = {subscription.topic_name for subscription in self._heard}
        telling = [each for each in tracker.publishers if each.topic_name in heard]
        return (
            self._targets.get_subscription_count() > 0
            and len(telling) == len(heard)
            and all(each.get_subscription_count() for each in telling)
            and all(self.count_publishers(topic) for topic in heard)
        )

    def send(self, box: Box, stamp: int) -> None:
        """Send the target, and wait until the tracker has it."""
        self._targets.publish(box_message(new_message, make_header(stamp, "camera"), box))
        if not self._targets.wait_for_all_acked(Duration(seconds=_MEETING_TIMEOUT)):
            raise LockstepError("the tracker did not take its target")

    def is_complete(self) -> bool:
        """Whether every box has come that a status announced."""
        statuses = dict(self.answers.statuses)
        announced = {
            stamp
            for stamp, values in statuses.items()
            if values["state"] in ("tracking", "occluded")
        }
        return announced <= self.answers.boxes.keys()

    def _on_status(self, message: DiagnosticArray) -> None:
        # That of the node itself; with several targets, theirs come after it.
        values = {pair.key: pair.value for pair in message.status[0].values}
        # The first is the answer; a frame that comes twice changes nothing.
        self.answers.statuses.setdefault(stamp_of(message.header), values)

    def _on_box(self, message: PolygonStamped) -> None:
        self.answers.boxes.setdefault(stamp_of(message.header), box_of_polygon(message))


def _spinning(
    kind: Callable[..., Node], domain: int, namespace: str, parameters: Mapping[str, Any]
) -> AbstractContextManager[Any]:
    """A node with these parameters that spins until the block ends."""
    overrides = [
        Parameter(name, value=list(value) if isinstance(value, tuple) else value)
        for name, value in parameters.items()
    ]
    options = {"namespace": namespace, "parameter_overrides": overrides}
    return spinning(lambda context: kind(context=context, **options), domain)


@contextmanager
def _on_this_machine() -> Iterator[None]:
    is_given = _RANGE in os.environ
    os.environ.setdefault(_RANGE, "LOCALHOST")
    try:
        yield
    finally:
        if not is_given:
            del os.environ[_RANGE]


def _wait(condition: Callable[[], bool], timeout: float, failure: str) -> None:
    deadline = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > deadline:
            raise LockstepError(failure)
        time.sleep(0.02)
