"""Images of several cameras on one topic, and targets in another frame than the images."""

import pytest
from geometry_msgs.msg import PointStamped, PolygonStamped
from nodes import QUICK
from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.messages import box_message
from pf_tracker_ros.node import graph_monitor
from pf_tracker_ros.node.messages import new_message
from pf_tracker_ros.node.tracker import image_subscription


@pytest.fixture(autouse=True)
def _fast_polls(fast_reports, monkeypatch):
    monkeypatch.setattr(graph_monitor, "_PERIOD", 0.02)


def test_a_second_publisher_of_the_images_is_reported_while_it_exists(graph, client, images, capfd):
    graph.tracker(client, **QUICK)
    other = graph.client(namespace="/left")
    second = other.create_publisher(Image, "/image", 10)
    fault = "/image has 2 publishers, '/client' and '/left/client'"
    report = client.report(lambda report: fault in report.message)
    assert report.level == "WARN"
    assert "end all but one, or remap them to topics of their own" in report.message
    assert report.values["last_error"].startswith(fault)
    status = client.show(images[0], client.at(0))
    assert (status.level, status.values["frame"]) == ("WARN", "waiting")
    assert fault in status.message
    assert fault not in client.show(images[1], client.at(1)).message
    other.destroy_publisher(second)
    client.wait_for(lambda: fault not in client.health[-1].message, "the end of the report")
    assert capfd.readouterr().err.count(fault) == 1


def test_a_second_publisher_for_a_moment_is_not_reported(graph, client, monkeypatch):
    """As while a camera restarts."""
    monkeypatch.setattr(graph_monitor, "_PERIOD", 0.1)
    graph.tracker(client, **QUICK)
    other = graph.client(namespace="/left")
    second = other.create_publisher(Image, "/image", 10)
    # A publisher of another type is a mismatch, not a second camera.
    other.create_publisher(CompressedImage, "/image/compressed", 10)
    client.wait_for(lambda: client.count_publishers("/image") == 2, "second publisher")
    before = len(client.health)
    client.wait_for(lambda: len(client.health) >= before + 3, "three reports")
    other.destroy_publisher(second)
    assert not any("publishers" in report.message for report in client.health)


def show_frames(client, images, frame_ids, index):
    """Publish an image for each frame_id; returns the statuses."""
    statuses = []
    for frame_id in frame_ids:
        index += 1
        message = client.message(images[index % 20], client.at(index))
        message.header.frame_id = frame_id
        statuses.append(client.send(message))
    return index, statuses


def test_images_with_two_frame_ids_are_reported_while_they_last(
    graph, client, images, monkeypatch, capfd
):
    monkeypatch.setattr(image_subscription, "_FRAME_ID_WINDOW", 1.0)
    graph.tracker(client, **QUICK)
    fault = "the images on /image have 2 frame_ids, 'left' and 'right'"
    index, shown = 0, []

    def is_reported():
        nonlocal index
        index, statuses = show_frames(client, images, ["left", "right"], index)
        shown.extend(statuses)
        return [report for report in client.health if fault in report.message]

    report = client.wait_for(is_reported, "report")[0]
    assert report.level == "WARN"
    assert "let a single camera publish there, with one frame_id" in report.message
    told = [status for status in shown if fault in status.message]
    assert [status.level for status in told] == ["WARN"]

    def is_over():
        nonlocal index
        index, _ = show_frames(client, images, ["left"], index)
        return fault not in client.health[-1].message

    client.wait_for(is_over, "the end of the report")
    assert capfd.readouterr().err.count(fault) == 1


def test_a_camera_may_change_its_frame_id(graph, client, images, monkeypatch):
    monkeypatch.setattr(graph_monitor, "_PERIOD", 0.1)
    monkeypatch.setattr(image_subscription, "_FRAME_ID_WINDOW", 0.4)
    graph.tracker(client, **QUICK)
    index, _ = show_frames(client, images, ["left"] * 3, 0)
    before = len(client.health)

    def is_over():
        nonlocal index
        index, _ = show_frames(client, images, ["right"], index)
        return len(client.health) >= before + 7

    client.wait_for(is_over, "seven reports")
    assert not any("frame_ids" in report.message for report in client.health)


def target(box, frame_id):
    message = box_message(new_message, PolygonStamped().header, box)
    message.header.frame_id = frame_id
    return message


def click(box, frame_id):
    message = PointStamped()
    message.header.frame_id = frame_id
    message.point.x, message.point.y = box[0] + box[2] / 2, box[1] + box[3] / 2
    return message


@pytest.fixture
def request_target(graph, client, box, send):
    """A function that requests a target by a topic of a new tracker."""
    node = graph.tracker(client, **QUICK)

    def ask(frame_id, message=target, topic="target"):
        send(client, node, f"pf_tracker/{topic}", message(box, frame_id))

    return ask


def test_a_target_in_another_frame_is_refused(client, images, request_target):
    client.show(images[0], client.at(0))
    for index, request in enumerate([(target, "target"), (click, "click")]):
        request_target("map", *request)
        status = client.show(images[index], client.at(2 * index + 1))
        assert (status.level, status.values["frame"]) == ("WARN", ("waiting", "tracked")[index])
        assert (
            "target refused: its frame_id is 'map', but that of the images is 'camera'; send "
            "pixels of these images, with their frame_id or an empty one"
        ) in status.message
        request_target("camera", *request)
        status = client.show(images[index], client.at(2 * index + 2))
        assert status.values["frame"] == "started"


@pytest.mark.parametrize(("of_images", "of_target"), [("camera", ""), ("", "map")])
def test_an_empty_frame_id_is_accepted(client, images, request_target, of_images, of_target):
    index, _ = show_frames(client, images, [of_images], 0)
    request_target(of_target)
    _, (status,) = show_frames(client, images, [of_images], index)
    assert (status.level, status.values["frame"]) == ("OK", "started")
