import pytest
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.cdr import header_stamp


@pytest.mark.parametrize("little_endian", [True, False])
@pytest.mark.parametrize("stamp", [0, 1, 1_500_000_007, (2**31 - 1) * 10**9 + 999_999_999])
@pytest.mark.parametrize(
    "message_type",
    [
        "sensor_msgs/msg/Image",
        "sensor_msgs/msg/CompressedImage",
        "geometry_msgs/msg/PolygonStamped",
    ],
)
def test_stamp_is_read_in_either_byte_order(make_message, message_type, stamp, little_endian):
    message = make_message(message_type, stamp, little_endian=little_endian)
    assert header_stamp(message) == stamp


@given(st.binary(max_size=11) | st.binary(min_size=12).filter(lambda data: data[0] != 0))
def test_what_is_not_cdr_is_refused(data):
    with pytest.raises(FootageError):
        header_stamp(data)
