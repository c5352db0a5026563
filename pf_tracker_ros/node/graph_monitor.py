"""Polls the ROS graph for incompatible endpoints, a second node of the same name, and others.

rclpy's event of incompatible QoS names neither the other node nor its end, and no other types.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from copy import copy

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo as Endpoint

from pf_tracker_ros.node.image_topics import COMPRESSED, RAW, subscription_arguments
from pf_tracker_ros.node.qos import OVERRIDE_PREFIX, ErrorCallback

# Seconds between polls.
_PERIOD = 0.5
# Consecutive polls before a report: an endpoint may be replaced, its node's name is discovered
# later, and a crashed node stays in the graph for 20 s.
_POLLS, _POLLS_UNNAMED, _POLLS_NODE = 2, 8, 60
# Every node publishes it; rclpy reports its mismatches.
_EVENTS = "/parameter_events"
_POLICIES = ("reliability", "durability", "deadline", "liveliness", "liveliness_lease_duration")


class GraphMonitor:
    """Polls the graph twice a second and reports each lasting fault once.

    Attributes:
        lasting: The reported faults that persist, a sentence each.

    Args:
        node: The node whose publishers, subscriptions and name are checked.
        report: Called with a sentence for each fault, again if it returns.
        remedy: Returns the remedy for a topic and a policy, empty where it is a QoS override.
        further: Returns further faults, each with the consecutive polls before its report.
    """

    def __init__(
        self,
        node: Node,
        report: ErrorCallback,
        remedy: Callable[[str, str], str] = lambda *_: "",
        further: Callable[[], Iterable[tuple[str, int]]] = tuple,
    ) -> None:
        self._node, self._report, self._remedy, self._further = node, report, remedy, further
        self._me = node.get_fully_qualified_name()
        # Consecutive polls with each fault.
        self._polls: dict[str, int] = {}
        self.lasting: tuple[str, ...] = ()
        node.create_timer(_PERIOD, self._poll, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _poll(self) -> None:
        needed = dict([*self._second_node(), *self._further(), *self._mismatches()])
        self._polls = {fault: self._polls.get(fault, 0) + 1 for fault in needed}
        self.lasting = tuple(one for one, polls in self._polls.items() if polls >= needed[one])
        for fault in self.lasting:
            if self._polls[fault] == needed[fault]:
                self._report(fault)

    def _second_node(self) -> Iterator[tuple[str, int]]:
        # By a service of each: an ended node may stay among the names of nodes for long.
        if self._node.count_services(f"{self._me}/get_parameters") > 1:
            fault = f"another node is named {self._me}, and the topics of both are mixed: end it, "
            yield f"{fault}or rename this one (-r __node:=another_name)", _POLLS_NODE

    def _mismatches(self) -> Iterator[tuple[str, int]]:
        node = self._node
        ends = [(one.topic_name, True, one.get_subscription_count()) for one in node.publishers]
        ends += [(one.topic_name, False, one.get_publisher_count()) for one in node.subscriptions]
        for topic, publishes, matched in ends:
            count = node.count_subscribers if publishes else node.count_publishers
            if topic == _EVENTS or count(topic) <= matched:
                continue
            sides = node.get_publishers_info_by_topic, node.get_subscriptions_info_by_topic
            own, others = (side(topic) for side in (sides if publishes else sides[::-1]))
            mine = [one for one in own if _node_of(one) == self._me]
            for other in others if mine else ():
                if fault := self._mismatch(topic, mine[0], other, publishes=publishes):
                    yield fault, _POLLS_UNNAMED if "UNKNOWN" in other.node_name else _POLLS

    def _mismatch(self, topic: str, mine: Endpoint, other: Endpoint, *, publishes: bool) -> str:
        """Why two endpoints cannot match, with the remedy; empty if they can."""
        where = f"{topic} does not reach" if publishes else f"nothing arrives on {topic} from"
        them = f"{where} {_node_of(other)}"
        types = mine.topic_type, other.topic_type
        if types[0] != types[1]:
            they, we = ("expects", "publishes") if publishes else ("publishes", "expects")
            remedy = f"{'' if publishes else f'publish {types[0]}, or '}remap one of the two"
            if types == (RAW, COMPRESSED) and not publishes:
                remedy = f"receive them with {subscription_arguments(topic, topic, COMPRESSED)}"
            return f"{them}, which {they} {types[1]}, but {self._me} {we} {types[0]}; {remedy}"
        profiles = mine.qos_profile, other.qos_profile
        if not (policy := _differing_policy(*(profiles if publishes else profiles[::-1]))):
            return ""
        values = [getattr(profile, policy) for profile in profiles]
        ours, theirs = (f"{policy.upper()} {getattr(value, 'name', value)}" for value in values)
        offers, side = ("offers", "publisher") if publishes else ("requests", "subscription")
        by_override = f"with the parameter {OVERRIDE_PREFIX}{topic}.{side}.{policy}"
        remedy = self._remedy(topic, policy) or f"change it there, or here {by_override}"
        return f"{them} ({theirs}), but {self._me} {offers} {ours}; {remedy}"


def _differing_policy(offered: QoSProfile, requested: QoSProfile) -> str:
    """The first incompatible policy of two profiles, empty if they are compatible."""
    for policy in _POLICIES:
        alone = copy(offered)
        setattr(alone, policy, getattr(requested, policy))
        if qos_check_compatible(offered, alone)[0] == QoSCompatibility.ERROR:
            return policy
    return ""


def _node_of(endpoint: Endpoint) -> str:
    """Full name of an endpoint's node, or "a node" before it is discovered."""
    if "UNKNOWN" in endpoint.node_name:
        return "a node"
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"


def surplus_publishers(node: Node, topic: str, message_type: str) -> Iterator[tuple[str, int]]:
    """That a topic of a single source has several publishers of a type, for `GraphMonitor`."""
    publishers = node.get_publishers_info_by_topic(topic)
    names = [_node_of(one) for one in publishers if one.topic_type == message_type]
    if len(names) > 1:
        fault = f"{topic} has {len(names)} publishers, {listed(names)}; end all but one, or remap "
        yield f"{fault}them to topics of their own", _POLLS_NODE


def listed(names: Iterable[str]) -> str:
    """Some names in quotes, at most four."""
    return " and ".join(f"'{name}'" for name in sorted(names)[:4])
