"""A detector that starts and corrects the targets of a live node."""

import csv

import numpy as np
import pytest
import rclpy
from common import overlap
from nodes import ids
from rclpy.serialization import serialize_message
from std_srvs.srv import SetBool
from visualization_msgs.msg import MarkerArray

from pf_tracker_ros import Detections
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.node.tracker.target_subscriptions import DETECTIONS_CLASS
from pf_tracker_ros.recordings.__main__ import main
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.presets import preset_parameters

MULTI_TARGET = {"max_targets": 8, "image_reliability": "reliable", "preset": "li2007"}


@pytest.fixture
def start_detector(graph, client, detector):
    """A tracker of several targets: returns a detector and the received boxes."""

    def start(**parameters):
        received = []
        client.create_subscription(MarkerArray, "pf_tracker/boxes", received.append, 100)
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


def test_late_detections_give_the_boxes_of_the_library(client, start_detector, walkers):
    images, boxes = walkers
    detector, received = start_detector(seed=5)
    for number in range(12):
        if number >= 3 and (number - 3) % 4 == 0:
            detector.publish(boxes[number - 3], client.at(number - 3))
        client.show(images[number], client.at(number))
    session = Session(preset_parameters("li2007", MULTI_TARGET["max_targets"]), 5)
    session.frame_buffer.limit(120, 64.0)
    for number in range(12):
        if number >= 3 and (number - 3) % 4 == 0:
            found = Detections(boxes[number - 3], [0.9, 0.9], ["person", "person"])
            session.add_detections(found, client.at(number - 3))
        targets = session.process(Frame(images[number], client.at(number))).targets
        corners = {
            one.id: (one.points[0].x, one.points[0].y, one.points[2].x, one.points[2].y)
            for one in client.answer_of_array(received, client.at(number))
            if one.ns == "boxes"
        }
        expected = {target.id: target.estimate.box for target in targets}
        assert corners == {
            id: (x, y, x + width, y + height) for id, (x, y, width, height) in expected.items()
        }
    assert len(targets) == 2


@pytest.mark.skipif(DETECTIONS_CLASS is None, reason="vision_msgs is not installed")
def test_the_command_track_gives_the_boxes_of_the_node(client, start_detector, walkers, tmp_path):
    images, boxes = walkers
    detector, _ = start_detector(seed=5, max_targets=32)
    received = []
    client.create_subscription(DETECTIONS_CLASS, "pf_tracker/detections", received.append, 100)
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
    with (output / "boxes.csv").open(newline="") as file:
        found = list(csv.DictReader(file))
    for number in range(len(images)):
        published = client.answer(received, client.at(number)).detections
        own = [row for row in found if row["frame"] == str(number) and row["x"]]
        assert [row["id"] for row in own] == [one.id for one in published]
        for row, one in zip(own, published, strict=True):
            x, y, width, height = (float(row[name]) for name in ("x", "y", "width", "height"))
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


def test_the_topic_can_be_remapped(graph, client, walkers, detector):
    node = graph.tracker(
        client, cli_args=["--ros-args", "-r", "detections:=/yolo/detections"], **MULTI_TARGET
    )
    detections = detector(client, node, "yolo/detections")
    assert ids(show_with_detections(client, detections, walkers, range(8))) == [1, 2]


NAN = float("nan")
# (boxes, seconds after the image, error), given the boxes of the walkers.
INVALID = (
    lambda boxes: ([(NAN, 1, 2, 3), *boxes], 0, "1 of 3 detections left out: a box or score"),
    lambda boxes: ([(5, 5, 0, 0), *boxes], 0, "smaller than 2 px"),
    lambda boxes: ([(900, 900, 20, 20), *boxes], 0, "center is outside of the image"),
    lambda boxes: (boxes, 3600, "detections refused: its stamp is 3600 s after"),
    lambda boxes: (boxes, -(10**9), "from another clock"),
    lambda boxes: (boxes, -10, "s old, and frames of the last"),
    lambda boxes: ([boxes[0]] * 10_000, 0, "detections refused: the message has"),
    lambda boxes: ([(10.0 * n, 20.0, 8, 8) for n in range(25)] * 40, 0, "best scores count"),
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


def test_a_repeated_error_is_reported_once(client, start_detector, walkers):
    images, boxes = walkers
    detector, _ = start_detector()
    levels = []
    for number in range(6):
        detector.publish(
            [*boxes[number], *[(900.0 + number, 900.0, 9.0, 9.0)] * number], client.at(number)
        )
        levels.append(client.show(images[number], client.at(number)).level)
    assert levels.count("WARN") == 1


def pause(client, *, paused):
    client.ask(SetBool, "enable", data=not paused)


def test_detections_during_a_long_pause_are_no_fault(client, start_detector, walkers):
    images, boxes = walkers
    detector, _ = start_detector()
    show_with_detections(client, detector, walkers, range(5))
    pause(client, paused=True)
    now = client.at(5)
    for second in range(0, 100, 20):
        now = client.at(5) + second * 10**9
        detector.publish(boxes[5], now)
        status = client.show(images[5], now)
        assert (status.level, status.values["last_error"]) == ("OK", "")
    pause(client, paused=False)
    for number in range(6, 9):
        now += client.at(1) - client.at(0)
        detector.publish(boxes[number], now)
        status = client.show(images[number], now)
        assert (status.level, status.values["last_error"]) == ("OK", "")
        assert "0.0" in [one.values["unconfirmed_for"] for one in status.targets]
    assert len(status.targets) == 2


def test_a_detector_at_best_effort_is_reported(client, graph, detector):
    node = graph.tracker(client, **MULTI_TARGET)
    profile = rclpy.qos.QoSProfile(depth=1, reliability=rclpy.qos.ReliabilityPolicy.BEST_EFFORT)
    client.create_publisher(detector.kind(), "detections", profile)
    image = np.zeros((20, 20), np.uint8)
    frame = 0

    def last_error():
        nonlocal frame
        frame += 1
        return client.show(image, client.at(frame), "mono8").values["last_error"]

    assert "nothing arrives on /detections" in client.wait_for(
        last_error, "a report of the mismatch"
    )
    assert node.count_subscribers("/detections") == 1
