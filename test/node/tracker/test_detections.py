"""Conversion of vision_msgs detections, those of a detector and of the node."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovariance
from std_msgs.msg import Header

from pf_tracker_ros.node.tracker.target_subscriptions import DETECTIONS_CLASS
from pf_tracker_ros.targets.detections import detections_from_message


# The definitions of vision_msgs 4, for machines without it; no other field can be set.
@dataclass(slots=True)
class Point2D:
    x: float = 0.0
    y: float = 0.0


@dataclass(slots=True)
class Pose2D:
    position: Point2D = field(default_factory=Point2D)
    theta: float = 0.0


@dataclass(slots=True)
class BoundingBox2D:
    center: Pose2D = field(default_factory=Pose2D)
    size_x: float = 0.0
    size_y: float = 0.0


@dataclass(slots=True)
class ObjectHypothesis:
    class_id: str = ""
    score: float = 0.0


@dataclass(slots=True)
class ObjectHypothesisWithPose:
    hypothesis: ObjectHypothesis = field(default_factory=ObjectHypothesis)
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)


@dataclass(slots=True)
class Detection2D:
    header: Header = field(default_factory=Header)
    results: list = field(default_factory=list)
    bbox: BoundingBox2D = field(default_factory=BoundingBox2D)
    id: str = ""


@dataclass(slots=True)
class Detection2DArray:
    header: Header = field(default_factory=Header)
    detections: list = field(default_factory=list)


def detection(box=(30.0, 40.0, 20.0, 10.0), theta=0.0, hypotheses=()):
    x, y, width, height = box
    return Detection2D(
        bbox=BoundingBox2D(Pose2D(Point2D(x, y), theta), width, height),
        results=[
            ObjectHypothesisWithPose(ObjectHypothesis(label, score)) for label, score in hypotheses
        ],
    )


def test_the_best_hypothesis_is_used():
    message = Detection2DArray(
        detections=[
            detection(hypotheses=[("dog", 0.2), ("cat", 0.7), ("cow", 0.1)]),
            detection(),
        ]
    )
    detections = detections_from_message(message)
    assert detections.labels == ("cat", "")
    assert detections.scores.tolist() == [0.7, 1.0]
    assert detections.boxes[0].tolist() == [20.0, 35.0, 20.0, 10.0]


def test_a_rotated_box_becomes_its_bounding_box():
    quarter = detections_from_message(Detection2DArray(detections=[detection(theta=math.pi / 2)]))
    assert quarter.boxes[0] == pytest.approx([25.0, 30.0, 10.0, 20.0])
    broken = detections_from_message(Detection2DArray(detections=[detection(theta=math.nan)]))
    assert np.isfinite(broken.boxes).all()


def test_an_empty_message_is_valid():
    assert len(detections_from_message(Detection2DArray())) == 0


def test_detections_are_published_with_each_frame(graph, moving_square):
    if DETECTIONS_CLASS is None:
        pytest.skip("vision_msgs is not installed")
    client = graph.client()
    received = []
    client.create_subscription(DETECTIONS_CLASS, "pf_tracker/detections", received.append, 10)
    box = [float(value) for value in moving_square.boxes[0]]
    graph.tracker(client, preset="li2007", image_reliability="reliable")
    client.show(moving_square.images[0], client.at(0))
    client.set_parameters(target_box=box)
    client.show(moving_square.images[0], client.at(1))
    client.wait_for(lambda: len(received) == 2, "detections")
    assert [[one.id for one in message.detections] for message in received] == [[], ["1"]]
