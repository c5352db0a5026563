import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.cdr import (
    deserialize_compressed_image,
    deserialize_image,
    deserialize_polygon,
    header_stamp,
)


@pytest.mark.parametrize("little_endian", [True, False])
@pytest.mark.parametrize("stamp", [0, (2**31 - 1) * 10**9 + 999_999_999])
def test_stamp_is_read_in_either_byte_order(make_message, stamp, little_endian):
    for kind in (
        *("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"),
        "geometry_msgs/msg/PolygonStamped",
    ):
        assert header_stamp(make_message(kind, stamp, little_endian=little_endian)) == stamp


@given(st.binary(max_size=11) | st.binary(min_size=12).filter(lambda data: data[0] != 0))
def test_other_bytes_than_cdr_are_refused(data):
    with pytest.raises(FootageError):
        header_stamp(data)


@pytest.mark.parametrize("little_endian", [True, False])
def test_messages_are_read_as_rosbags_wrote_them(make_stamped, make_polygon, little_endian):
    stamp, order = 12 * 10**9 + 345, {"little_endian": little_endian}
    data = np.arange(24, dtype=np.uint8)
    # Texts of several lengths: the numbers after them are aligned.
    for encoding in ("mono8", "bgr8", "16UC1", "yuv422_yuy2"):
        fields = {"height": 2, "width": 4, "step": 12, "is_bigendian": 1, "data": data}
        message = make_stamped("sensor_msgs/msg/Image", stamp, encoding=encoding, **order, **fields)
        image = deserialize_image(message)
        assert (image.stamp, image.frame_id) == (stamp, "lens")
        assert (image.height, image.width, image.step) == (2, 4, 12)
        assert (image.encoding, image.is_bigendian) == (encoding, 1)
        assert bytes(image.data) == data.tobytes()
    for name in ("", "jpeg", "bgr8; jpeg compressed bgr8"):
        message = make_stamped(
            "sensor_msgs/msg/CompressedImage", stamp, format=name, data=data, **order
        )
        compressed = deserialize_compressed_image(message)
        assert (compressed.stamp, compressed.frame_id) == (stamp, "lens")
        assert compressed.format == name
        assert bytes(compressed.data) == data.tobytes()
    corners = [(1.5, -2.0), (float(np.float32(3.3)), 4.0), (5.0, 6.0)]
    polygon = make_polygon(*corners)
    message = make_stamped("geometry_msgs/msg/PolygonStamped", 7, polygon=polygon, **order)
    assert deserialize_polygon(message) == corners


@pytest.mark.parametrize(
    ("read", "message_type"),
    [
        (deserialize_image, "sensor_msgs/msg/Image"),
        (deserialize_compressed_image, "sensor_msgs/msg/CompressedImage"),
        (deserialize_polygon, "geometry_msgs/msg/PolygonStamped"),
    ],
)
def test_a_truncated_message_is_refused(make_message, read, message_type):
    message = make_message(message_type, 5)
    read(message)
    # rosbags pads the end to four bytes.
    for length in range(len(message) - 3):
        with pytest.raises(FootageError):
            read(message[:length])


@pytest.mark.parametrize("count", [10, 2**32 - 1])
def test_a_false_count_is_refused(make_stamped, make_polygon, count):
    polygon = make_polygon(*[(1, 2)] * 9)
    message = make_stamped("geometry_msgs/msg/PolygonStamped", 7, polygon=polygon)
    told = (9).to_bytes(4, "little")
    assert message.count(told) == 1
    with pytest.raises(FootageError, match="truncated, or not of its topic's type"):
        deserialize_polygon(message.replace(told, count.to_bytes(4, "little")))
