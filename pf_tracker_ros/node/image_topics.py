"""Hints for log messages: the image topics of the graph, for a node that waits on another one."""

from __future__ import annotations

from collections.abc import Callable, Collection

from rclpy.node import Node

RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_SUFFIX = "/compressed"
_TRACKER_OUTPUTS = ("overlay", "likelihood", "target_probability")
_MAX_NAMED = 3


def image_publisher_hint(node: Node, topic: str, *, compressed: bool = False) -> str:
    """Hint for a subscriber whose topic has no publisher.

    Args:
        node: The subscribing node.
        topic: Full name of its topic.
        compressed: Whether it subscribes to compressed images.

    Returns:
        The end of a sentence; empty if the topic has a publisher.
    """
    if node.count_publishers(topic):
        return ""
    others = _image_topics(node, node.count_publishers)
    if not others:
        domain = node.context.get_domain_id()
        return f": no publisher of {topic}, nor of other images, with ROS_DOMAIN_ID {domain}"
    named = list(others)[:_MAX_NAMED]
    more = len(others) - len(named)
    text = ", ".join(named) + (f" and {more} more" if more else "")
    first, kind = next(iter(others.items()))
    arguments = subscription_arguments(topic, first, kind, compressed=compressed)
    return f": {topic} has no publisher, but images are on {text} ({arguments})"


def image_subscriber_hint(node: Node, topic: str, *, compressed: bool) -> str:
    """Hint for a publisher whose topic has no subscriber.

    Args:
        node: The publishing node.
        topic: Full name of its topic.
        compressed: Whether it publishes compressed images.

    Returns:
        The end of a sentence; empty if no other topic of that type has a subscriber.
    """
    kind = COMPRESSED if compressed else RAW
    others = [
        name
        for name, other in _image_topics(node, node.count_subscribers).items()
        if other == kind and name != topic
    ]
    if not others:
        return ""
    return f" (there is one of {others[0]}: {_remapping(others[0], kind)})"


def _image_topics(node: Node, count: Callable[[str], int]) -> dict[str, str]:
    """Name to type of image topics with endpoints, other than the node's own.

    Output images of trackers are left out.
    """
    own = f"{node.get_fully_qualified_name()}/"
    kinds = {name: types[0] for name, types in node.get_topic_names_and_types()}
    return {
        name: kind
        for name, kind in kinds.items()
        if kind in (RAW, COMPRESSED)
        and not name.startswith(own)
        and not _is_tracker_output(name, kinds)
        and count(name)
    }


def _is_tracker_output(topic: str, kinds: Collection[str]) -> bool:
    """Whether a tracker publishes these images, judged by its other topics."""
    node, _, name = topic.rpartition("/")
    return name in _TRACKER_OUTPUTS and f"{node}/particles" in kinds


def subscription_arguments(topic: str, other: str, kind: str, *, compressed: bool = False) -> str:
    """The arguments that subscribe to another topic of a type.

    Args:
        topic: Full name of the present topic.
        other: That of the other one.
        kind: `RAW` or `COMPRESSED`, the type of the other one.
        compressed: Whether the present subscription is to compressed images.
    """
    if kind == RAW and compressed and topic == other + _SUFFIX:
        return "-p image_transport:=raw"
    transport = " -p image_transport:=compressed" if kind == COMPRESSED else ""
    return _remapping(other, kind) + transport


def _remapping(topic: str, kind: str) -> str:
    """The remapping argument for a topic; compressed images follow that of raw ones."""
    if kind == COMPRESSED and not topic.endswith(_SUFFIX):
        return f"-r image{_SUFFIX}:={topic}"
    return f"-r image:={topic.removesuffix(_SUFFIX)}"
