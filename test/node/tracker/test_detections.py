"""Conversion of vision_msgs detections, those of a detector and of the node."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from pf_tracker_ros.node.tracker.target_subscriptions import DETECTIONS_CLASS
from pf_tracker_ros.targets.detections import detections_from_message


def detection(theta=0.0, hypotheses=()):
    """A box of 20 x 10 px around (30, 40)."""
    center = SimpleNamespace(position=SimpleNamespace(x=30.0, y=40.0), theta=theta)
    results = [
        SimpleNamespace(hypothesis=SimpleNamespace(class_id=label, score=score))
        for label, score in hypotheses
    ]
    return SimpleNamespace(
        bbox=SimpleNamespace(center=center, size_x=20.0, size_y=10.0), results=results
    )


def converted(*detections):
    return detections_from_message(SimpleNamespace(detections=detections))


def test_the_best_hypothesis_is_used():
    detections = converted(
        detection(hypotheses=[("dog", 0.2), ("cat", 0.7), ("cow", 0.1)]), detection()
    )
    assert detections.labels == ("cat", "")
    assert detections.scores.tolist() == [0.7, 1.0]
    assert detections.boxes[0].tolist() == [20.0, 35.0, 20.0, 10.0]
    assert len(converted()) == 0


def test_a_rotated_box_becomes_its_bounding_box():
    quarter = converted(detection(theta=math.pi / 2))
    assert quarter.boxes[0] == pytest.approx([25.0, 30.0, 10.0, 20.0])
    assert np.isfinite(converted(detection(theta=math.nan)).boxes).all()


@pytest.mark.skipif(DETECTIONS_CLASS is None, reason="vision_msgs is not installed")
def test_detections_are_published_with_each_frame(graph, client, images, box):
    received = client.collect(DETECTIONS_CLASS, "pf_tracker/detections")
    graph.tracker(client, preset="li2007", image_reliability="reliable")
    client.show(images[0], client.at(0))
    client.set_parameters(target_box=box)
    client.show(images[0], client.at(1))
    client.wait_for(lambda: len(received) == 2, "detections")
    assert [[one.id for one in message.detections] for message in received] == [[], ["1"]]
