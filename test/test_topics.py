"""The published messages of a frame, as those of rosbags and, with ROS, of rclpy."""

import struct
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from common import make_estimate

from pf_tracker_ros.footage import BagWriter
from pf_tracker_ros.messages import (
    STATUS_TYPE,
    Status,
    box_in_single_precision,
    image_message,
    status_message,
)
from pf_tracker_ros.overlay import target_color
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.topics import OUTPUT_TOPICS, FrameResult
from pf_tracker_ros.tracking.likelihood_map import CueLikelihood, LikelihoodMap

BY_NAME = {output.name: output for output in OUTPUT_TOPICS}


def target(id, state="tracking", box=(10.0, 20.0, 4.0, 6.0), label=""):
    estimate = make_estimate(
        *(box, state, 0.25),
        box_covariance=np.diag([2.0, 3.0, 4.0, 5.0]) + 0.5 * np.eye(4)[[1, 0, 3, 2]],
        particle_boxes=np.array([box, (-1.5, 0.0, 1.0, 3.0)]),
        weights=np.array([0.75, 0.25]),
    )
    return TrackedTarget(id, label, estimate, 2.0, 0.5)


MANY = FrameResult(
    targets=(target(2), target(5, "occluded", label="car"), target(6, "lost")),
    selected=5,
    max_targets=8,
    detector_runs=3,
    image=np.full((40, 60), 9, np.uint8),
    likelihood=LikelihoodMap(
        (1.0, 2.0, 8.0, 8.0), np.array([[-1.0, -2.0]]), (0.0, 0.0, 1.0, 1.0),
        {"hog": CueLikelihood(-0.5, -3.0)},
    ),
)  # fmt: skip
ALONE = FrameResult(targets=(target(3),), selected=3, image=MANY.image)


@pytest.fixture
def writer(tmp_path):
    pytest.importorskip("rosbags")
    with BagWriter(tmp_path / "out.mcap") as writer:
        yield writer


@pytest.fixture
def build(writer):
    """A function that builds the message of a topic."""

    def make(name, result):
        return BY_NAME[name].build(writer.new, writer.header(12_000_000_034, "lens"), result)

    return make


def test_the_box_is_of_the_selected_target_unless_lost(build):
    points = build("box", MANY).polygon.points
    corners = [(10, 20), (14, 20), (14, 26), (10, 26)]
    assert [(point.x, point.y, point.z) for point in points] == [(*c, 0) for c in corners]
    for lost in (FrameResult(targets=MANY.targets, selected=6), FrameResult(targets=MANY.targets)):
        assert build("box", lost) is None


def test_boxes_are_of_all_targets_that_are_not_lost(build):
    first, *markers = build("boxes", MANY).markers
    assert (first.action, first.header.frame_id, first.header.stamp.nanosec) == (3, "lens", 34)
    assert [(one.ns, one.id, one.type, one.text) for one in markers] == [
        ("boxes", 2, 4, ""),
        ("labels", 2, 9, "2"),
        ("boxes", 5, 4, ""),
        ("labels", 5, 9, "5 car"),
    ]
    line, label, selected, _ = markers
    corners = [(10, 20), (14, 20), (14, 26), (10, 26), (10, 20)]
    assert [(point.x, point.y) for point in line.points] == corners
    assert selected.scale.x > line.scale.x
    assert (selected.color.a, line.color.a) == (0.5, 1.0)
    blue, green, red = target_color(2)
    assert (line.color.r, line.color.g, line.color.b) == (red / 255, green / 255, blue / 255)
    assert (label.pose.position.x, label.pose.position.y, label.scale.z) == (10, 12, 16)
    # Without targets, the markers before are deleted.
    assert [one.action for one in build("boxes", FrameResult(max_targets=2)).markers] == [3]


def test_particles_are_packed_with_the_ids_of_their_targets(build):
    cloud = build("particles", MANY)
    names = ["x", "y", "z", "width", "height", "weight", "id"]
    assert [field.name for field in cloud.fields] == names
    assert [field.offset for field in cloud.fields] == [0, 4, 8, 12, 16, 20, 24]
    assert (cloud.width, cloud.height, cloud.point_step) == (6, 1, 28)
    assert cloud.row_step == len(cloud.data) == 6 * 28
    rows = struct.unpack("=42f", cloud.data.tobytes())
    assert rows[:14] == (12, 23, 0, 4, 6, 0.75, 2, -1.0, 1.5, 0, 1, 3, 0.25, 2)
    assert rows[6::7] == (2, 2, 5, 5, 6, 6)
    assert build("particles", FrameResult()) is None


