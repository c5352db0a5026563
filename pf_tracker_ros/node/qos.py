"""Quality of service: what the node asks for, what users override, and what does not match."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from copy import copy
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import (
    DurabilityPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
    qos_policy_name_from_kind,
)
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

Report = Callable[[str], None]

DEFAULT_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
# Whoever comes late hears the last ones too.
LATCHED_QOS = QoSProfile(
    depth=10,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)

PREFIX = "qos_overrides."

# A node whose name is not known yet, and what tells it in a list with qualities of service.
_SOME_NODE = "a node"
_UNNAMED = f"{_SOME_NODE} ("
# Seconds between two looks, and how many there are.
_LOOK_AGAIN_AFTER, _MOST_LOOKS = 0.1, 20


def subscribe(
    node: Node,
    message_type: Any,
    topic: str,
    callback: Callable[[Any], None],
    *,
    profile: QoSProfile,
    report: Report,
    reliability_cure: str = "",
    on_unreliable: Callable[[], None] | None = None,
    raw: bool = False,
) -> Subscription:
    """Subscribe with the user's QoS overrides; a publisher that does not match is reported.

    Args:
        node: The node that subscribes.
        message_type: Of the messages.
        topic: Name of the topic.
        callback: Called with each message.
        profile: What is asked of publishers.
        report: Called with a sentence if a publisher offers less.
        reliability_cure: What to do where that is their reliability.
        on_unreliable: Called instead of `report` where it is.
        raw: Whether the callback gets the messages as the bytes that they came as.
    """
    name = node.resolve_topic_name(topic)
    asked = copy(profile)

    def on_mismatch(event: Any) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        if policy == "RELIABILITY" and on_unreliable is not None:
            on_unreliable()
            return
        own = f"{node.get_fully_qualified_name()} asks for {_value(asked, policy)}"
        cure = reliability_cure if policy == "RELIABILITY" else ""
        _report_named(
            node,
            lambda: _names(node.get_publishers_info_by_topic(name), policy, asked),
            lambda others: report(f"nothing arrives on {name} from {others}, but {own}{cure}"),
        )

    events = SubscriptionEventCallbacks(incompatible_qos=on_mismatch)

    def create(options: QoSOverridingOptions | None) -> Subscription:
        return node.create_subscription(
            message_type,
            topic,
            callback,
            asked,
            event_callbacks=events,
            qos_overriding_options=options,
            raw=raw,
        )

    return _with_overrides(node, create, name, "subscription", report)


def take_waiting(subscription: Subscription) -> None:
    """Run a subscription's callback with each message that waits for it.

    The executor takes one message of each subscription at a time, so of two that came before an
    image the second would come after it.
    """
    while (message := take_one(subscription)) is not None:
        subscription.callback(message)


def take_one(subscription: Subscription) -> Any:
    """The message of a subscription that waits longest, None if none waits."""
    with subscription.handle:
        found = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    return None if found is None else found[0]


def advertise(
    node: Node, message_type: Any, topic: str, *, profile: QoSProfile, report: Report
) -> Publisher:
    """Publish with the user's QoS overrides; a subscriber that does not match is reported."""
    name = node.resolve_topic_name(topic)
    offered = copy(profile)

    def on_mismatch(event: Any) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        own = f"{node.get_fully_qualified_name()} offers {_value(offered, policy)}"
        cure = "change it there, or here with the parameter "
        cure += f"{PREFIX}{name}.publisher.{policy.lower()}"
        _report_named(
            node,
            lambda: _names(node.get_subscriptions_info_by_topic(name), policy, offered),
            lambda others: report(f"{name} does not reach {others}, but {own}; {cure}"),
        )

    events = PublisherEventCallbacks(incompatible_qos=on_mismatch)

    def create(options: QoSOverridingOptions | None) -> Publisher:
        return node.create_publisher(
            message_type, topic, offered, event_callbacks=events, qos_overriding_options=options
        )

    return _with_overrides(node, create, name, "publisher", report)


def given_overrides(node: Node) -> set[str]:
    """Names of the QoS overrides that the user gave at start-up."""
    # rclpy has no public way to see an override before it is declared.
    return {name for name in node._parameter_overrides if name.startswith(PREFIX)}


def is_overridden(node: Node, topic: str, entity: str, policy: str) -> bool:
    """Whether the user gave a policy of an endpoint at start-up.

    Args:
        node: Of the endpoint.
        topic: Its full name.
        entity: `publisher` or `subscription`.
        policy: Such as `reliability`.
    """
    return f"{PREFIX}{topic}.{entity}.{policy}" in given_overrides(node)


def _with_overrides(
    node: Node, create: Callable[[Any], Any], topic: str, entity: str, report: Report
) -> Any:
    """Create an endpoint; overrides that cannot be are reported and left out.

    Only policies that the user overrides become parameters: a declared one would hold the profile
    of the first endpoint for all later ones.
    """
    policies = [
        policy
        for policy in QoSPolicyKind
        if is_overridden(node, topic, entity, policy.name.lower())
    ]
    if not policies:
        return create(None)
    try:
        return create(QoSOverridingOptions(policies))
    except Exception as error:
        # Each wrong kind of value ends in another exception of rclpy, Exception itself included.
        report(f"the QoS overrides of the {entity} on {topic} are wrong and not used: {error}")
        return create(None)


def _report_named(node: Node, look: Callable[[], str], report: Report) -> None:
    """Report others by their names, for which it waits up to two seconds.

    An endpoint is discovered before the name of its node is.

    Args:
        node: That has met them.
        look: Tells who they are, as far as that is known.
        report: Called with that.
    """
    others = look()
    if _UNNAMED not in others:
        report(others)
        return
    looks = itertools.count(1)

    def look_again() -> None:
        others = look()
        if _UNNAMED not in others or next(looks) == _MOST_LOOKS:
            node.destroy_timer(timer)
            report(others)

    clock = Clock(clock_type=ClockType.STEADY_TIME)
    timer = node.create_timer(_LOOK_AGAIN_AFTER, look_again, clock=clock)


def _names(endpoints: Iterable[TopicEndpointInfo], policy: str, own: QoSProfile) -> str:
    """The endpoints whose policy differs, with what it is."""
    descriptions = []
    for endpoint in endpoints:
        value = _value(endpoint.qos_profile, policy)
        if value != _value(own, policy):
            descriptions.append(f"{_node_name(endpoint)} ({value})")
    return ", ".join(descriptions) or "a node with another quality of service"


def _node_name(endpoint: TopicEndpointInfo) -> str:
    if "UNKNOWN" in endpoint.node_name:
        return _SOME_NODE
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"


def _value(profile: QoSProfile, policy: str) -> str:
    value = getattr(profile, policy.lower(), None)
    return f"{policy} {getattr(value, 'name', value)}"
