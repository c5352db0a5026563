"""The replay publisher, and a test node that replaces the tracker."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PolygonStamped
from nodes import SpunNode, overrides
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image
from std_srvs.srv import SetBool

from pf_tracker_ros.node.replay.replay_node import ReplayNode

EVERYTHING = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)


class StandIn(SpunNode):
    """Replaces the tracker: answers each frame with a status, and records all messages.

    Attributes:
        events: ("image", "target", "truth", "clock" or "status", serialized message or stamp).
        ignored: Stamp to the number of copies that still get no status.
    """

    def __init__(self, services_of, context, image_type=Image):
        super().__init__("pf_tracker", context)
        self.replay_services = services_of(self, "/replay", self.spin_until)
        self.events = []
        self.ignored = {}
        self.pending = []
        self.status_publisher = self.create_publisher(DiagnosticArray, "~/status", 10)
        for kind, message_type, topic in (
            ("target", PolygonStamped, "~/target"),
            ("truth", PolygonStamped, "/replay/ground_truth"),
            ("clock", Clock, "/clock"),
        ):
            self.create_subscription(message_type, topic, self.note(kind), EVERYTHING, raw=True)
        self.image_type = image_type

    def listen(self):
        topic = "image" if self.image_type is Image else "image/compressed"
        self.create_subscription(self.image_type, topic, self.on_image, EVERYTHING, raw=True)

    def note(self, kind):
        return lambda message: self.events.append((kind, message))

    def on_image(self, message):
        self.events.append(("image", message))
        self.send_status(deserialize_message(message, self.image_type).header.stamp)

    def send_status(self, stamp):
        nanoseconds = stamp.sec * 10**9 + stamp.nanosec
        if self.ignored.get(nanoseconds, 0) > 0:
            self.ignored[nanoseconds] -= 1
            return
        self.events.append(("status", nanoseconds))
        status = DiagnosticArray()
        status.header.stamp = stamp
        self.pending.append(status)
        self.send_pending()

    def send_pending(self):
        # A frame may arrive before the replay's subscription of the status is discovered.
        while self.pending and self.status_publisher.get_subscription_count():
            self.status_publisher.publish(self.pending.pop(0))

    def seen(self, kind):
        return [content for event, content in self.events if event == kind]

    def stamps(self, kind="image"):
        message_type = {"image": self.image_type, "clock": Clock}.get(kind, PolygonStamped)
        messages = [deserialize_message(message, message_type) for message in self.seen(kind)]
        stamps = [m.clock if kind == "clock" else m.header.stamp for m in messages]
        return [stamp.sec * 10**9 + stamp.nanosec for stamp in stamps]

    def spin_until(self, condition, what=""):
        return self.wait_for(lambda: self.send_pending() or condition(), what)

    def spin_until_ended(self, replay_node):
        """Spin until the replay has ended and its messages have arrived."""
        self.spin_until(lambda: not replay_node.context.ok())
        # Acknowledged messages may not have been taken yet.
        before = None
        while before != len(self.events):
            before = len(self.events)
            self.spinner.spin_once(timeout_sec=0.1)

    def pause(self):
        """Pause the replay; returns the response."""
        future = self.replay_services.ask(SetBool, "pause", data=True)
        self.spin_until(future.done)
        return future.result()

    # A running replay may end before it responds.

    def resume(self):
        """Resume a paused replay; returns the future of the response."""
        return self.replay_services.ask(SetBool, "pause", data=False)

    def set_replay_parameter(self, name, value):
        """Set a parameter of the replay; returns the future of the response."""
        parameters = [Parameter(name, value=value).to_parameter_msg()]
        return self.replay_services.ask(SetParameters, "set_parameters", parameters=parameters)


@pytest.fixture
def stand_in(graph, services_of):
    """A function that starts a `StandIn`."""
    nodes = []

    def make(*arguments):
        nodes.append(StandIn(services_of, graph.context(), *arguments))
        return nodes[-1]

    yield make
    for node in nodes:
        node.close()


@pytest.fixture
def tracker(stand_in):
    """A `StandIn` that listens to raw images."""
    node = stand_in()
    node.listen()
    return node


@pytest.fixture
def replay(graph):
    """Start the replay publisher in a thread with its own context; returns the node."""

    def start(spectator=None, **parameters):
        # On a busy machine a status may be slow; frames must not be sent twice.
        parameters = {"lockstep_timeout": 60.0, **parameters}
        if "source" in parameters:
            parameters["source"] = str(parameters["source"])
        node = ReplayNode(
            spectator=spectator, context=graph.context(), parameter_overrides=overrides(parameters)
        )
        graph.run(node)
        return node

    return start


@pytest.fixture
def replay_process(graph):
    """Start the replay publisher as a process; returns it."""

    def start(**parameters):
        arguments = []
        for name, value in parameters.items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            arguments += ["-p", f"{name}:={text}"]
        return graph.process(*arguments, module="pf_tracker_ros.node.replay.replay_node")

    return start


class Recordings:
    """Messages and bags written without the code under test.

    Attributes:
        message: The fixture `make_stamped`.
        stamps: Stamps of the images in `rows`.
        rows: (topic, type, log time, message): an image for each stamp, recorded 5 ns later.
    """

    def __init__(self, path, make_stamped, make_polygon, write_bag):
        self.path = path
        self.message = make_stamped
        self.make_polygon = make_polygon
        self.write_bag = write_bag
        self.stamps = [2_000_000_000, 2_040_000_000, 2_080_000_000, 2_120_000_000]
        self.rows = [
            ("/eye", "sensor_msgs/msg/Image", stamp + 5, self.image(stamp)) for stamp in self.stamps
        ]

    def image(self, stamp):
        """A small image whose pixels depend on its stamp."""
        return self.message(
            "sensor_msgs/msg/Image",
            stamp,
            height=3,
            width=4,
            encoding="mono8",
            is_bigendian=0,
            step=4,
            data=np.arange(12, dtype=np.uint8) + np.uint8(stamp // 10**7 % 100),
        )

    def polygon(self, stamp):
        shape = self.make_polygon((1.0, 1.0), (2.0, 1.0))
        return self.message("geometry_msgs/msg/PolygonStamped", stamp, polygon=shape)

    def write(self, rows=None):
        """Write rows, by default `rows`, into a bag and return its path."""
        return self.write_bag(self.path, rows or self.rows)


@pytest.fixture
def recordings(tmp_path, make_stamped, make_polygon, write_bag):
    return Recordings(tmp_path / "bag", make_stamped, make_polygon, write_bag)


@dataclass(frozen=True)
class Pictures:
    """A folder of six images, and their stamps at 25 Hz from 1 s on."""

    folder: Path
    stamps: list


@pytest.fixture
def pictures(tmp_path):
    folder = tmp_path / "pictures"
    folder.mkdir()
    generator = np.random.default_rng(3)
    for index in range(6):
        picture = generator.integers(0, 256, (20, 30, 3), dtype=np.uint8)
        assert cv2.imwrite(str(folder / f"{index}.png"), picture)
    return Pictures(folder, [1_000_000_000 + index * 40_000_000 for index in range(6)])
