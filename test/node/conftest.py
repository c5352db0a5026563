"""Real nodes over real DDS: a tracker in a thread or a process, and its client."""

import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from array import array
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point32, PolygonStamped
from nodes import DEADLINE, SpunNode, overrides, set_stamp, stamp_of
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, PointCloud2

from pf_tracker_ros.node import graph_monitor, health_topic
from pf_tracker_ros.node.running import spin_until_shutdown
from pf_tracker_ros.node.tracker.tracker_node import TrackerNode
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters

REPOSITORY = Path(__file__).resolve().parents[2]
# Fast DDS reads it once in a process, with the first node.
os.environ.setdefault(
    "FASTRTPS_DEFAULT_PROFILES_FILE", str(Path(__file__).with_name("separate_processes.xml"))
)
PATIENCE = 4.0
# Depth of the subscriptions of a client, which shares its process with the nodes.
_DEPTH = 1000
FRAME_INTERVAL = 40_000_000
FIRST_STAMP = 1_700_000_000_000_000_000
EVERY_TUNABLE = declarations(TrackerParameters)
# Parameters that rclpy declares.
RCLPY_PARAMETERS = {"use_sim_time", "start_type_description_service"}


@dataclass(frozen=True)
class Status:
    stamp: int
    name: str
    level: str
    message: str
    values: dict
    targets: tuple = ()


def _image_message(image, stamp=0, encoding="bgr8"):
    """An image message without padding, built without the project's own code."""
    message = Image(height=image.shape[0], width=image.shape[1], encoding=encoding)
    message.step = image[0].nbytes
    message.data = array("B", image.tobytes())
    message.header.frame_id = "camera"
    set_stamp(message.header, stamp)
    return message


class Client(SpunNode):
    """Publishes images and targets for a tracker, and stores its messages."""

    def __init__(
        self, context, *, particles=False, overlay=False, reliability="RELIABLE", namespace=""
    ):
        super().__init__("client", context, namespace=namespace)
        self.statuses, self.boxes, self.particles, self.overlays = [], [], [], []
        profile = QoSProfile(depth=10, reliability=ReliabilityPolicy[reliability])
        self.images = self.create_publisher(Image, "image", profile)
        # With a full history, Fast DDS requests an acknowledgment with each message, otherwise
        # every three seconds.
        self.targets = self.create_publisher(PolygonStamped, "pf_tracker/target", 1)
        subscriptions = [
            (DiagnosticArray, "status", lambda message: self.statuses.append(_parsed(message))),
            (PolygonStamped, "box", self.boxes.append),
        ]
        if particles:
            subscriptions.append((PointCloud2, "particles", self.particles.append))
        if overlay:
            subscriptions.append((Image, "overlay", self.overlays.append))
        # Latched as the status: another subscriber may lose messages of a latched publisher during
        # the discovery.
        latched = QoSProfile(
            depth=_DEPTH,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
        )
        for message_type, name, callback in subscriptions:
            profile = latched if name == "status" else _DEPTH
            self.create_subscription(message_type, f"pf_tracker/{name}", callback, profile)
        self.health = []
        self.create_subscription(
            DiagnosticArray,
            "/diagnostics",
            lambda message: self.health.append(_parsed(message)),
            10,
        )
        self.parameters = AsyncParameterClient(self, "pf_tracker")
        self._tracker_services = Services(self, "pf_tracker", self.wait_for)

    @staticmethod
    def at(index):
        """The stamp of a frame by its index, counted from 0, at an even rate."""
        return FIRST_STAMP + round(index * FRAME_INTERVAL)

    message = staticmethod(_image_message)

    def send(self, message):
        """Publish an image message and return its status."""
        stamp, before = stamp_of(message.header), len(self.statuses)
        self.images.publish(message)

        def found():
            return [status for status in self.statuses[before:] if status.stamp == stamp]

        return self.wait_for(found, f"status for stamp {stamp}")[0]

    def meet(self):
        """Wait for a tracker in a process; it refuses the image that is sent for it."""
        ping = self.message(np.zeros((1, 1), np.uint8), 1, "ping")

        def is_connected():
            self.images.publish(ping)
            return self.statuses and self.targets.get_subscription_count()

        self.wait_for(is_connected, "status of the process")
        # A node discovers the endpoints of another in the order of their creation: one that
        # responds to the client of the parameters has discovered the subscriptions before it.
        self.get_parameters("particles")

    def show(self, image, stamp, encoding="bgr8"):
        """Publish an image and return its status."""
        return self.send(self.message(image, stamp, encoding))

    def show_all(self, images, encoding="bgr8"):
        """Publish images one interval apart and return their statuses."""
        return [self.show(image, self.at(i), encoding) for i, image in enumerate(images)]

    def show_until(self, condition, images, first=0):
        """Publish images in turn, one interval apart, until `condition(status)`; return its value.

        Args:
            first: Index of the first frame.
        """
        indices = itertools.count(first)

        def shown():
            index = next(indices)
            return condition(self.show(images[index % len(images)], self.at(index)))

        return self.wait_for(shown, "such a frame")

    def collect(self, message_type, topic):
        """The list of all messages that arrive on a topic."""
        messages = []
        self.create_subscription(message_type, topic, messages.append, _DEPTH)
        return messages

    def report(self, condition):
        """Wait for a report on /diagnostics that fulfills a condition, the first one if several."""

        def found():
            return [report for report in self.health if condition(report)]

        return self.wait_for(found, "such diagnostics")[0]

    def point_at(self, box, stamp=0):
        """Send a target given by two opposite corners."""
        x, y, width, height = (float(value) for value in box)
        self.send_target([(x, y), (x + width, y + height)], stamp)

    def send_target(self, points, stamp=0):
        message = PolygonStamped()
        set_stamp(message.header, stamp)
        message.polygon.points = [Point32(x=float(x), y=float(y)) for x, y in points]
        self.targets.publish(message)
        # The tracker must have it before the next image, which has another topic.
        assert self.targets.wait_for_all_acked(rclpy.duration.Duration(seconds=DEADLINE))

    def box_at(self, stamp):
        """The message with the box of a frame."""
        return self.answer(self.boxes, stamp)

    def answer(self, messages, stamp):
        """The message among `messages` with this stamp, once it arrived."""

        def found():
            return [message for message in messages if stamp_of(message.header) == stamp]

        return self.wait_for(found, f"message for stamp {stamp}")[0]

    def answer_of_array(self, arrays, stamp):
        """The markers of the array among `arrays` with this stamp, once it arrived."""

        def found():
            return [one.markers for one in arrays if stamp_of(one.markers[0].header) == stamp]

        return self.wait_for(found, f"markers for stamp {stamp}")[0]

    def set_parameters(self, **values):
        """Set parameters in one atomic step; double underscores stand for dots."""
        parameters = [
            value
            if isinstance(value, Parameter)
            else Parameter(name.replace("__", "."), value=value)
            for name, value in values.items()
        ]
        return self.call(self.parameters.set_parameters_atomically, parameters).result

    def get_parameters(self, *names):
        """The values of parameters, lists as tuples."""
        values = self.call(self.parameters.get_parameters, list(names)).values
        found = [parameter_value_to_python(value) for value in values]
        return [tuple(value) if isinstance(value, list) else value for value in found]

    def parameter_names(self):
        """The parameters of the node, without those of rclpy."""
        names = self.call(self.parameters.list_parameters).result.names
        return [name for name in names if name not in RCLPY_PARAMETERS]

    def tunables(self):
        """Name to value of the tracker's parameters on the node."""
        names = [name for name in self.parameter_names() if name in EVERY_TUNABLE]
        return dict(zip(names, self.get_parameters(*names), strict=True))

    def call(self, request, *arguments):
        """The response to a request that may arrive more than once."""
        self.wait_for(self.parameters.services_are_ready, "parameter services")
        return _repeated(self.wait_for, partial(request, *arguments))

    def ask(self, service_type, name, **request):
        """The response of a service of the tracker to a request that arrives once."""
        future = self._tracker_services.ask(service_type, name, **request)
        self.wait_for(future.done, f"response of {name}")
        return future.result()


