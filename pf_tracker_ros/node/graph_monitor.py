"""Faults of the ROS graph around a node: endpoints that cannot match, a second node of its name.

rclpy's event of incompatible QoS tells neither whose endpoint it is nor when it has gone, with Fast
DDS nothing at all of other types, and costs time with each message: the graph is looked at instead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import copy

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from pf_tracker_ros.node.qos import OVERRIDE_PREFIX, ErrorCallback

# Seconds from one look to the next.
_PERIOD = 0.5
# Looks in a row before a report: an endpoint may be about to be exchanged, the name of its node is
# discovered later, and a node that crashed stays in the graph for 20 s.
_LOOKS, _LOOKS_UNNAMED, _LOOKS_NODE = 2, 8, 60
_UNNAMED = "a node"
# Every node publishes it, and rclpy reports its mismatches.
_EVENTS = "/parameter_events"
_RAW, _COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_POLICIES = ("reliability", "durability", "deadline", "liveliness", "liveliness_lease_duration")


class GraphMonitor:
    """Looks at the graph twice a second and reports each lasting fault once.

    Attributes:
        lasting: What has been reported and is still so, a sentence each.

    Args:
        node: Whose publishers, subscriptions and name are looked at.
        report: Called with a sentence for each fault, again where it has been gone.
        cure: Tells by topic and policy what to do where that is something else than to override
            the policy; empty where it is not.
    """

    def __init__(
        self, node: Node, report: ErrorCallback, cure: Callable[[str, str], str] = lambda *_: ""
    ) -> None:
        self._node = node
        self._report = report
        self._cure = cure
        # Looks in a row that found each fault.
        self._looks: dict[str, int] = {}
        self.lasting: tuple[str, ...] = ()
        node.create_timer(_PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _look(self) -> None:
        needed = dict(self._faults())
        self._looks = {fault: self._looks.get(fault, 0) + 1 for fault in needed}
        self.lasting = tuple(one for one, looks in self._looks.items() if looks >= needed[one])
        for fault in self.lasting:
            if self._looks[fault] == needed[fault]:
                self._report(fault)

    def _faults(self) -> Iterator[tuple[str, int]]:
        """Each fault, with the number of looks in a row before its report."""
        node, me = self._node, self._node.get_fully_qualified_name()
        names = node.get_node_names_and_namespaces()
        # A node that has gone may stay among the names for long, but has no publishers any more.
        if names.count((node.get_name(), node.get_namespace())) > 1 and (
            [_name_of(one) for one in node.get_publishers_info_by_topic(_EVENTS)].count(me) > 1
        ):
            yield (
                f"another node is called {me}, too, and what both say is mixed up: end it, or give "
                "this one another name (-r __node:=another_name)",
                _LOOKS_NODE,
            )
        endpoints: list[Publisher | Subscription] = [*node.publishers, *node.subscriptions]
        for topic, publishes in dict.fromkeys(
            (one.topic_name, isinstance(one, Publisher)) for one in endpoints if self._lacks(one)
        ):
            sides = node.get_publishers_info_by_topic, node.get_subscriptions_info_by_topic
            own, others = (side(topic) for side in (sides if publishes else sides[::-1]))
            for mine in [one for one in own if _name_of(one) == me][:1]:
                for other in others:
                    if why := self._mismatch(topic, mine, other, publishes=publishes):
                        yield why, _LOOKS_UNNAMED if _name_of(other) == _UNNAMED else _LOOKS

    def _lacks(self, endpoint: Publisher | Subscription) -> bool:
        """Whether there are more on the other side than an endpoint has been matched with."""
        topic = endpoint.topic_name
        if isinstance(endpoint, Publisher):
            lacking = self._node.count_subscribers(topic) - endpoint.get_subscription_count()
        else:
            lacking = self._node.count_publishers(topic) - endpoint.get_publisher_count()
        return topic != _EVENTS and lacking > 0

    def _mismatch(
        self, topic: str, mine: TopicEndpointInfo, other: TopicEndpointInfo, *, publishes: bool
    ) -> str:
        """Why two endpoints cannot match, and what to do; empty where they can."""
        where = f"{topic} does not reach" if publishes else f"nothing arrives on {topic} from"
        me, them = _name_of(mine), f"{where} {_name_of(other)}"
        if mine.topic_type != other.topic_type:
            they, we = ("takes", "publishes") if publishes else ("publishes", "takes")
            cure = "remap one of the two"
            if not publishes and (mine.topic_type, other.topic_type) == (_RAW, _COMPRESSED):
                base = topic.removesuffix("/compressed")
                remapping = "" if base == topic else f" -r image:={base}"
                cure = f"take them with -p image_transport:=compressed{remapping}"
            elif not publishes:
                cure = f"publish {mine.topic_type}, or {cure}"
            return (
                f"{them}, which {they} {other.topic_type}, but {me} {we} {mine.topic_type}; {cure}"
            )
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
        cure = self._cure(topic, policy) or (
            f"; change it there, or here with the parameter {override}"
        )
        return f"{them} ({theirs}), but {me} {'offers' if publishes else 'asks for'} {ours}{cure}"


def _differing_policy(offered: QoSProfile, asked: QoSProfile) -> str:
    """The first policy that keeps two endpoints from matching, empty if none does."""
    for policy in _POLICIES:
        alone = copy(offered)
        setattr(alone, policy, getattr(asked, policy))
        if qos_check_compatible(offered, alone)[0] == QoSCompatibility.ERROR:
            return policy
    return ""


def _name_of(endpoint: TopicEndpointInfo) -> str:
    if "UNKNOWN" in endpoint.node_name:
        return _UNNAMED
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"
