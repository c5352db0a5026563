"""Pictures that are drawn and published beside the tracking, in a thread of their own."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from rclpy.publisher import Publisher
from sensor_msgs.msg import Image

from pf_tracker_ros.node.qos import ErrorCallback

# As many as the topic keeps for a slow subscriber.
_MOST_WAITING = 10


class OverlayPublisher:
    """Draws pictures one after the other and publishes them; nobody waits for it.

    Where more of them wait than the topic would keep for a subscriber, the oldest are left out. The
    thread begins with the first picture: a node whose overlay nobody looks at has none.

    Args:
        publisher: Of the pictures.
        report: Called with a sentence if a picture could not be published, with the next one.
    """

    def __init__(self, publisher: Publisher, report: ErrorCallback) -> None:
        self._publisher = publisher
        self._report = report
        self._lock = threading.Lock()
        self._is_at_work = False
        self._waiting: deque[Callable[[], Image]] = deque(maxlen=_MOST_WAITING)
        self._errors: deque[Exception] = deque(maxlen=1)
        self._executor = ThreadPoolExecutor(1, thread_name_prefix="overlay")

    def draw(self, picture: Callable[[], Image]) -> None:
        """Have a picture drawn and published soon.

        Args:
            picture: Makes the message, in the thread; what it reads must not change from then on.
        """
        # Here and not in the thread: whoever takes the report is of the one that tracks.
        while self._errors:
            self._report(f"the overlay of a frame was not published: {self._errors.popleft()}")
        with self._lock:
            self._waiting.append(picture)
            if self._is_at_work:
                return
            self._is_at_work = True
        self._executor.submit(self._publish_waiting)

    def close(self) -> None:
        """End the thread, once it has published what waits."""
        self._executor.shutdown()

    def _publish_waiting(self) -> None:
        while True:
            with self._lock:
                if not self._waiting:
                    self._is_at_work = False
                    return
                picture = self._waiting.popleft()
            try:
                self._publisher.publish(picture())
            except Exception as error:
                # Whatever drawing raises, or a context that goes away: only this picture is lost.
                self._errors.append(error)