class Services:
    """The services of another node.

    Args:
        node: The client's node.
        name: Name of the other node.
        wait_for: Spins the client's node until a condition is true and returns its value; takes the
            condition and a name.
    """

    def __init__(self, node, name, wait_for):
        self._node, self._name, self._wait_for = node, name, wait_for
        self._clients = {}

    def ask(self, service_type, name, **request):
        """The future of a service's response to a request that arrives once."""
        if name not in self._clients:
            self._clients[name] = self._connected_client(service_type, name)
        self._wait_for(self._clients[name].service_is_ready, f"service {name}")
        return self._clients[name].call_async(service_type.Request(**request))

    def _connected_client(self, service_type, name):
        service = self._node.create_client(service_type, f"{self._name}/{name}")
        # Clients are discovered in the order of their creation: after a response to a later one,
        # this one is discovered, too.
        later = self._node.create_client(GetParameters, f"{self._name}/get_parameters")
        self._wait_for(later.service_is_ready, "parameter service")
        _repeated(self._wait_for, partial(later.call_async, GetParameters.Request()))
        self._node.destroy_client(later)
        return service


def _repeated(wait_for, request):
    """The response to a request that may arrive more than once.

    A service that is ready may not have discovered its client, and its response is lost.
    """
    requested, futures = time.monotonic(), [request()]

    def responses():
        nonlocal requested
        if time.monotonic() - requested > PATIENCE:
            requested = time.monotonic()
            futures.append(request())
        return [future for future in futures if future.done()]

    return wait_for(responses, "response to a request")[0].result()


def _parsed(message):
    own, *targets = (_parsed_one(message.header, status) for status in message.status)
    return replace(own, targets=tuple(targets))


def _parsed_one(header, status):
    levels = {getattr(DiagnosticStatus, level): level for level in ("OK", "WARN", "ERROR", "STALE")}
    return Status(
        stamp=stamp_of(header),
        name=status.name,
        level=levels[status.level],
        message=status.message,
        values={item.key: item.value for item in status.values},
    )