def test_overlay_and_likelihood_are_images(build):
    overlay = build("overlay", MANY)
    assert (overlay.encoding, overlay.width, overlay.height, overlay.step) == ("bgr8", 60, 40, 180)
    assert overlay.data.tobytes() == MANY.draw().tobytes()
    likelihood = build("likelihood", MANY)
    assert (likelihood.encoding, likelihood.width, likelihood.step) == ("32FC1", 2, 8)
    assert struct.unpack("<2f", likelihood.data.tobytes()) == (-1.0, -2.0)
    assert build("overlay", FrameResult()) is build("likelihood", ALONE) is None
    with pytest.raises(ValueError, match="no image"):
        FrameResult().draw()


def test_the_selected_target_has_a_wider_outline():
    image = np.full((600, 600), 9, np.uint8)
    one = replace(MANY, image=image, targets=(target(2, box=(200.0, 200.0, 90.0, 90.0)),))
    drawn = [(replace(one, selected=id).draw() == target_color(2)).all(axis=2) for id in (0, 2)]
    assert drawn[1].sum() > 1.5 * drawn[0].sum()


def test_there_is_a_status_of_the_selected_and_of_each_target():
    values = MANY.values
    assert (values["targets"], values["selected"], values["detector_runs"]) == (3, 5, 3)
    assert (values["confidence"], values["covariance_xy"], values["particles"]) == (0.25, 0.5, 2)
    likelihood = ("likelihood_x", "at_target_hog", "at_second_peak_hog")
    assert [values[name] for name in likelihood] == [1.0, -0.5, -3.0]
    assert (MANY.state, replace(MANY, selected=0).state) == ("occluded", "tracking")
    statuses = MANY.target_statuses("/ns/tracker")
    assert [(one.name, one.level, one.values["id"]) for one in statuses] == [
        ("/ns/tracker: target 2", 0, 2),
        # Occluded by another target, which is no fault.
        ("/ns/tracker: target 5", 0, 5),
        ("/ns/tracker: target 6", 2, 6),
    ]
    assert "confidence" not in FrameResult().values
    assert FrameResult().state == "idle"


def test_16_bit_images_are_little_endian(writer):
    image = np.array([[1, 256]], ">u2")
    message = image_message(writer.new, writer.header(0), image)
    assert (message.encoding, message.data.tobytes()) == ("mono16", b"\x01\x00\x00\x01")
    assert box_in_single_precision((0.1, 1.0, 2.0, 3.0))[0] == np.float32(0.1)


@pytest.mark.parametrize("result", [MANY, ALONE])
def test_messages_of_rclpy_and_of_a_bag_are_equal(writer, typestore, result):
    pytest.importorskip("rclpy")
    from rclpy.serialization import serialize_message
    from std_msgs.msg import Header

    from pf_tracker_ros.node.messages import new_message

    def assert_same(kind, build):
        theirs, ours = build(new_message, header), build(writer.new, own)
        assert (theirs is None) == (ours is None)
        if ours is not None:
            # Converted by one library, because padding bytes are arbitrary.
            read = typestore.deserialize_cdr(serialize_message(theirs), kind)
            octets = [bytes(typestore.serialize_cdr(one, kind)) for one in (read, ours)]
            assert octets[0] == octets[1]

    header = Header(frame_id="lens")
    header.stamp.sec, header.stamp.nanosec = 12, 34
    own = writer.header(12_000_000_034, "lens")
    for output in OUTPUT_TOPICS:
        if output.name != "detections":
            assert_same(output.message_type, lambda new, its, o=output: o.build(new, its, result))
    statuses = [Status("/tracker", 2, "bad", {"a": 0.1, "b": "c"}), *result.target_statuses("/t")]
    assert_same(STATUS_TYPE, lambda new, its: status_message(new, its, statuses))


def test_detections_are_of_all_targets_that_are_not_lost():
    def new(message_type, /, **fields):
        return SimpleNamespace(kind=message_type, **fields)

    message = BY_NAME["detections"].build(new, "header", MANY)
    assert (message.kind, message.header) == (BY_NAME["detections"].message_type, "header")
    found = [(one.id, one.results[0].hypothesis.class_id) for one in message.detections]
    assert found == [("2", "target"), ("5", "car")]
    one = message.detections[0]
    assert (one.kind, one.header) == ("vision_msgs/msg/Detection2D", "header")
    assert (one.bbox.center.position.x, one.bbox.center.position.y) == (12.0, 23.0)
    assert (one.bbox.size_x, one.bbox.size_y) == (4.0, 6.0)
    (result,) = one.results
    assert result.hypothesis.score == 0.25
    assert (result.pose.pose.position.x, result.pose.pose.position.y) == (12.0, 23.0)
    assert list(result.pose.covariance[:8]) == [2.0, 0.5, 0, 0, 0, 0, 0.5, 3.0]
    vision = pytest.importorskip("vision_msgs.msg")
    from std_msgs.msg import Header

    from pf_tracker_ros.node.messages import new_message

    message = BY_NAME["detections"].build(new_message, Header(frame_id="lens"), MANY)
    assert isinstance(message, vision.Detection2DArray)
    assert [one.id for one in message.detections] == ["2", "5"]
