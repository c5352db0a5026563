"""The topics of each frame besides its status."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor
from functools import partial

from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from pf_tracker_ros.node.messages import new_message
from pf_tracker_ros.node.qos import ErrorCallback, advertise_installed
from pf_tracker_ros.topics import OUTPUT_TOPICS, FrameResult, OutputTopic

PRIMARY_TOPICS = tuple(output.name for output in OUTPUT_TOPICS if not output.is_visualization)
# Drawn in a separate thread: it takes as long as tracking.
_OVERLAY = "overlay"
# The depth of its topic.
_MAX_WAITING = 10


class FramePublishers:
    """The publishers of `OUTPUT_TOPICS` of a configured node.

    A message is built only for a topic with subscribers. Without vision_msgs, only `~/detections`
    is missing.

    Args:
        node: The publishing node.
        report: Called with a sentence if a QoS override is invalid or an overlay failed.
    """

    def __init__(self, node: Node, report: ErrorCallback) -> None:
        self._node = node
        types = {output.name: output.message_type for output in OUTPUT_TOPICS}
        self._publishers = advertise_installed(node, types, report)
        self._overlay = OverlayPublisher(self._publishers[_OVERLAY], report)

    def has_subscribers(self, name: str) -> bool:
        """Whether a topic has subscribers."""
        publisher = self._publishers.get(name)
        return bool(publisher and publisher.get_subscription_count())

    def publish(
        self, header: Header, result: FrameResult, names: Collection[str] = PRIMARY_TOPICS
    ) -> None:
        """Publish some topics, by default those that robots act on."""
        for output, publisher in self._subscribed():
            if output.name in names:
                _publish(publisher, output, header, result)

    def publish_visualizations(self, header: Header, result: FrameResult) -> None:
        """Publish the visualizations; arguments as of `publish`."""
        for output, publisher in self._subscribed():
            if output.name == _OVERLAY:
                self._overlay.draw(partial(output.build, new_message, header, result))
            elif output.is_visualization:
                _publish(publisher, output, header, result)

    def close(self) -> None:
        """Remove the publishers."""
        self._overlay.close()
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)

    def _subscribed(self) -> list[tuple[OutputTopic, Publisher]]:
        return [
            (output, self._publishers[output.name])
            for output in OUTPUT_TOPICS
            if self.has_subscribers(output.name)
        ]


def _publish(
    publisher: Publisher, output: OutputTopic, header: Header, result: FrameResult
) -> None:
    message = output.build(new_message, header, result)
    if message is not None:
        publisher.publish(message)


class OverlayPublisher:
    """Draws images one after the other and publishes them, in a thread, as tracking does not wait.

    If more images wait than the topic's depth, the oldest are dropped. The thread starts with the
    first image, so a node without a subscriber of the overlay has none.

    Args:
        publisher: Publisher of the images.
        report: Called with a sentence if an image was not published; on the next call of `draw`.
    """

    def __init__(self, publisher: Publisher, report: ErrorCallback) -> None:
        self._publisher = publisher
        self._report = report
        self._lock = threading.Lock()
        self._is_busy = False
        self._waiting: deque[Callable[[], Image]] = deque(maxlen=_MAX_WAITING)
        self._errors: deque[Exception] = deque(maxlen=1)
        self._executor = ThreadPoolExecutor(1, thread_name_prefix="overlay")

    def draw(self, build: Callable[[], Image]) -> None:
        """Schedule an image.

        Args:
            build: Makes the message, in the thread; the data it reads must not change any more.
        """
        # Not in the thread: `report` is for the tracking thread alone.
        while self._errors:
            self._report(f"the overlay of a frame was not published: {self._errors.popleft()}")
        with self._lock:
            self._waiting.append(build)
            if self._is_busy:
                return
            self._is_busy = True
        self._executor.submit(self._publish_waiting)

    def close(self) -> None:
        """End the thread after the waiting images."""
        self._executor.shutdown()

    def _publish_waiting(self) -> None:
        while True:
            with self._lock:
                if not self._waiting:
                    self._is_busy = False
                    return
                build = self._waiting.popleft()
            try:
                self._publisher.publish(build())
            except Exception as error:
                # An error of drawing, or a context that shuts down: only this image is lost.
                self._errors.append(error)