class Graph:
    """The nodes of one test, each with its own context, as if in its own process."""

    def __init__(self, domain):
        self._domain = domain
        self._closing = []

    def client(self, **options):
        client = Client(self.context(), **options)
        self._closing.append(client.close)
        return client

    def tracker(self, client=None, namespace="", cli_args=None, **parameters):
        """Start a tracker in a thread, and wait until it and the client are connected.

        Parameters are start-up overrides, double underscores standing for dots. Many tests repeat
        an image without noise, so images may stand still unless `frozen_after` is given.
        """
        parameters = {"frozen_after": 0.0, **parameters}
        node = TrackerNode(
            context=self.context(),
            namespace=namespace,
            cli_args=cli_args,
            parameter_overrides=overrides(parameters),
        )
        self.run(node)
        if client is not None:
            self.introduce(client, node)
        return node

    def run(self, node):
        """Spin a node with its own context in a thread until the graph is closed."""
        thread = threading.Thread(target=spin_until_shutdown, args=(node,))
        thread.start()

        def close():
            node.context.try_shutdown()
            thread.join(DEADLINE)
            node.destroy_node()

        self._closing.append(close)

    @staticmethod
    def introduce(client, *nodes):
        """Wait until all endpoints of nodes on common topics are connected, as both sides see it.

        A writer may discover its reader before the reader discovers it: best-effort messages are
        lost then. In the other order, all messages are.
        """

        def are_connected():
            return all(_have_met(*pair) for pair in itertools.permutations((client, *nodes), 2))

        client.wait_for(are_connected, "connection of the nodes")

    def process(self, *arguments, module="pf_tracker_ros.node.tracker.tracker_node"):
        """Start a node as a process."""
        process = subprocess.Popen(
            [sys.executable, "-m", module, *(["--ros-args", *arguments] if arguments else [])],
            cwd=REPOSITORY,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
        self._closing.append(lambda: _end(process))
        return process

    def command(self, *command):
        """Start a command as a process."""
        process = subprocess.Popen(
            command, cwd=REPOSITORY, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self._closing.append(lambda: _end(process))
        return process

    def context(self):
        context = Context()
        rclpy.init(context=context, domain_id=self._domain)
        self._closing.append(context.try_shutdown)
        return context

    def close(self):
        for close in reversed(self._closing):
            close()


def _have_met(one, other):
    """Whether the publishers of a node and the subscriptions of another one are connected."""
    publishers, subscriptions = [*one.publishers], [*other.subscriptions]
    shared = {p.topic_name for p in publishers} & {s.topic_name for s in subscriptions}
    return (
        all(p.get_subscription_count() for p in publishers if p.topic_name in shared)
        and all(s.get_publisher_count() for s in subscriptions if s.topic_name in shared)
        # The other side may count a replaced endpoint for a while.
        and _endpoints(one, shared) == _endpoints(other, shared)
    )


def _endpoints(observer, topics):
    """The identifiers of all publishers and subscriptions on topics, as seen by a node."""
    return {
        bytes(information.endpoint_gid)
        for topic in topics
        for information in [
            *observer.get_publishers_info_by_topic(topic),
            *observer.get_subscriptions_info_by_topic(topic),
        ]
    }


def _end(process):
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(5.0)
        except subprocess.TimeoutExpired:
            process.kill()
    process.communicate()


@pytest.fixture
def graph(ros_domain):
    """The test's nodes in their own ROS domain."""
    graph = Graph(ros_domain)
    yield graph
    graph.close()


@pytest.fixture(scope="session")
def services_of():
    """The class `Services`."""
    return Services


@pytest.fixture(scope="session")
def image_message():
    """A function that makes an image message of an array, its stamp and its encoding."""
    return _image_message


@pytest.fixture
def fast_reports(monkeypatch):
    """Nodes in this process report on /diagnostics, and poll the graph, five times as often."""
    monkeypatch.setattr(health_topic, "PERIOD", health_topic.PERIOD / 5)
    monkeypatch.setattr(graph_monitor, "_PERIOD", graph_monitor._PERIOD / 5)


@pytest.fixture
def client(graph):
    """A client."""
    return graph.client()


@pytest.fixture
def images(moving_square):
    """The frames of the moving square."""
    return moving_square.images


@pytest.fixture
def box(moving_square):
    """The moving square's box in the first frame, as a list for a parameter."""
    return [float(value) for value in moving_square.boxes[0]]


@pytest.fixture(scope="session")
def assert_equal_fields():
    """A function that compares two messages of one type, the first as rosbags reads it."""

    def compare(recorded, published):
        for name in published.get_fields_and_field_types():
            one, other = getattr(recorded, name), getattr(published, name)
            if hasattr(other, "get_fields_and_field_types"):
                compare(one, other)
            elif isinstance(one, np.ndarray):
                assert one.tobytes() == bytes(other)
            elif isinstance(other, (list, tuple)):
                assert len(one) == len(other)
                for each, same in zip(one, other, strict=True):
                    compare(each, same)
            elif type(published).__name__ == "ColorRGBA":
                # Single-precision fields, which rosbags returns unrounded.
                assert np.float32(one) == np.float32(other)
            else:
                assert one == other

    return compare
