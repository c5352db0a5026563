"""Messages published for each kind of source."""

import cv2
import numpy as np
import pytest
from geometry_msgs.msg import PolygonStamped
from rclpy.qos import ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CompressedImage, Image


def test_a_bag_is_published_as_recorded_bytes(recordings, tracker, replay):
    node = replay(source=recordings.write(), lockstep=True)
    tracker.spin_until_ended(node)
    assert node.exit_code == 0
    assert tracker.seen("image") == [row[3] for row in recordings.rows]


def test_compressed_images_have_their_own_topic(recordings, stand_in, replay):
    message_type = "sensor_msgs/msg/CompressedImage"
    image = recordings.message(message_type, 7, format="jpeg", data=np.arange(12, dtype=np.uint8))
    path = recordings.write([("/eye/compressed", message_type, 7, image)])
    tracker = stand_in(CompressedImage)
    tracker.listen()
    replay(source=path, lockstep=True)
    tracker.spin_until(lambda: tracker.seen("image"))
    assert tracker.seen("image") == [image]


def test_ground_truth_and_target_of_a_bag_are_published_with_their_frames(
    recordings, tracker, replay
):
    boxes = [recordings.polygon(stamp) for stamp in recordings.stamps[1:]]
    polygon = "geometry_msgs/msg/PolygonStamped"
    rows = recordings.rows + [("/eye/ground_truth", polygon, 9, box) for box in boxes]
    path = recordings.write(rows)
    replay(source=path, lockstep=True, target_from_ground_truth=True)
    tracker.spin_until(lambda: len(tracker.seen("image")) == 4 and len(tracker.seen("truth")) == 3)
    assert tracker.seen("truth") == boxes
    # The first box is for the second frame, and is published before it.
    assert tracker.seen("target") == boxes[:1]
    kinds = [kind for kind, _ in tracker.events if kind in ("image", "target")]
    assert kinds == ["image", "target", "image", "image", "image"]


def test_a_sequence_is_published_with_boxes_and_target(moving_square_sequence, tracker, replay):
    replay(
        source=moving_square_sequence,
        lockstep=True,
        target_from_ground_truth=True,
        frame_id="lens",
        frame_rate=10.0,
    )
    tracker.spin_until(
        lambda: len(tracker.seen("image")) == 20 and len(tracker.seen("truth")) == 20
    )
    stamps = [1_000_000_000 + index * 100_000_000 for index in range(20)]
    assert tracker.stamps() == tracker.stamps("truth") == stamps
    assert tracker.stamps("target") == stamps[:1]
    first = tracker.events[0][0]
    assert first == "target"
    target = deserialize_message(tracker.seen("target")[0], PolygonStamped)
    corners = [(point.x, point.y) for point in target.polygon.points]
    assert corners == [(20, 30), (44, 30), (44, 54), (20, 54)]
    image = deserialize_message(tracker.seen("image")[0], Image)
    assert (image.header.frame_id, image.encoding, image.step) == ("lens", "bgr8", 480)
    expected = cv2.imread(str(moving_square_sequence / "img" / "0001.png"))
    np.testing.assert_array_equal(
        np.frombuffer(image.data, np.uint8).reshape(120, 160, 3), expected
    )


@pytest.mark.parametrize("reliability", ["reliable", "best_effort"])
def test_the_image_publisher_has_the_requested_reliability(pictures, stand_in, replay, reliability):
    tracker = stand_in()
    replay(source=pictures.folder, start_paused=True, image_reliability=reliability)
    tracker.spin_until(lambda: tracker.count_publishers("/image") == 1)
    (publisher,) = tracker.get_publishers_info_by_topic("/image")
    assert publisher.qos_profile.reliability == ReliabilityPolicy[reliability.upper()]
