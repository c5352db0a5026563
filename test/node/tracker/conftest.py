"""Footage of several targets, and publishers of requests and detections for live nodes."""

import json
import math

import pytest
from common import two_walkers
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.duration import Duration
from std_msgs.msg import UInt32

from pf_tracker_ros import Detections
from pf_tracker_ros.node.tracker import target_subscriptions, tracker_node
from pf_tracker_ros.node.tracker.target_subscriptions import DETECTIONS_CLASS


@pytest.fixture(autouse=True)
def _fast_reports(fast_reports):
    """No test of the tracker waits for a report of the usual period."""


@pytest.fixture(scope="session")
def walkers():
    """(images, boxes (frames, 2, 4)) of two colored walkers on a textured ground."""
    return two_walkers(200, 320, (40, 120), 250)


def _connected_publisher(client, node, message_type, topic):
    """A client's publisher that is connected with a node, as both sides see it."""
    publisher = client.create_publisher(message_type, topic, 1)
    (subscription,) = [s for s in node.subscriptions if s.topic_name == f"/{topic}"]
    client.wait_for(
        lambda: publisher.get_subscription_count() and subscription.get_publisher_count(), topic
    )
    return publisher


def _send(client, node, topic, message):
    """Publish a message; the tracker receives it before the next image."""
    publisher = _connected_publisher(client, node, type(message), topic)
    publisher.publish(message)
    assert publisher.wait_for_all_acked(Duration(seconds=60))
    client.destroy_publisher(publisher)


@pytest.fixture(scope="session")
def send():
    """A function that publishes a message, received before the next image."""
    return _send


@pytest.fixture(scope="session")
def send_id():
    """A function that publishes an id to a tracker, on `select` or `stop_target`."""

    def publish_id(client, node, topic, id):
        _send(client, node, f"pf_tracker/{topic}", UInt32(data=id))

    return publish_id


class Detector:
    """Publishes detections; the tracker receives them before the next image."""

    def __init__(self, client, node, topic="detections"):
        self._publisher = _connected_publisher(client, node, Detector.kind(), topic)

    @staticmethod
    def kind():
        """The class of the messages."""
        return DETECTIONS_CLASS or DiagnosticArray

    def publish(self, boxes, stamp, labels=None, scores=None):
        self.send(self.message(boxes, stamp, labels, scores))

    def send(self, message):
        self._publisher.publish(message)
        assert self._publisher.wait_for_all_acked(Duration(seconds=60))

    @staticmethod
    def message(boxes, stamp, labels=None, scores=None):
        message = Detector.kind()()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        make = _detection if DETECTIONS_CLASS else _stand_in
        found = [
            make(box, labels[number] if labels else "person", scores[number] if scores else 0.9)
            for number, box in enumerate(boxes)
        ]
        if DETECTIONS_CLASS:
            message.detections = found
        else:
            message.status = found
        return message


def _detection(box, label, score):
    from vision_msgs.msg import Detection2D, ObjectHypothesisWithPose

    x, y, width, height = box
    detection = Detection2D()
    detection.bbox.center.position.x = x + width / 2
    detection.bbox.center.position.y = y + height / 2
    detection.bbox.size_x, detection.bbox.size_y = float(width), float(height)
    result = ObjectHypothesisWithPose()
    result.hypothesis.class_id, result.hypothesis.score = label, score
    detection.results.append(result)
    return detection


def _stand_in(box, label, score):
    finite = [value if math.isfinite(value) else None for value in box]
    return DiagnosticStatus(name=label, message=json.dumps([*finite, score]))


def _detections_of_stand_in(message):
    rows = [json.loads(one.message) for one in message.status]
    numbers = [[math.nan if value is None else value for value in row] for row in rows]
    return Detections(
        [row[:4] for row in numbers],
        [row[4] for row in numbers],
        [one.name for one in message.status],
    )


@pytest.fixture
def detector(monkeypatch):
    """The class `Detector`; without vision_msgs, its messages have a stand-in."""
    if DETECTIONS_CLASS is None:
        monkeypatch.setattr(target_subscriptions, "DETECTIONS_CLASS", DiagnosticArray)
        monkeypatch.setattr(
            target_subscriptions, "detections_from_message", _detections_of_stand_in
        )
        monkeypatch.setattr(tracker_node, "DETECTIONS_CLASS", DiagnosticArray)
    return Detector
