"""The images that the tracker takes, each taken once it has answered, so as not to slow it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from pf_tracker_ros.node.tracker.image_subscription import ImageSubscription

# A tracker that has not answered for so long, in seconds, is not waited for.
_PATIENCE = 0.05
# Where so many images wait for one answer they come faster than they are answered, and for so long,
# in seconds, none is made to wait: only the newest are to be taken then.
_MANY = 3
_UNHINDERED = 1.0


class _Gate(MutuallyExclusiveCallbackGroup):
    """Lets the executor take what comes only while it is open.

    Events of its subscriptions wait, too: who waits for them alone is woken by each message there
    is, again and again.
    """

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.is_open = True

    def can_execute(self, entity: Any) -> bool:
        return self.is_open and bool(
            super().can_execute(entity)  # type: ignore[no-untyped-call]
        )


class DeferredImageInput:
    """Subscribes to the images of the tracker while it is open.

    To take an image of a megabyte is a few of them read and written, at the very moment at which
    the tracker does the same with it. So images wait until the next answer. They are taken as they
    come where there is none for 0.05 s, until there is one, and for a second where several have
    waited for one.

    Args:
        node: That subscribes.
        receive: Called in the executor with each message, an Image or a CompressedImage.
        report: Called with a sentence if an override of the quality of service is wrong.
    """

    def __init__(
        self, node: Node, receive: Callable[[Any], None], report: Callable[[str], None]
    ) -> None:
        self._node = node
        self._receive = receive
        self._report = report
        self._gate = _Gate()
        self._input: ImageSubscription | None = None
        self._answered_at = self._unhindered_until = float("-inf")
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._look = node.create_timer(_PATIENCE, self._lose_patience, clock=clock, autostart=False)

    @property
    def topic(self) -> str:
        """Name of the topic, empty while closed."""
        return self._input.topic if self._input else ""

    def open(self, topic: str) -> None:
        """Subscribe to raw or compressed images, whichever the topic has, as they are offered.

        Args:
            topic: Its name; empty for `image`.
        """
        self.close()
        self._input = ImageSubscription(
            self._node, self._receive, self._report, topic=topic, group=self._gate
        )
        kinds = dict(self._node.get_topic_names_and_types()).get(topic, [])
        is_compressed = "sensor_msgs/msg/CompressedImage" in kinds
        self._input.open("compressed" if is_compressed else "raw", "auto")
        self._look.reset()

    def close(self) -> None:
        """Give the subscription up."""
        self._look.cancel()
        if self._input:
            self._input.close()
            self._input = None

    def on_status(self) -> None:
        """Take the images that have come until now: the tracker has answered one."""
        self._answered_at = time.monotonic()
        self._gate.is_open = self._answered_at < self._unhindered_until
        if self._gate.is_open or not self._input:
            return
        if self._input.take_pending(_MANY) == _MANY:
            self._unhindered_until = self._answered_at + _UNHINDERED
            self._gate.is_open = True

    def _lose_patience(self) -> None:
        if time.monotonic() - self._answered_at > _PATIENCE:
            # The executor looks again what it may take once this is done.
            self._gate.is_open = True
