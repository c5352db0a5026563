import numpy as np
import pytest

pytest.importorskip("rosbags", reason="a ROS from apt has no rosbags, which bags are written with")

from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability

from pf_tracker_ros.footage import (
    BagWriter,
    FootageError,
    open_bag,
    open_footage,
    read_sequence,
    write_footage,
)


def read_messages(path, topic):
    with AnyReader([path]) as reader:
        connections = [each for each in reader.connections if each.topic == topic]
        return [
            (log_time, reader.deserialize(data, connection.msgtype))
            for connection, log_time, data in reader.messages(connections)
        ]


@pytest.mark.parametrize("name", ["folder", "file.mcap"])
def test_footage_survives_the_round_trip_through_a_bag(tmp_path, pictures, write_video, name):
    footage = open_footage(write_video(tmp_path / "noise.avi", pictures))
    assert write_footage(footage, tmp_path / name) == 5
    messages = read_messages(tmp_path / name, "/image")
    for (log_time, message), frame in zip(messages, footage.frames(), strict=True):
        assert message.encoding == "bgr8"
        assert message.header.frame_id == "camera"
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        assert stamp == log_time == frame.stamp
        image = message.data.reshape(message.height, message.step // 3, 3)
        np.testing.assert_array_equal(image, frame.image)


@pytest.mark.parametrize(("bit_depth", "encoding"), [(np.uint8, "mono8"), (np.uint16, "mono16")])
def test_gray_is_written_with_its_depth(tmp_path, write_images, bit_depth, encoding):
    picture = np.linspace(0, np.iinfo(bit_depth).max, 12, dtype=bit_depth).reshape(3, 4)
    footage = open_footage(write_images(tmp_path / "img", {"1.png": picture}))
    write_footage(footage, tmp_path / "bag.mcap")
    ((_, message),) = read_messages(tmp_path / "bag.mcap", "/image")
    assert (message.encoding, message.is_bigendian) == (encoding, 0)
    pixels = message.data.view("u1" if bit_depth == np.uint8 else "<u2")
    np.testing.assert_array_equal(pixels.reshape(3, 4), picture)


def test_ground_truth_is_written_as_polygons_unless_absent(tmp_path, pictures, write_sequence):
    boxes = np.array([(1, 2, 3, 4), (np.nan,) * 4, (5, 6, 7, 8)])
    walk = write_sequence("walk", pictures[:3], boxes)
    assert write_footage(read_sequence(walk), tmp_path / "bag") == 3
    polygons = [message for _, message in read_messages(tmp_path / "bag", "/ground_truth")]
    corners = [[(p.x, p.y) for p in polygon.polygon.points] for polygon in polygons]
    assert corners == [[(1, 2), (4, 2), (4, 6), (1, 6)], [(5, 6), (12, 6), (12, 14), (5, 14)]]
    found = [image.ground_truth is not None for image in open_bag(tmp_path / "bag").images()]
    assert found == [True, False, True]


def test_the_qos_profile_is_recorded(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/image", "sensor_msgs/msg/Image")
    with AnyReader([tmp_path / "bag"]) as reader:
        (connection,) = reader.connections
    (profile,) = connection.ext.offered_qos_profiles
    assert profile.reliability == QosReliability.RELIABLE
    assert profile.durability == QosDurability.VOLATILE
    assert profile.depth == 10


@pytest.mark.parametrize("name", ["bag", "bag.mcap"])
def test_nothing_is_overwritten(tmp_path, name):
    (tmp_path / name).write_text("precious")
    with pytest.raises(FootageError, match="exists already"):
        BagWriter(tmp_path / name)
    assert (tmp_path / name).read_text() == "precious"


@pytest.mark.parametrize("name", ["bag", "bag.mcap"])
def test_a_failed_recording_leaves_nothing_behind(tmp_path, monkeypatch, name):
    def fail():
        with BagWriter(tmp_path / name) as writer:
            writer.add_topic("/image", "sensor_msgs/msg/Image")
            writer.write_image("/image", 5, np.zeros((2, 2), np.uint8))
            raise RuntimeError("the power went out")

    with pytest.raises(RuntimeError, match="power"):
        fail()
    assert list(tmp_path.iterdir()) == []

    def full(self):
        raise OSError("no space left")

    monkeypatch.setattr("rosbags.rosbag2.Writer.open", full)
    with pytest.raises(OSError, match="no space"), BagWriter(tmp_path / name):
        pass
    assert list(tmp_path.iterdir()) == []
