"""A detector that starts and corrects the targets of a live node."""

import pytest
from common import overlap, read_boxes
from nodes import box_in, ids
from rclpy.serialization import serialize_message
from visualization_msgs.msg import MarkerArray

from pf_tracker_ros.node.tracker.target_subscriptions import DETECTIONS_CLASS
from pf_tracker_ros.recordings.__main__ import main

MULTI_TARGET = {"max_targets": 8, "image_reliability": "reliable", "preset": "li2007"}


@pytest.fixture
def start_detector(graph, client, detector):
    """A tracker of several targets: returns a detector and the received boxes."""

    def start(**parameters):
        received = client.collect(MarkerArray, "pf_tracker/boxes")
        node = graph.tracker(client, **{**MULTI_TARGET, **parameters})
        return detector(client, node), received

    return start


def lines(client, received, stamp):
    """Id to box of the targets in a frame."""
    found = {}
    for one in client.answer_of_array(received, stamp):
        if one.ns == "boxes":
            first, _, opposite, *_ = one.points
            found[one.id] = (first.x, first.y, opposite.x - first.x, opposite.y - first.y)
    return found


def show_with_detections(client, detector, walkers, numbers):
    """Show frames, every fourth with detections."""
    images, boxes = walkers
    for number in numbers:
        if number % 4 == 0:
            detector.publish(boxes[number], client.at(number))
        status = client.show(images[number], client.at(number))
    return status


def test_detections_start_targets_that_are_tracked_in_every_frame(client, start_detector, walkers):
    _, boxes = walkers
    detector, received = start_detector()
    status = show_with_detections(client, detector, walkers, range(14))
    assert (status.level, ids(status)) == ("OK", [1, 2])
    assert [one.values["label"] for one in status.targets] == ["person", "person"]
    assert status.values["detector_runs"] == "4"
    found = lines(client, received, client.at(13))
    assert list(found) == [1, 2]
    for one in found.values():
        assert max(overlap(one, box) for box in boxes[13]) > 0.6


@pytest.mark.skipif(DETECTIONS_CLASS is None, reason="vision_msgs is not installed")
def test_the_command_track_gives_the_boxes_of_the_node(client, start_detector, walkers, tmp_path):
    images, boxes = walkers
    detector, _ = start_detector(seed=5, max_targets=32)
    received = client.collect(DETECTIONS_CLASS, "pf_tracker/detections")
    recorded = []
    for number, image in enumerate(images):
        stamp = client.at(number)
        if number >= 3 and (number - 3) % 4 == 0:
            detections = detector.message(
                boxes[number - 3], client.at(number - 3), ["dog", "cat"], [0.9, 0.4]
            )
            detector.send(detections)
            recorded.append(("/found", "vision_msgs/msg/Detection2DArray", stamp - 5, detections))
        message = client.message(image, stamp)
        client.send(message)
        recorded.append(("/eye", "sensor_msgs/msg/Image", stamp, message))
    bag = write_messages(tmp_path / "drive", recorded)
    output = tmp_path / "out"
    given = ["--detections-topic", "/found", "--seed", "5", "--preset", "li2007"]
    assert main([str(bag), "--output", str(output), *given]) == 0
    found = read_boxes(output)
    for number in range(len(images)):
        published = client.answer(received, client.at(number)).detections
        own = [row for row in found if row["frame"] == str(number) and row["x"]]
        assert [row["id"] for row in own] == [one.id for one in published]
        for row, one in zip(own, published, strict=True):
            x, y, width, height = box_in(row)
            center = one.bbox.center.position
            assert (center.x, center.y) == (x + width / 2, y + height / 2)
            assert (one.bbox.size_x, one.bbox.size_y) == (width, height)
            assert float(row["confidence"]) == one.results[0].hypothesis.score
    assert {row["id"] for row in found} == {"", "1", "2"}


def write_messages(path, messages):
    """Write a bag of (topic, type, log time, message); returns its path."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    with rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        topics = {}
        for topic, kind, log_time, message in messages:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, msgdef=" ", rihs01="none")
            writer.write(topics[topic], log_time, serialize_message(message))
    return path


NAN = float("nan")
# (boxes, seconds after the image, error), given the boxes of the walkers.
INVALID = (
    lambda boxes: ([(NAN, 1, 2, 3), *boxes], 0, "1 of 3 detections left out: a box or score"),
    lambda boxes: (boxes, 3600, "detections refused: its stamp is 3600 s after"),
    lambda boxes: ([boxes[0]] * 10_000, 0, "detections refused: the message has"),
)


def test_invalid_detections_are_reported_once(client, start_detector, walkers):
    images, boxes = walkers
    detector, _ = start_detector()
    show_with_detections(client, detector, walkers, range(8))
    for number, invalid in enumerate(INVALID, start=8):
        given, seconds, error = invalid(boxes[number])
        detector.publish(given, client.at(number) + seconds * 10**9)
        status = client.show(images[number], client.at(number))
        assert (status.level, status.message.count(error)) == ("WARN", 1)
        assert ";" not in status.message.replace(status.values["last_error"], "")
        assert {1, 2} <= {*ids(status)}
