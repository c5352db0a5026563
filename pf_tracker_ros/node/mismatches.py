"""Publishers and subscriptions of one topic that can never match: who they are, and what to do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import copy
from typing import NamedTuple

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration, Infinite
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from pf_tracker_ros.node.qos import PREFIX, Report

# Seconds from one look to the next.
_PERIOD = 0.5
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

    What is seen in two looks in a row is told, once: an endpoint is discovered before the name of
    its node is, and one that is about to be exchanged needs no cure.

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
        self._seen: set[_Mismatch] = set()
        self._told: set[_Mismatch] = set()
        node.create_timer(_PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _look(self) -> None:
        found = dict(self._found())
        for mismatch, sentence in found.items():
            if mismatch in self._seen and mismatch not in self._told:
                self._told.add(mismatch)
                self._report(sentence)
        self._seen = set(found)
        # One that comes back is told again.
        self._told &= self._seen

    def _found(self) -> Iterator[tuple[_Mismatch, str]]:
        node = self._node
        for publisher in node.publishers:
            topic = publisher.topic_name
            # Of those that match, nothing else has to be asked.
            if node.count_subscribers(topic) > publisher.get_subscription_count():
                for stranger in node.get_subscriptions_info_by_topic(topic):
                    yield from self._compare(publisher, stranger)
        for subscription in node.subscriptions:
            topic = subscription.topic_name
            if node.count_publishers(topic) > subscription.get_publisher_count():
                for stranger in node.get_publishers_info_by_topic(topic):
                    yield from self._compare(subscription, stranger)

    def _compare(
        self, own: Publisher | Subscription, stranger: TopicEndpointInfo
    ) -> Iterator[tuple[_Mismatch, str]]:
        publishes = isinstance(own, Publisher)
        policy = _difference(own, stranger)
        if policy is None:
            return
        topic, other = own.topic_name, _name_of(stranger)
        me = self._node.get_fully_qualified_name()
        if policy == "type":
            they, i = ("takes", "publishes") if publishes else ("publishes", "takes")
            said = f"{other}, which {they} {stranger.topic_type}, but {me} {i} {_type_of(own)}"
            cure = "; remap one of the two"
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


def _difference(own: Publisher | Subscription, stranger: TopicEndpointInfo) -> str | None:
    """What keeps two endpoints from matching, the name of a policy or `type`; None if nothing."""
    if stranger.topic_type != _type_of(own):
        return "type"
    offered, asked = own.qos_profile, stranger.qos_profile
    if not isinstance(own, Publisher):
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
    compatibility, _ = qos_check_compatible(_plain(offered), _plain(asked))
    return compatibility != QoSCompatibility.ERROR


def _plain(profile: QoSProfile) -> QoSProfile:
    """A profile with the times that last for ever left out: the check takes them for a wish."""
    plain = copy(profile)
    for name in ("deadline", "liveliness_lease_duration"):
        if getattr(plain, name) == Infinite:
            setattr(plain, name, Duration())
    return plain


def _type_of(endpoint: Publisher | Subscription) -> str:
    """The name of its messages' type, such as `sensor_msgs/msg/Image`."""
    kind: type = endpoint.msg_type  # type: ignore[assignment]
    package, folder, *_ = kind.__module__.split(".")
    return f"{package}/{folder}/{kind.__name__}"


def _name_of(endpoint: TopicEndpointInfo) -> str:
    if "UNKNOWN" in endpoint.node_name:
        return "a node"
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"


def _value(profile: QoSProfile, policy: str) -> str:
    value = getattr(profile, policy)
    return f"{policy.upper()} {getattr(value, 'name', value)}"
