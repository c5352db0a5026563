"""The node's topics and services: real messages over DDS in, real messages out."""

import itertools
import math
from array import array

import numpy as np
import pytest
from common import box_of
from geometry_msgs.msg import Point, PointStamped
from nodes import NEVER_OCCLUDED as QUICK
from nodes import corners, corners_of
from std_srvs.srv import SetBool, Trigger

from pf_tracker_ros import Tracker
from pf_tracker_ros.targets.track_manager import TrackManager

COVARIANCE = (("xx", "xy"), ("xy", "yy"))


def test_boxes_are_those_of_the_library_fed_with_the_same_frames(graph, client, images, box):
    graph.tracker(client, seed=5, **QUICK)
    stamps = [client.at(0), client.at(1), client.at(1) + 7_000_000, client.at(60)]
    client.point_at(box)
    for image, stamp in zip(images, stamps, strict=False):
        client.show(image, stamp)
    values = {"particles": 20, "track.wrong_box_cost": 0.0}
    tracker = Tracker.from_preset("li2007", seed=5, parameters=values)
    expected = [tracker.start(images[0], box).box]
    for image, (before, after) in zip(images[1:], itertools.pairwise(stamps), strict=False):
        expected.append(tracker.update(image, (after - before) / 1e9).box)
    for stamp, expected_box in zip(stamps, expected, strict=True):
        message = client.box_at(stamp)
        assert corners(message) == corners_of(expected_box)
        assert message.header.frame_id == "camera"


def test_a_status_has_state_and_values_of_every_frame(graph, client, images, box):
    graph.tracker(client, target_box=box, **QUICK)
    for status in client.show_all(images[:4]):
        assert status.name == "/pf_tracker"
        assert (status.level, status.message) == ("OK", "tracking")
        values = status.values
        assert values["state"] == "tracking"
        assert values["preset"] == "li2007, 2 values changed"
        assert values["frame_loss_rate"] == "0.0"
        assert values["last_error"] == ""
        assert 0.0 <= float(values["confidence"]) <= 1.0
        assert int(values["particles"]) == 20
        assert 1.0 <= float(values["effective_sample_size"]) <= 20.0
        covariance = [[float(values[f"covariance_{axes}"]) for axes in row] for row in COVARIANCE]
        assert np.linalg.eigvalsh(covariance).min() >= 0.0
        assert 0.0 < float(values["processing_time_ms"]) < 10_000.0


def test_a_target_waits_for_the_frame_of_its_stamp(graph, client, images, box):
    graph.tracker(client, **QUICK)
    client.point_at(box, stamp=client.at(2))
    statuses = client.show_all(images[:4])
    assert [s.values["frame"] for s in statuses] == ["waiting", "waiting", "started", "tracked"]
    seconds = f"{client.at(2) // 10**9}.{client.at(2) % 10**9:09d}"
    assert seconds in statuses[0].message


# One refused by its message, and one by the image.
REFUSED_TARGETS = (
    ([(10, 10), (math.nan, 30)], "not finite"),
    ([(1000, 10), (1030, 30)], "outside the image"),
)


def test_a_refused_target_has_a_reason_and_keeps_the_last_one(graph, client, images, box):
    graph.tracker(client, target_box=box, **QUICK)
    client.show(images[0], client.at(0))
    for index, (points, reason) in enumerate(REFUSED_TARGETS, start=1):
        client.send_target(points)
        status = client.show(images[index], client.at(index))
        assert status.level == "WARN"
        assert status.message.startswith("target refused: ")
        assert reason in status.message
        assert status.values["last_error"] == status.message
        assert status.values["frame"] == "tracked"
    quiet = client.show(images[3], client.at(3))
    assert (quiet.level, quiet.message) == ("OK", "tracking")


@pytest.fixture
def click(client, send):
    """A function that clicks at a point; the tracker receives it before the next image."""
    return lambda node, x, y: send(
        client, node, "pf_tracker/click", PointStamped(point=Point(x=float(x), y=float(y)))
    )


def test_a_click_starts_on_the_square_around_it(graph, client, images, click):
    node = graph.tracker(client, click_size=20.0, **QUICK)
    click(node, 50, 60)
    assert client.show(images[0], client.at(0)).values["frame"] == "started"
    assert box_of(client.box_at(client.at(0))) == (40, 50, 20, 20)
    client.set_parameters(click_size=30.0)
    click(node, 50, 60)
    client.show(images[0], client.at(1))
    assert box_of(client.box_at(client.at(1))) == (35, 45, 30, 30)


def test_an_invalid_click_is_refused(graph, client, images, click):
    node = graph.tracker(client, **QUICK)
    clicks = [(math.nan, 5, "not finite"), (1, math.inf, "not finite"), (900, 5, "outside")]
    for index, (x, y, reason) in enumerate(clicks):
        click(node, x, y)
        status = client.show(images[0], client.at(index))
        assert (status.level, status.values["state"]) == ("WARN", "idle")
        assert status.message.startswith("target refused: ")
        assert reason in status.message


def test_services_work_before_the_first_image(graph, client, images, box):
    graph.tracker(client, **QUICK)
    assert client.ask(SetBool, "enable", data=True).success
    assert client.ask(SetBool, "enable", data=False).success
    assert client.ask(Trigger, "stop").success
    client.point_at(box)
    assert client.ask(SetBool, "enable", data=True).success
    assert client.show(images[0], client.at(0)).values["frame"] == "started"


def malformed(client, image, stamp):
    """Messages with one fault each, and the node's error."""

    def changed(encoding="bgr8", **fields):
        message = client.message(image, stamp, encoding)
        for name, value in fields.items():
            setattr(message, name, value)
        return message

    yield changed(data=array("B", bytes(10))), "data has 10 bytes"
    yield changed(width=2**32 - 1, step=2**32 - 1), "width is 4294967295 px"
    yield changed("yuv_from_mars"), "encoding is 'yuv_from_mars'; allowed: bgr8"
    yield client.message(image[:60], stamp), "start a target on these images"


def test_malformed_images_are_refused_without_an_effect_on_the_next_one(graph, client, images, box):
    graph.tracker(client, target_box=box, **QUICK)
    client.show(images[0], client.at(0))
    for message, reason in malformed(client, images[1], client.at(0) + 1_000_000):
        status = client.send(message)
        assert status.level == "ERROR"
        assert reason in status.message
        assert status.values["frame"] == "refused"
        assert (status.values["state"], status.values["last_state"]) == ("skipped", "tracking")
        assert "confidence" not in status.values
        assert status.values["last_error"] == status.message
    good = client.show(images[1], client.at(1))
    assert (good.level, good.values["frame"]) == ("OK", "tracked")


def test_after_an_unexpected_error_the_next_frame_is_tracked(
    graph, client, images, box, monkeypatch
):
    graph.tracker(client, target_box=box, **QUICK)
    client.show(images[0], client.at(0))
    monkeypatch.setattr(TrackManager, "update", _failing_once(TrackManager.update))
    status = client.show(images[1], client.at(1))
    assert (status.level, status.values["frame"]) == ("ERROR", "refused")
    assert status.message == "unexpected ZeroDivisionError: by chance"
    status = client.show(images[2], client.at(2))
    assert status.values["frame"] == "tracked"
    assert status.values["last_error"] == "unexpected ZeroDivisionError: by chance"


def _failing_once(update):
    failures = [ZeroDivisionError("by chance")]

    def failing(*arguments, **options):
        if failures:
            raise failures.pop()
        return update(*arguments, **options)

    return failing
