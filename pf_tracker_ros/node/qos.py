"""Quality of service (QoS): default profiles of publishers and subscriptions, and user overrides.

Endpoints have no event callbacks by default, because the executor polls them with every message.
`graph_monitor.py` finds incompatible endpoints.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
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

from pf_tracker_ros.node.messages import message_class

ErrorCallback = Callable[[str], None]

DEFAULT_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
# A late subscriber receives the last messages.
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
    on_lost: Callable[[Any], None] | None = None,
    raw: bool = False,
    group: CallbackGroup | None = None,
) -> Subscription:
    """Subscribe with the user's QoS overrides.

    Args:
        node: The subscribing node.
        message_type: Message class.
        topic: Name of the topic.
        callback: Called with each message.
        profile: The requested profile.
        report: Called with a sentence if the overrides are invalid.
        on_mismatch: Called with rclpy's event for a publisher of an incompatible profile.
        on_lost: Called with rclpy's event for messages lost in transport.
        raw: Whether the callback receives serialized messages.
        group: Callback group that decides when the executor takes a message, None for always.
    """
    events = SubscriptionEventCallbacks(
        incompatible_qos=on_mismatch, message_lost=on_lost, use_default_callbacks=False
    )
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


def advertise(
    node: Node, message_type: Any, topic: str, *, profile: QoSProfile, report: ErrorCallback
) -> Publisher:
    """Create a publisher with the user's QoS overrides; invalid ones are reported."""
    events = PublisherEventCallbacks(use_default_callbacks=False)
    create = partial(node.create_publisher, message_type, topic, event_callbacks=events)
    return _create(node, create, topic, entity="publisher", profile=profile, report=report)


def advertise_installed(
    node: Node, message_types: Mapping[str, str], report: ErrorCallback
) -> dict[str, Publisher]:
    """Create publishers below the node's name, without those whose messages are not installed.

    Args:
        node: The publishing node.
        message_types: Name of a topic to `package/msg/Name`.
        report: As for `advertise`.
    """
    publishers = {}
    for name, message_type in message_types.items():
        with suppress(ModuleNotFoundError):
            publishers[name] = advertise(
                node, message_class(message_type), f"~/{name}", profile=DEFAULT_QOS, report=report
            )
    return publishers


def given_overrides(node: Node) -> set[str]:
    """Names of the QoS overrides that the user gave at start-up."""
    # rclpy has no public access to an override before its declaration.
    return {name for name in node._parameter_overrides if name.startswith(OVERRIDE_PREFIX)}


def is_overridden(node: Node, topic: str, entity: str, policy: str) -> bool:
    """Whether the user gave a policy of an endpoint at start-up.

    Args:
        node: Node of the endpoint.
        topic: Full name of its topic.
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
    """Create an endpoint; invalid overrides are reported and ignored.

    Only overridden policies become parameters: a declared one would keep the profile of the first
    endpoint for all later ones.
    """
    name = node.resolve_topic_name(topic)
    policies = [
        policy for policy in QoSPolicyKind if is_overridden(node, name, entity, policy.name.lower())
    ]
    # rclpy writes the overrides into the profile.
    try:
        return create(
            qos_profile=copy(profile), qos_overriding_options=QoSOverridingOptions(policies)
        )
    except Exception as error:
        if not policies:
            raise
        # rclpy raises various exceptions for invalid values, Exception itself included.
        report(f"invalid QoS overrides of the {entity} on {name} are ignored: {error}")
        return create(qos_profile=copy(profile))
