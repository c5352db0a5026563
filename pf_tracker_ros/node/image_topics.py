"""Where in the graph there are images, for whoever waits for them on another topic."""

from __future__ import annotations

from collections.abc import Callable, Collection

from rclpy.node import Node

_RAW, _COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_SUFFIX = "/compressed"
_OF_TRACKERS = ("overlay", "likelihood")
_MOST_NAMED = 3


def image_publisher_hint(node: Node, topic: str, *, compressed: bool = False) -> str:
    """What to do about images that do not come, where nobody publishes them.

    Args:
        node: That waits for them.
        topic: Full name of the topic on which it does.
        compressed: Whether it waits for compressed images.

    Returns:
        The end of a sentence; empty where the topic has a publisher.
    """
    if node.count_publishers(topic):
        return ""
    others = _image_topics(node, node.count_publishers)
    if not others:
        domain = node.context.get_domain_id()
        return f": nobody publishes {topic}, nor other images, with ROS_DOMAIN_ID {domain}"
    named = list(others)[:_MOST_NAMED]
    more = len(others) - len(named)
    text = ", ".join(named) + (f" and {more} more" if more else "")
    first, kind = next(iter(others.items()))
    cure = _cure(topic, first, kind, compressed=compressed)
    return f": nobody publishes {topic}, but {text} ({cure})"


def image_subscriber_hint(node: Node, topic: str, *, compressed: bool) -> str:
    """Where else images are waited for, for a publisher that nobody listens to.

    Args:
        node: That publishes.
        topic: Full name of the topic on which it does.
        compressed: Whether it publishes compressed images.

    Returns:
        The end of a sentence; empty where no images of that kind are waited for.
    """
    kind = _COMPRESSED if compressed else _RAW
    others = [
        name
        for name, other in _image_topics(node, node.count_subscribers).items()
        if other == kind and name != topic
    ]
    if not others:
        return ""
    return f" (there is one of {others[0]}: {_remapping(others[0], kind)})"


def _image_topics(node: Node, count: Callable[[str], int]) -> dict[str, str]:
    """Name to type of topics of images that somebody publishes or takes, but for its own.

    What trackers make of images is none to be tracked in.
    """
    own = f"{node.get_fully_qualified_name()}/"
    kinds = {name: types[0] for name, types in node.get_topic_names_and_types()}
    return {
        name: kind
        for name, kind in kinds.items()
        if kind in (_RAW, _COMPRESSED)
        and not name.startswith(own)
        and not _is_of_a_tracker(name, kinds)
        and count(name)
    }


def _is_of_a_tracker(topic: str, kinds: Collection[str]) -> bool:
    """Whether a tracker makes these images, by what else there is beside them."""
    node, _, name = topic.rpartition("/")
    return name in _OF_TRACKERS and f"{node}/particles" in kinds


def _cure(topic: str, other: str, kind: str, *, compressed: bool) -> str:
    """The arguments that let who waits on a topic hear another one."""
    if kind == _RAW and compressed and topic == other + _SUFFIX:
        return "-p image_transport:=raw"
    transport = " -p image_transport:=compressed" if kind == _COMPRESSED else ""
    return _remapping(other, kind) + transport


def _remapping(topic: str, kind: str) -> str:
    """The argument that leads a node to a topic; compressed images come beside the raw ones."""
    if kind == _COMPRESSED and not topic.endswith(_SUFFIX):
        return f"-r image{_SUFFIX}:={topic}"
    return f"-r image:={topic.removesuffix(_SUFFIX)}"
