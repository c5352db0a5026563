"""What is published beside the status: only for those who listen, pictures beside the tracking."""

import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from geometry_msgs.msg import PolygonStamped
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
    """Hears what a node publishes, as far as it has subscribed."""

    node: Node
    executor: SingleThreadedExecutor

    def hear(self, publisher, message_type):
        """Subscribe, wait until both sides know each other, and return the list that fills."""
        heard = []
        self.node.create_subscription(message_type, publisher.topic_name, heard.append, 100)
        self.wait_for(publisher.get_subscription_count)
        (subscription,) = self.node.subscriptions
        self.wait_for(subscription.get_publisher_count)
        return heard

    def wait_for(self, condition):
        for _ in range(int(DEADLINE / 0.02)):
            if condition():
                return
            self.executor.spin_once(timeout_sec=0.02)
        pytest.fail("nothing came")


@pytest.fixture
def listener(graph):
    node = Node("listener", context=graph.context())
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    yield Listener(node, executor)
    executor.shutdown()
    node.destroy_node()


@pytest.fixture
def speaker(graph):
    node = Node("speaker", context=graph.context())
    yield node
    node.destroy_node()


@dataclass
class Speaker:
    """The outputs of a node.

    Attributes:
        outputs: Of the node.
        show: Publishes a frame of one target, by the name of the frame.
        errors: That were reported.
    """

    outputs: publishers.FramePublishers
    show: Callable[[str], None]
    errors: list


@pytest.fixture
def one(speaker, images, box):
    errors = []
    made = publishers.FramePublishers(speaker, errors.append)
    tracker = MultiTracker.from_preset("li2007")
    tracker.start(images[0], box)
    (target,) = tracker.targets

    def show(name):
        header = Header(frame_id=name)
        result = FrameResult(targets=(target,), selected=target.id, image=images[0])
        made.publish(header, result)
        made.publish_visualizations(header, result)

    yield Speaker(made, show, errors)
    made.close()


@pytest.fixture
def overlays(speaker, listener, one):
    """The overlays that are heard."""
    (publisher,) = (one for one in speaker.publishers if one.topic.endswith("overlay"))
    return listener.hear(publisher, Image)


@pytest.fixture
def built(monkeypatch):
    """Names of what was built, in order."""
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


def test_nothing_is_built_for_nobody(built, one):
    one.show("camera")
    assert built == []


def test_whoever_listens_hears_the_boxes_alone(built, speaker, listener, one):
    (publisher,) = (one for one in speaker.publishers if one.topic.endswith("boxes"))
    heard = listener.hear(publisher, MarkerArray)
    one.show("camera")
    listener.wait_for(lambda: heard)
    assert built == ["boxes"]


@pytest.fixture
def slow(monkeypatch):
    """Lets pictures be drawn one by one: (begun, go on)."""
    begun, go_on = threading.Semaphore(0), threading.Semaphore(0)
    draw = topics.draw_tracked

    def wait_and_draw(*arguments, **options):
        begun.release()
        assert go_on.acquire(timeout=5.0)
        return draw(*arguments, **options)

    monkeypatch.setattr(topics, "draw_tracked", wait_and_draw)
    return begun, go_on


def test_the_tracking_goes_on_while_an_overlay_is_drawn(one, listener, overlays, slow, images):
    begun, go_on = slow
    one.show("camera")
    assert begun.acquire(timeout=DEADLINE)
    assert overlays == []
    go_on.release()
    listener.wait_for(lambda: overlays)
    assert overlays[0].header.frame_id == "camera"
    drawn = np.frombuffer(overlays[0].data, np.uint8).reshape(images[0].shape)
    assert 0.01 < (drawn != images[0]).any(axis=2).mean() < 0.5


def test_of_too_many_overlays_the_newest_are_drawn(one, listener, overlays, slow):
    begun, go_on = slow
    one.show("first")
    assert begun.acquire(timeout=DEADLINE)
    for number in range(14):
        one.show(str(number))
    # As many messages wait for a listener as overlays for the one who draws: one is heard before.
    go_on.release(1)
    listener.wait_for(lambda: len(overlays) == 1)
    go_on.release(14)
    listener.wait_for(lambda: len(overlays) == 11)
    heard = [message.header.frame_id for message in overlays]
    assert heard == ["first", *(str(number) for number in range(4, 14))]


def test_what_waits_is_published_before_the_topic_goes(one, listener, overlays, slow):
    _, go_on = slow
    for number in range(3):
        one.show(str(number))
    go_on.release(3)
    one.outputs._overlay.close()
    listener.wait_for(lambda: len(overlays) == 3)


def test_an_overlay_that_fails_is_told_with_the_next_one(one, listener, overlays, monkeypatch):
    draw, failed = topics.draw_tracked, threading.Event()

    def fail(*arguments, **options):
        monkeypatch.setattr(topics, "draw_tracked", draw)
        failed.set()
        raise ValueError("no ink")

    monkeypatch.setattr(topics, "draw_tracked", fail)
    one.show("failing")
    assert failed.wait(DEADLINE)
    one.show("next")
    listener.wait_for(lambda: overlays)
    one.show("last")
    assert one.errors == ["the overlay of a frame was not published: no ink"]


def test_a_box_is_heard_by_those_who_listen(built, speaker, listener, one, box):
    (publisher,) = (one for one in speaker.publishers if one.topic.endswith("/box"))
    heard = listener.hear(publisher, PolygonStamped)
    one.show("camera")
    listener.wait_for(lambda: heard)
    assert built == ["box"]
    (message,) = heard
    assert message.header.frame_id == "camera"
    corner = message.polygon.points[0]
    assert (corner.x, corner.y) == pytest.approx(box[:2])


def test_what_is_acted_on_is_out_before_what_is_looked_at(graph, images, box, monkeypatch):
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
