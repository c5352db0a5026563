"""The sources of the images: a tracker needs those of a single camera."""

from __future__ import annotations

import time
from collections.abc import Iterator

from rclpy.node import Node

from pf_tracker_ros.node.graph_monitor import listed, surplus_publishers

# Seconds for which an image shows that its frame_id is in use, and consecutive polls of the graph
# monitor before a report. A single change of the frame_id lasts for fewer.
_WINDOW, _POLLS = 2.0, 10


class ImageSources:
    """Knows the publishers of the images and their frame_ids.

    Args:
        node: The subscribing node.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        # frame_id to the time of its last image, for the seconds before the last image.
        self._seen_at: dict[str, float] = {}

    def see(self, frame_id: str) -> None:
        """Note the frame_id of an image."""
        now = time.monotonic()
        self._seen_at = {name: at for name, at in self._seen_at.items() if now - at < _WINDOW}
        self._seen_at[frame_id] = now

    def check_frame_id(self, frame_id: str) -> None:
        """Check the frame_id of a target against that of the images; either may be empty.

        Raises:
            ValueError: They differ.
        """
        if self._seen_at and frame_id and not {frame_id, ""} & self._seen_at.keys():
            raise ValueError(
                f"its frame_id is {listed([frame_id])}, but that of the images is "
                f"{listed(self._seen_at)}; send pixels of these images, with their frame_id or an "
                "empty one"
            )

    def conflicts(self, topic: str, message_type: str) -> Iterator[tuple[str, int]]:
        """Why the images may be of several cameras, as for `GraphMonitor`.

        Args:
            topic: Full name of the image topic, empty without a subscription.
            message_type: Type of the images, as `sensor_msgs/msg/Image`.
        """
        if not topic:
            return
        yield from surplus_publishers(self._node, topic, message_type)
        now = time.monotonic()
        frame_ids = [name for name, at in self._seen_at.items() if now - at < _WINDOW]
        if len(frame_ids) > 1:
            yield (
                f"the images on {topic} have {len(frame_ids)} frame_ids, {listed(frame_ids)}; let "
                "a single camera publish there, with one frame_id",
                _POLLS,
            )
