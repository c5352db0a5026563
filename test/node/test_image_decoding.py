from array import array

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import Image

from pf_tracker_ros import Tracker
from pf_tracker_ros.node.image_decoding import ENCODINGS, LARGEST_SIDE, ImageError, decode


def message(data, width, height, step, encoding, *, is_bigendian=0):
    return Image(
        width=width,
        height=height,
        step=step,
        encoding=encoding,
        is_bigendian=is_bigendian,
        data=array("B", data),
    )


def test_rgb8_and_bgr8_of_the_same_colors_decode_alike():
    rgb = decode(message([255, 0, 10, 1, 2, 3], 2, 1, 6, "rgb8"))
    bgr = decode(message([10, 0, 255, 3, 2, 1], 2, 1, 6, "bgr8"))
    assert rgb.tolist() == bgr.tolist() == [[[10, 0, 255], [3, 2, 1]]]


def test_mono8_keeps_its_gray_values():
    image = decode(message([1, 2, 3, 4, 5, 6], 3, 2, 3, "mono8"))
    assert image.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert image.dtype == np.uint8


@pytest.mark.parametrize(("is_bigendian", "data"), [(0, [0x34, 0x12]), (1, [0x12, 0x34])])
def test_mono16_honors_its_byte_order(is_bigendian, data):
    image = decode(message(data, 1, 1, 2, "mono16", is_bigendian=is_bigendian))
    assert image.tolist() == [[0x1234]]
    assert image.dtype == np.uint16
    assert image.dtype.isnative


@pytest.mark.parametrize(("encoding", "pixel_size"), [("bgr8", 3), ("mono8", 1), ("mono16", 2)])
@pytest.mark.parametrize("padding", [1, 5])
def test_padding_of_rows_is_left_out(encoding, pixel_size, padding):
    width, height = 4, 3
    rows = np.arange(height * width * pixel_size, dtype=np.uint8).reshape(height, -1)
    padded = np.pad(rows, ((0, 0), (0, padding)), constant_values=255)
    step = padded.shape[1]
    expected = decode(message(rows.tobytes(), width, height, rows.shape[1], encoding))
    image = decode(message(padded.tobytes(), width, height, step, encoding))
    assert np.array_equal(image, expected)
    assert image.flags.aligned


def test_bgr8_is_a_read_only_view_of_the_data():
    received = message(range(12), 2, 2, 6, "bgr8")
    image = decode(received)
    assert np.shares_memory(image, np.frombuffer(received.data, np.uint8))
    assert not image.flags.writeable


def test_data_after_the_last_row_is_ignored():
    assert decode(message([7, 8, 9], 2, 1, 2, "mono8")).tolist() == [[7, 8]]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_the_tracker_takes_what_is_decoded(encoding, noise):
    pixel_size = 3 if "8" in encoding and "mono" not in encoding else int(encoding[4:]) // 8
    data = noise(height=40, width=50 * pixel_size, channels=1).tobytes()
    image = decode(message(data, 50, 40, 50 * pixel_size, encoding))
    tracker = Tracker.from_preset("li2007")
    tracker.start(image, (10, 10, 20, 20))
    tracker.update(image)


MALFORMED = {
    "empty data": (message([], 4, 2, 12, "bgr8"), "data", "0 bytes", "at least 24"),
    "short data": (message(range(23), 4, 2, 12, "bgr8"), "data", "23 bytes", "at least 24"),
    "short step": (message(range(24), 4, 2, 11, "bgr8"), "step", "11 bytes", "at least 12"),
    "no step": (message(range(24), 4, 2, 0, "bgr8"), "step", "0 bytes", "at least 12"),
    "no width": (message([], 0, 2, 0, "mono8"), "width", "0 px", f"1 to {LARGEST_SIDE}"),
    "no height": (message([], 4, 0, 4, "mono8"), "height", "0 px", f"1 to {LARGEST_SIDE}"),
    "huge width": (
        message(range(24), 2**32 - 1, 1, 2**32 - 1, "mono8"),
        "width",
        "4294967295 px",
        f"1 to {LARGEST_SIDE}",
    ),
    "huge but allowed sides": (
        message(range(24), 30000, 30000, 90000, "bgr8"),
        "data",
        "24 bytes",
        "at least 2700000000",
    ),
    "unknown encoding": (message(range(24), 4, 2, 12, "bgr9"), "encoding", "'bgr9'", "mono8, rgb8"),
    "no encoding": (message(range(24), 4, 2, 12, ""), "encoding", "''", "mono8, rgb8"),
    "encoding in capitals": (message(range(24), 4, 2, 12, "BGR8"), "encoding", "'BGR8'", "bgr8"),
}


@pytest.mark.parametrize("name", MALFORMED)
def test_a_malformed_message_is_refused_with_field_value_and_what_is_allowed(name):
    malformed, field, found, allowed = MALFORMED[name]
    with pytest.raises(ImageError) as refusal:
        decode(malformed)
    assert refusal.value.field == field
    assert f"its {field} " in str(refusal.value)
    assert found in str(refusal.value).partition("allowed")[0]
    assert allowed in str(refusal.value).partition("allowed")[2]


SIDES = st.integers(0, 12) | st.integers(0, 2**32 - 1)


@given(
    st.builds(
        Image,
        data=st.binary(max_size=300).map(lambda data: array("B", data)),
        width=SIDES,
        height=SIDES,
        step=st.integers(0, 40) | st.integers(0, 2**32 - 1),
        encoding=st.sampled_from(sorted(ENCODINGS)) | st.text(max_size=300),
        is_bigendian=st.integers(0, 255),
    )
)
def test_any_message_gives_an_image_of_its_size_or_a_refusal(received):
    try:
        image = decode(received)
    except ImageError as error:
        refusal = str(error)
    else:
        refusal = ""
        assert image.shape[:2] == (received.height, received.width)
        assert image.nbytes <= len(received.data)
    assert not refusal or refusal.startswith("image refused: its ")
    assert len(refusal) < 200


def test_byte_order_is_not_asked_of_bytes():
    little, big = (
        decode(message([1, 2, 3], 1, 1, 3, "bgr8", is_bigendian=order)) for order in (0, 1)
    )
    assert little.tolist() == big.tolist()
