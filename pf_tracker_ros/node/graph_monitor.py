"""Monitors the ROS graph for incompatible endpoints, a second node of the same name, and others.

rclpy's event of incompatible QoS names neither the other node nor its end, with Fast DDS reports no
other types, and costs time with each message. Polling the graph has none of these faults.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from copy import copy

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from pf_tracker_ros.node.qos import OVERRIDE_PREFIX, ErrorCallback

# Seconds between polls.
_PERIOD = 0.5
# Consecutive polls before a report: an endpoint may be replaced, its node's name is discovered
# later, and a crashed node stays in the graph for 20 s.
_POLLS, _POLLS_UNNAMED, POLLS_NODE = 2, 8, 60
_UNNAMED = "a node"
# Names in a report.
_MAX_LISTED = 4
# Every node publishes it; rclpy reports its mismatches.
_EVENTS = "/parameter_events"
_RAW, _COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_POLICIES = ("reliability", "durability", "deadline", "liveliness", "liveliness_lease_duration")


class GraphMonitor:
    """Polls the graph twice a second and reports each lasting fault once.

    Attributes:
        lasting: The reported faults that persist, a sentence each.

    Args:
        node: The node whose publishers, subscriptions and name are checked.
        report: Called with a sentence for each fault, again if it returns.
        remedy: Returns the remedy for a topic and a policy, where it is not a QoS override; empty
            otherwise.
        further: Returns further faults, each with the consecutive polls before its report.
    """

    def __init__(
        self,
        node: Node,
        report: ErrorCallback,
        remedy: Callable[[str, str], str] = lambda *_: "",
        further: Callable[[], Iterable[tuple[str, int]]] = tuple,
    ) -> None:
        self._node = node
        self._further = further
        self._report = report
        self._remedy = remedy
        # Consecutive polls with each fault.
        self._polls: dict[str, int] = {}
        self.lasting: tuple[str, ...] = ()
        node.create_timer(_PERIOD, self._poll, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _poll(self) -> None:
        needed = dict(self._faults())
        self._polls = {fault: self._polls.get(fault, 0) + 1 for fault in needed}
        self.lasting = tuple(one for one, polls in self._polls.items() if polls >= needed[one])
        for fault in self.lasting:
            if self._polls[fault] == needed[fault]:
                self._report(fault)

    def _faults(self) -> Iterator[tuple[str, int]]:
        """Each fault, with the number of consecutive polls before its report."""
        node, me = self._node, self._node.get_fully_qualified_name()
        names = node.get_node_names_and_namespaces()
        # An ended node may stay among the names for long, but has no publishers.
        if names.count((node.get_name(), node.get_namespace())) > 1 and (
            [node_name_of(one) for one in node.get_publishers_info_by_topic(_EVENTS)].count(me) > 1
        ):
            yield (
                f"another node is named {me}, and the topics of both are mixed: end it, or rename "
                "this one (-r __node:=another_name)",
                POLLS_NODE,
            )
        yield from self._further()
        endpoints: list[Publisher | Subscription] = [*node.publishers, *node.subscriptions]
        for topic, publishes in dict.fromkeys(
            (one.topic_name, isinstance(one, Publisher))
            for one in endpoints
            if self._has_unmatched(one)
        ):
            sides = node.get_publishers_info_by_topic, node.get_subscriptions_info_by_topic
            own, others = (side(topic) for side in (sides if publishes else sides[::-1]))
            for mine in [one for one in own if node_name_of(one) == me][:1]:
                for other in others:
                    if fault := self._mismatch(topic, mine, other, publishes=publishes):
                        yield fault, _POLLS_UNNAMED if node_name_of(other) == _UNNAMED else _POLLS

    def _has_unmatched(self, endpoint: Publisher | Subscription) -> bool:
        """Whether the topic has more endpoints on the other side than are matched."""
        topic = endpoint.topic_name
        if isinstance(endpoint, Publisher):
            unmatched = self._node.count_subscribers(topic) - endpoint.get_subscription_count()
        else:
            unmatched = self._node.count_publishers(topic) - endpoint.get_publisher_count()
        return topic != _EVENTS and unmatched > 0

    def _mismatch(
        self, topic: str, mine: TopicEndpointInfo, other: TopicEndpointInfo, *, publishes: bool
    ) -> str:
        """Why two endpoints cannot match, with the remedy; empty if they can."""
        where = f"{topic} does not reach" if publishes else f"nothing arrives on {topic} from"
        me, them = node_name_of(mine), f"{where} {node_name_of(other)}"
        if mine.topic_type != other.topic_type:
            they, we = ("expects", "publishes") if publishes else ("publishes", "expects")
            remedy = "remap one of the two"
            if not publishes and (mine.topic_type, other.topic_type) == (_RAW, _COMPRESSED):
                base = topic.removesuffix("/compressed")
                remapping = "" if base == topic else f" -r image:={base}"
                remedy = f"receive them with -p image_transport:=compressed{remapping}"
            elif not publishes:
                remedy = f"publish {mine.topic_type}, or {remedy}"
            types = f"{they} {other.topic_type}, but {me} {we} {mine.topic_type}"
            return f"{them}, which {types}; {remedy}"
        profiles = mine.qos_profile, other.qos_profile
        policy = _differing_policy(*(profiles if publishes else profiles[::-1]))
        if not policy:
            return ""
        ours, theirs = (
            f"{policy.upper()} {getattr(value, 'name', value)}"
            for value in (getattr(profile, policy) for profile in profiles)
        )
        override = (
            f"{OVERRIDE_PREFIX}{topic}.{'publisher' if publishes else 'subscription'}.{policy}"
        )
        remedy = self._remedy(topic, policy) or (
            f"; change it there, or here with the parameter {override}"
        )
        return f"{them} ({theirs}), but {me} {'offers' if publishes else 'requests'} {ours}{remedy}"


def _differing_policy(offered: QoSProfile, requested: QoSProfile) -> str:
    """The first incompatible policy of two profiles, empty if they are compatible."""
    for policy in _POLICIES:
        alone = copy(offered)
        setattr(alone, policy, getattr(requested, policy))
        if qos_check_compatible(offered, alone)[0] == QoSCompatibility.ERROR:
            return policy
    return ""


def node_name_of(endpoint: TopicEndpointInfo) -> str:
    """Full name of an endpoint's node, or "a node" before it is discovered."""
    if "UNKNOWN" in endpoint.node_name:
        return _UNNAMED
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"


def surplus_publishers(node: Node, topic: str, message_type: str) -> Iterator[tuple[str, int]]:
    """That a topic with a single source has several publishers, as for `GraphMonitor`.

    Args:
        node: The subscribing node.
        topic: Full name of the topic.
        message_type: Its type, as `sensor_msgs/msg/Image`.
    """
    publishers = [
        node_name_of(one)
        for one in node.get_publishers_info_by_topic(topic)
        if one.topic_type == message_type
    ]
    if len(publishers) > 1:
        yield (
            f"{topic} has {len(publishers)} publishers, {listed(publishers)}; end all but one, or "
            "remap them to topics of their own",
            POLLS_NODE,
        )


def listed(names: Iterable[str]) -> str:
    """Some names in quotes."""
    return " and ".join(f"'{name}'" for name in sorted(names)[:_MAX_LISTED])
