"""Topics besides the status: built for subscribers only, overlays in a separate thread."""

import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import Image
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from pf_tracker_ros import MultiTracker, topics
from pf_tracker_ros.node.tracker import publishers
from pf_tracker_ros.topics import FrameResult

DEADLINE = 60.0


@dataclass
class Listener:
    """Subscribes to the topics of another node."""

    node: Node
    executor: SingleThreadedExecutor

    def subscribe(self, publisher, message_type):
        """Subscribe, wait for the connection, and return the list of received messages."""
        received = []
        self.node.create_subscription(message_type, publisher.topic_name, received.append, 100)
        self.wait_for(publisher.get_subscription_count)
        (subscription,) = self.node.subscriptions
        self.wait_for(subscription.get_publisher_count)
        return received

    def wait_for(self, condition):
        for _ in range(int(DEADLINE / 0.02)):
            if condition():
                return
            self.executor.spin_once(timeout_sec=0.02)
        pytest.fail("no message")


@pytest.fixture
def listener(graph):
    node = Node("listener", context=graph.context())
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    yield Listener(node, executor)
    executor.shutdown()
    node.destroy_node()


@pytest.fixture
def publishing_node(graph):
    node = Node("publishing", context=graph.context())
    yield node
    node.destroy_node()


@dataclass
class Outputs:
    """The publishers of a node.

    Attributes:
        publishers: The publishers.
        show: Publishes the result of a frame with one target; takes the frame's name.
        errors: The reported errors.
    """

    publishers: publishers.FramePublishers
    show: Callable[[str], None]
    errors: list


@pytest.fixture
def outputs(publishing_node, images, box):
    errors = []
    made = publishers.FramePublishers(publishing_node, errors.append)
    tracker = MultiTracker.from_preset("li2007")
    tracker.start(images[0], box)
    (target,) = tracker.targets

    def show(name):
        header = Header(frame_id=name)
        result = FrameResult(targets=(target,), selected=target.id, image=images[0])
        made.publish(header, result)
        made.publish_visualizations(header, result)

    yield Outputs(made, show, errors)
    made.close()


@pytest.fixture
def overlays(publishing_node, listener, outputs):
    """The received overlays."""
    (publisher,) = (one for one in publishing_node.publishers if one.topic.endswith("overlay"))
    return listener.subscribe(publisher, Image)


@pytest.fixture
def built(monkeypatch):
    """Names of the topics with a built message, in order."""
    names = []

    def watch(output):
        def build(*arguments):
            names.append(output.name)
            return output.build(*arguments)

        return output._replace(build=build)

    monkeypatch.setattr(
        publishers, "OUTPUT_TOPICS", [watch(output) for output in topics.OUTPUT_TOPICS]
    )
    return names


def test_nothing_is_built_without_subscribers(built, outputs):
    outputs.show("camera")
    assert built == []


def test_only_subscribed_topics_are_built(built, publishing_node, listener, outputs):
    (publisher,) = (one for one in publishing_node.publishers if one.topic.endswith("boxes"))
    received = listener.subscribe(publisher, MarkerArray)
    outputs.show("camera")
    listener.wait_for(lambda: received)
    assert built == ["boxes"]


@pytest.fixture
def slow(monkeypatch):
    """Semaphores (started, resume) around the drawing of each overlay."""
    started, resume = threading.Semaphore(0), threading.Semaphore(0)
    draw = topics.draw_tracked

    def wait_and_draw(*arguments, **options):
        started.release()
        assert resume.acquire(timeout=DEADLINE)
        return draw(*arguments, **options)

    monkeypatch.setattr(topics, "draw_tracked", wait_and_draw)
    return started, resume


def test_an_overlay_does_not_block_the_tracking(outputs, listener, overlays, slow, images):
    started, resume = slow
    outputs.show("camera")
    assert started.acquire(timeout=DEADLINE)
    assert overlays == []
    resume.release()
    listener.wait_for(lambda: overlays)
    assert overlays[0].header.frame_id == "camera"
    drawn = np.frombuffer(overlays[0].data, np.uint8).reshape(images[0].shape)
    assert 0.01 < (drawn != images[0]).any(axis=2).mean() < 0.5


def test_primary_topics_precede_visualizations(graph, images, box, monkeypatch):
    client = graph.client(particles=True)
    node = graph.tracker(client, target_box=box)
    topics = []
    publish = Publisher.publish

    def note(publisher, message):
        if publisher in node.publishers:
            topics.append(publisher.topic_name.rpartition("/")[2])
        publish(publisher, message)

    monkeypatch.setattr(Publisher, "publish", note)
    client.show(images[0], client.at(0))
    client.wait_for(lambda: client.particles, "particles")
    assert [topic for topic in topics if topic in {"box", "status", "particles"}] == [
        "box",
        "status",
        "particles",
    ]
