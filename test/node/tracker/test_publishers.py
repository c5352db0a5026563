"""Topics besides the status: built for subscribers only, overlays in a separate thread."""

import threading

import numpy as np
import pytest
from nodes import corners
from rclpy.publisher import Publisher
from sensor_msgs.msg import Image
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


def test_the_likelihood_is_around_the_box_and_published_only_with_a_subscriber(
    graph, client, images, box
):
    node = graph.tracker(client, target_box=box)
    (publisher,) = [one for one in node.publishers if one.topic.endswith("/likelihood")]
    statuses = client.show_all(images[:3])
    assert not any("likelihood_x" in status.values for status in statuses)

    received = []
    subscription = client.create_subscription(Image, "pf_tracker/likelihood", received.append, 10)
    client.wait_for(
        lambda: publisher.get_subscription_count() and subscription.get_publisher_count(),
        "connection",
    )
    status = client.show(images[3], client.at(3))
    message = client.answer(received, client.at(3))
    assert (message.encoding, message.width, message.height) == ("32FC1", 32, 32)
    values = np.frombuffer(message.data, np.float32).reshape(32, 32)
    row, column = np.unravel_index(np.argmax(values), values.shape)
    x, y, side = (float(status.values[f"likelihood_{name}"]) for name in ("x", "y", "side"))
    center = np.mean(corners(client.box_at(client.at(3))), axis=0)
    peak = np.array([x + (column + 0.5) * side / 32, y + (row + 0.5) * side / 32])
    assert np.abs(peak - center).max() < 6.0
    for cue in ("color_contrast", "correlation_response"):
        at_target, at_second_peak = (
            float(status.values[f"at_{k}_{cue}"]) for k in ("target", "second_peak")
        )
        assert at_second_peak < at_target <= 0.0

    client.destroy_subscription(subscription)
    client.wait_for(lambda: not publisher.get_subscription_count(), "end of the subscription")
    assert "likelihood_x" not in client.show(images[4], client.at(4)).values


def test_the_colors_of_the_target_are_told_from_its_surroundings(graph, client, images, box):
    received = client.collect(Image, "pf_tracker/target_probability")
    node = graph.tracker(client, target_box=box, preset="li2007", particles=50)
    (publisher,) = [one for one in node.publishers if one.topic.endswith("/target_probability")]
    client.wait_for(publisher.get_subscription_count, "connection")
    client.show_all(images[:3])
    message = client.answer(received, client.at(2))
    assert message.encoding == "mono8"
    probability = np.frombuffer(message.data, np.uint8).reshape(message.height, message.width)
    assert probability[message.height // 4 : -message.height // 4].mean() > 0.7 * 255


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
