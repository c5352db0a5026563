"""Targets as vision_msgs detections."""

import math
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovariance
from std_msgs.msg import Header

from pf_tracker_ros import Estimate, TrackedTarget
from pf_tracker_ros.node.tracker.detections import DETECTIONS_TYPE, detections_message
from pf_tracker_ros.targets.detections import detections_of


# The definitions of vision_msgs 4, for machines without it: what is not in them cannot be set.
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


DEFINITIONS = SimpleNamespace(
    Detection2D=Detection2D,
    Detection2DArray=Detection2DArray,
    ObjectHypothesisWithPose=ObjectHypothesisWithPose,
)


@pytest.fixture
def estimate():
    return Estimate(
        box=(10.0, 20.0, 30.0, 40.0),
        state="tracking",
        confidence=0.75,
        covariance=np.array([[1.0, 2.0], [2.0, 5.0]]),
        particles=np.zeros((1, 4)),
        particle_boxes=np.zeros((1, 4)),
        weights=np.ones(1),
        effective_sample_size=1.0,
        powers={"color_histogram": 0.75, "gradient_orientation": 0.25},
    )


def test_a_target_is_a_detection_with_its_id(estimate):
    header = Header(frame_id="camera")
    array = detections_message([TrackedTarget(3, "", estimate, 1.0, 0.5)], header, DEFINITIONS)
    (detection,) = array.detections
    assert array.header == detection.header == header
    assert detection.id == "3"
    center = detection.bbox.center.position
    assert (center.x, center.y) == (25.0, 40.0)
    assert (detection.bbox.size_x, detection.bbox.size_y) == (30.0, 40.0)
    (result,) = detection.results
    assert (result.hypothesis.class_id, result.hypothesis.score) == ("target", 0.75)
    assert (result.pose.pose.position.x, result.pose.pose.position.y) == (25.0, 40.0)
    covariance = np.reshape(result.pose.covariance, (6, 6))
    assert covariance[:2, :2].tolist() == [[1.0, 2.0], [2.0, 5.0]]
    assert covariance.sum() == 10.0


def test_without_a_target_there_is_no_detection():
    assert detections_message([], Header(), DEFINITIONS).detections == []


def test_each_of_several_targets_has_its_id_and_label(estimate):
    targets = [
        TrackedTarget(3, "person", estimate, 1.0, 0.5),
        TrackedTarget(7, "", estimate, 1.0, 0.5),
    ]
    array = detections_message(targets, Header(frame_id="camera"), DEFINITIONS)
    assert [one.id for one in array.detections] == ["3", "7"]
    assert [one.results[0].hypothesis.class_id for one in array.detections] == ["person", "target"]
    (back, _) = detections_of(array).boxes.tolist()
    assert tuple(back) == estimate.box


def detection(box=(30.0, 40.0, 20.0, 10.0), theta=0.0, hypotheses=()):
    x, y, width, height = box
    return Detection2D(
        bbox=BoundingBox2D(Pose2D(Point2D(x, y), theta), width, height),
        results=[
            ObjectHypothesisWithPose(ObjectHypothesis(label, score)) for label, score in hypotheses
        ],
    )


def test_the_best_hypothesis_is_what_a_detector_means():
    said = Detection2DArray(
        detections=[
            detection(hypotheses=[("dog", 0.2), ("cat", 0.7), ("cow", 0.1)]),
            detection(),
        ]
    )
    detections = detections_of(said)
    assert detections.labels == ("cat", "")
    assert detections.scores.tolist() == [0.7, 1.0]
    assert detections.boxes[0].tolist() == [20.0, 35.0, 20.0, 10.0]


def test_a_box_that_is_turned_counts_as_its_outline():
    quarter = detections_of(Detection2DArray(detections=[detection(theta=math.pi / 2)]))
    assert quarter.boxes[0] == pytest.approx([25.0, 30.0, 10.0, 20.0])
    broken = detections_of(Detection2DArray(detections=[detection(theta=math.nan)]))
    assert np.isfinite(broken.boxes).all()


def test_no_detections_are_an_answer_too():
    assert len(detections_of(Detection2DArray())) == 0


def test_detections_come_with_each_frame(graph, moving_square):
    if DETECTIONS_TYPE is None:
        pytest.skip("vision_msgs is not installed")
    client = graph.client()
    heard = []
    client.create_subscription(DETECTIONS_TYPE, "pf_tracker/detections", heard.append, 10)
    box = [float(value) for value in moving_square.boxes[0]]
    graph.tracker(client, preset="li2007", image_reliability="reliable")
    client.show(moving_square.images[0], client.at(0))
    client.set_parameters(target_box=box)
    client.show(moving_square.images[0], client.at(1))
    client.wait_for(lambda: len(heard) == 2, "detections")
    assert [[one.id for one in message.detections] for message in heard] == [[], ["1"]]
