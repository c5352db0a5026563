"""Publishers and subscriptions of one topic that can never match: who they are, and what to do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import copy
from typing import NamedTuple

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from pf_tracker_ros.node.qos import PREFIX, Report

# A node whose name is not known.
_NOBODY = "a node"
# Seconds from one look to the next.
_PERIOD = 0.5
# Looks after which somebody is told of whose name is still not known.
_MOST_UNNAMED = 8
# rclpy tells of it by itself.
_OF_RCLPY = "/parameter_events"
_RAW, _COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
# Those by which two endpoints may differ too much, each on its own.
_POLICIES = ("reliability", "durability", "deadline", "liveliness", "liveliness_lease_duration")

Cure = Callable[[str, str], str]


def no_cure_of_its_own(topic: str, policy: str) -> str:
    """The cure that every topic has is all there is."""
    return ""


class _Mismatch(NamedTuple):
    """An endpoint of somebody else that one of the node's can never match.

    Attributes:
        topic: That both are of.
        stranger: Its global id.
        policy: That differs, or `type`.
    """

    topic: str
    stranger: tuple[int, ...]
    policy: str


class MismatchWatch:
    """Looks twice a second whether everybody on the node's topics is matched, and tells who is not.

    What is seen in two looks in a row is told, once; one that is about to be exchanged needs no
    cure. An endpoint is discovered before the name of its node is, which is waited for.

    Attributes:
        lasting: What has been told and has not changed since, a sentence each.

    Args:
        node: Whose publishers and subscriptions are looked at.
        report: Called with a sentence for each endpoint that cannot match.
        cure: Tells what to do about a topic and one of its policies where that is something else
            than to override the policy; empty where it is not.
    """

    def __init__(self, node: Node, report: Report, cure: Cure = no_cure_of_its_own) -> None:
        self._node = node
        self._report = report
        self._cure = cure
        # How often each has been seen in a row.
        self._seen: dict[_Mismatch, int] = {}
        self._told: dict[_Mismatch, str] = {}
        self.lasting: tuple[str, ...] = ()
        node.create_timer(_PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _look(self) -> None:
        found = dict(self._found())
        self._seen = {one: self._seen.get(one, 0) + 1 for one in found}
        # One that comes back is told again.
        self._told = {one: said for one, said in self._told.items() if one in found}
        for mismatch, sentence in found.items():
            needed = _MOST_UNNAMED if _NOBODY in sentence else 2
            if mismatch not in self._told and self._seen[mismatch] >= needed:
                self._told[mismatch] = sentence
                self._report(sentence)
        self.lasting = tuple(self._told.values())

    def _found(self) -> Iterator[tuple[_Mismatch, str]]:
        node = self._node
        endpoints: list[Publisher | Subscription] = [*node.publishers, *node.subscriptions]
        for endpoint in endpoints:
            topic = endpoint.topic_name
            # Of those that match, nothing else has to be asked.
            if topic == _OF_RCLPY or not self._is_missed(endpoint):
                continue
            publishers = node.get_publishers_info_by_topic(topic)
            subscriptions = node.get_subscriptions_info_by_topic(topic)
            publishes = isinstance(endpoint, Publisher)
            mine, strangers = publishers, subscriptions
            if not publishes:
                mine, strangers = strangers, mine
            me = node.get_fully_qualified_name()
            own = next((one for one in mine if _name_of(one) == me), None)
            if own:
                for stranger in strangers:
                    yield from self._compare(topic, own, stranger, publishes=publishes)

    def _is_missed(self, endpoint: Publisher | Subscription) -> bool:
        """Whether there are more on the other side than an endpoint has been matched with."""
        topic = endpoint.topic_name
        if isinstance(endpoint, Publisher):
            return bool(self._node.count_subscribers(topic) > endpoint.get_subscription_count())
        return bool(self._node.count_publishers(topic) > endpoint.get_publisher_count())

    def _compare(
        self, topic: str, own: TopicEndpointInfo, stranger: TopicEndpointInfo, *, publishes: bool
    ) -> Iterator[tuple[_Mismatch, str]]:
        """One of the node's own endpoints beside one of the other side, as the graph has them."""
        policy = _difference(own, stranger, publishes=publishes)
        if policy is None:
            return
        me, other = _name_of(own), _name_of(stranger)
        if policy == "type":
            they, we = ("takes", "publishes") if publishes else ("publishes", "takes")
            said = f"{other}, which {they} {stranger.topic_type}, but {me} {we} {own.topic_type}"
            cure = "; " + _type_cure(
                topic, own.topic_type, stranger.topic_type, publishes=publishes
            )
        else:
            theirs = _value(stranger.qos_profile, policy)
            mine = _value(own.qos_profile, policy)
            said = f"{other} ({theirs}), but {me} {'offers' if publishes else 'asks for'} {mine}"
            kind = "publisher" if publishes else "subscription"
            cure = self._cure(topic, policy) or (
                f"; change it there, or here with the parameter {PREFIX}{topic}.{kind}.{policy}"
            )
        where = f"{topic} does not reach" if publishes else f"nothing arrives on {topic} from"
        yield _Mismatch(topic, tuple(stranger.endpoint_gid), policy), f"{where} {said}{cure}"


def _type_cure(topic: str, own: str, other: str, *, publishes: bool) -> str:
    """What to do where a topic has messages of two types."""
    if not publishes and (own, other) == (_RAW, _COMPRESSED):
        base = topic.removesuffix("/compressed")
        remapping = "" if base == topic else f" -r image:={base}"
        return f"take them with -p image_transport:=compressed{remapping}"
    return "remap one of the two" if publishes else f"publish {own}, or remap one of the two"


def _difference(
    own: TopicEndpointInfo, stranger: TopicEndpointInfo, *, publishes: bool
) -> str | None:
    """What keeps two endpoints from matching, the name of a policy or `type`; None if nothing."""
    if stranger.topic_type != own.topic_type:
        return "type"
    offered, asked = own.qos_profile, stranger.qos_profile
    if not publishes:
        offered, asked = asked, offered
    if _fit(offered, asked):
        return None
    for policy in _POLICIES:
        alone = copy(offered)
        setattr(alone, policy, getattr(asked, policy))
        if not _fit(offered, alone):
            return policy
    return "reliability"


def _fit(offered: QoSProfile, asked: QoSProfile) -> bool:
    compatibility, _ = qos_check_compatible(offered, asked)
    return compatibility != QoSCompatibility.ERROR


def _name_of(endpoint: TopicEndpointInfo) -> str:
    if "UNKNOWN" in endpoint.node_name:
        return _NOBODY
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"


def _value(profile: QoSProfile, policy: str) -> str:
    value = getattr(profile, policy)
    return f"{policy.upper()} {getattr(value, 'name', value)}"
