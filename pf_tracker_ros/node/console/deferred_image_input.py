"""Image subscription that reads only after the tracker's status, to leave it the machine.

Reading an image of a megabyte costs several copies, just while the tracker reads the same image. So
images wait for the tracker's next status.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from pf_tracker_ros.node.tracker.image_subscription import ImageSubscription

# Images do not wait if there has been no status for so long, in seconds.
_TIMEOUT = 0.05
# Where so many images wait for one status, the camera is faster than the tracker. Then no image
# waits for so long, in seconds: the queue keeps only the newest.
_MAX_WAITING = 3
_OPEN_FOR = 1.0


class _Gate(MutuallyExclusiveCallbackGroup):
    """Lets the executor take messages only while it is open.

    It blocks the subscriptions' events, too: otherwise waiting messages wake the executor again and
    again.
    """

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.is_open = True

    def can_execute(self, entity: Any) -> bool:
        return self.is_open and bool(
            super().can_execute(entity)  # type: ignore[no-untyped-call]
        )


class DeferredImageInput:
    """Subscribes to the tracker's images while it is open.

    Images are taken at once if there has been no status for 0.05 s, and for a second after several
    images have waited for one status.

    Args:
        node: The console's node.
        receive: Called in the executor with each Image or CompressedImage.
        report: Called with a sentence if a QoS override is invalid.
    """

    def __init__(
        self, node: Node, receive: Callable[[Any], None], report: Callable[[str], None]
    ) -> None:
        self._node = node
        self._receive = receive
        self._report = report
        self._gate = _Gate()
        self._input: ImageSubscription | None = None
        self._last_status_at = self._open_until = float("-inf")
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_TIMEOUT, self._check_timeout, clock=clock, autostart=False)

    @property
    def topic(self) -> str:
        """Name of the topic, empty while closed."""
        return self._input.topic if self._input else ""

    def open(self, topic: str) -> None:
        """Subscribe to raw or compressed images, whichever the topic has.

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
        self._timer.reset()

    def close(self) -> None:
        """Destroy the subscription."""
        self._timer.cancel()
        if self._input:
            self._input.close()
            self._input = None

    def on_status(self) -> None:
        """Take the waiting images: the tracker has published a status."""
        self._last_status_at = time.monotonic()
        self._gate.is_open = self._last_status_at < self._open_until
        if self._gate.is_open or not self._input:
            return
        if self._input.take_pending(_MAX_WAITING) == _MAX_WAITING:
            self._open_until = self._last_status_at + _OPEN_FOR
            self._gate.is_open = True

    def _check_timeout(self) -> None:
        if time.monotonic() - self._last_status_at > _TIMEOUT:
            # The executor checks the gate again after this callback.
            self._gate.is_open = True
