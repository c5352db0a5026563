"""Topics besides the status: built for subscribers only, overlays in a separate thread."""

import threading

import pytest
from rclpy.publisher import Publisher
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from pf_tracker_ros import MultiTracker, topics
from pf_tracker_ros.node.tracker import publishers
from pf_tracker_ros.node.tracker.publishers import FramePublishers, OverlayPublisher
from pf_tracker_ros.topics import FrameResult

DEADLINE = 60.0


def test_only_subscribed_topics_are_built(graph, client, images, box, monkeypatch):
    built = []

    def watch(output):
        def build(*arguments):
            built.append(output.name)
            return output.build(*arguments)

        return output._replace(build=build)

    watched = [watch(output) for output in topics.OUTPUT_TOPICS]
    monkeypatch.setattr(publishers, "OUTPUT_TOPICS", watched)
    node = graph.client(namespace="/publishing")
    outputs = FramePublishers(node, pytest.fail)
    tracker = MultiTracker.from_preset("li2007")
    tracker.start(images[0], box)
    (target,) = tracker.targets
    result = FrameResult(targets=(target,), selected=target.id, image=images[0])

    def show():
        outputs.publish(Header(frame_id="camera"), result)
        outputs.publish_visualizations(Header(frame_id="camera"), result)

    show()
    assert built == []
    (publisher,) = (one for one in node.publishers if one.topic.endswith("boxes"))
    received = client.collect(MarkerArray, publisher.topic_name)
    graph.introduce(client, node)
    show()
    client.wait_for(lambda: received, "boxes")
    assert built == ["boxes"]
    outputs.close()


def test_primary_topics_precede_visualizations(graph, images, box, monkeypatch):
    client = graph.client(particles=True)
    node = graph.tracker(client, target_box=box)
    published = []
    publish = Publisher.publish

    def note(publisher, message):
        if publisher in node.publishers:
            published.append(publisher.topic_name.rpartition("/")[2])
        publish(publisher, message)

    monkeypatch.setattr(Publisher, "publish", note)
    client.show(images[0], client.at(0))
    client.wait_for(lambda: client.particles, "particles")
    order = [topic for topic in published if topic in {"box", "status", "particles"}]
    assert order == ["box", "status", "particles"]


class Topic:
    """Stores the published messages."""

    def __init__(self):
        self.published = []

    def publish(self, message):
        self.published.append(message)


def test_the_newest_overlays_wait_while_one_is_drawn():
    topic, reports = Topic(), []
    thread = OverlayPublisher(topic, reports.append)
    started, resume = threading.Event(), threading.Event()

    def slow():
        started.set()
        assert resume.wait(DEADLINE)
        return "slow"

    thread.draw(slow)
    assert started.wait(DEADLINE)
    for number in range(500):
        thread.draw(lambda number=number: number)
    assert thread._executor._work_queue.qsize() == 0
    resume.set()
    thread.close()
    assert topic.published == ["slow", *range(490, 500)]
    assert reports == []


def test_a_failed_overlay_is_reported_and_the_next_one_is_published():
    topic, reports = Topic(), []
    thread = OverlayPublisher(topic, reports.append)
    thread.draw(lambda: 1 / 0)
    done = threading.Event()
    thread.draw(lambda: (done.set(), "next")[1])
    # It is drawn before the last one is scheduled.
    assert done.wait(DEADLINE)
    thread.draw(lambda: "last")
    thread.close()
    assert topic.published == ["next", "last"]
    assert reports == ["the overlay of a frame was not published: division by zero"]
