"""Quality of service: what the node asks for and offers, and what users override of it.

Endpoints have none of rclpy's events by default, which the executor asks for before and after every
message: `graph_watch.py` looks for those that cannot match.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import partial
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

ErrorCallback = Callable[[str], None]

DEFAULT_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
# Whoever comes late hears the last ones too.
LATCHED_QOS = QoSProfile(
    depth=10,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)

OVERRIDE_PREFIX = "qos_overrides."


def subscribe(
    node: Node,
    message_type: Any,
    topic: str,
    callback: Callable[[Any], None],
    *,
    profile: QoSProfile,
    report: ErrorCallback,
    on_mismatch: Callable[[Any], None] | None = None,
    raw: bool = False,
    group: CallbackGroup | None = None,
) -> Subscription:
    """Subscribe with the user's QoS overrides.

    Args:
        node: The node that subscribes.
        message_type: Of the messages.
        topic: Name of the topic.
        callback: Called with each message.
        profile: What is asked of publishers.
        report: Called with a sentence if the overrides are wrong.
        on_mismatch: Called with rclpy's event as soon as a publisher offers less than that.
        raw: Whether the callback gets the messages as the bytes that they came as.
        group: That tells when the executor may take a message, None for always.
    """
    events = SubscriptionEventCallbacks(incompatible_qos=on_mismatch, use_default_callbacks=False)
    create = partial(
        node.create_subscription,
        message_type,
        topic,
        callback,
        event_callbacks=events,
        raw=raw,
        callback_group=group,
    )
    return _create(node, create, topic, entity="subscription", profile=profile, report=report)


def take_pending(subscription: Subscription, most: int | None = None) -> int:
    """Run a subscription's callback with each message that waits for it; how many did.

    The executor takes one message of each subscription at a time, so of two that came before an
    image the second would come after it.

    Args:
        subscription: Whose messages they are.
        most: How many to take; None for all.
    """
    taken = 0
    while taken != most and (message := take_oldest(subscription)) is not None:
        subscription.callback(message)
        taken += 1
    return taken


def take_oldest(subscription: Subscription) -> Any:
    """The message of a subscription that waits longest, None if none waits."""
    with subscription.handle:
        found = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    return None if found is None else found[0]


def advertise(
    node: Node, message_type: Any, topic: str, *, profile: QoSProfile, report: ErrorCallback
) -> Publisher:
    """Publish with the user's QoS overrides; wrong ones are reported."""
    events = PublisherEventCallbacks(use_default_callbacks=False)
    create = partial(node.create_publisher, message_type, topic, event_callbacks=events)
    return _create(node, create, topic, entity="publisher", profile=profile, report=report)


def given_overrides(node: Node) -> set[str]:
    """Names of the QoS overrides that the user gave at start-up."""
    # rclpy has no public way to see an override before it is declared.
    return {name for name in node._parameter_overrides if name.startswith(OVERRIDE_PREFIX)}


def is_overridden(node: Node, topic: str, entity: str, policy: str) -> bool:
    """Whether the user gave a policy of an endpoint at start-up.

    Args:
        node: Of the endpoint.
        topic: Its full name.
        entity: `publisher` or `subscription`.
        policy: Such as `reliability`.
    """
    return f"{OVERRIDE_PREFIX}{topic}.{entity}.{policy}" in given_overrides(node)


def _create(
    node: Node,
    create: Callable[..., Any],
    topic: str,
    *,
    entity: str,
    profile: QoSProfile,
    report: ErrorCallback,
) -> Any:
    """Create an endpoint; overrides that cannot be are reported and left out.

    Only policies that the user overrides become parameters: a declared one would hold the profile
    of the first endpoint for all later ones.
    """
    name = node.resolve_topic_name(topic)
    policies = [
        policy for policy in QoSPolicyKind if is_overridden(node, name, entity, policy.name.lower())
    ]
    # rclpy writes the overrides into the profile that it is given.
    try:
        return create(
            qos_profile=copy(profile), qos_overriding_options=QoSOverridingOptions(policies)
        )
    except Exception as error:
        if not policies:
            raise
        # Each wrong kind of value ends in another exception of rclpy, Exception itself included.
        report(f"the QoS overrides of the {entity} on {name} are wrong and not used: {error}")
        return create(qos_profile=copy(profile))
