"""Draws and publishes overlay images in a separate thread, so that tracking does not wait."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from rclpy.publisher import Publisher
from sensor_msgs.msg import Image

from pf_tracker_ros.node.qos import ErrorCallback

# The depth of the topic.
_MAX_WAITING = 10


class OverlayPublisher:
    """Draws images one after the other and publishes them.

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
