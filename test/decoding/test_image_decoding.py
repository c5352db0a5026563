from array import array

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import Image

from pf_tracker_ros import Tracker
from pf_tracker_ros.decoding.image_decoding import (
    ENCODINGS,
    LARGEST_SIDE,
    ImageError,
    decode_image,
    decode_raw,
)


def message(data, width, height, step, encoding, *, is_bigendian=0):
    layout = {"width": width, "height": height, "step": step, "is_bigendian": is_bigendian}
    return Image(encoding=encoding, data=array("B", data), **layout)


def test_mono8_keeps_its_gray_values_and_data_after_the_last_row_is_ignored():
    image = decode_raw(message([1, 2, 3, 4, 5, 6, 7], 3, 2, 3, "mono8"))
    assert image.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert image.dtype == np.uint8


@pytest.mark.parametrize(("is_bigendian", "data"), [(0, [0x34, 0x12]), (1, [0x12, 0x34])])
def test_mono16_honors_its_byte_order(is_bigendian, data):
    image = decode_raw(message(data, 1, 1, 2, "mono16", is_bigendian=is_bigendian))
    assert image.tolist() == [[0x1234]]
    assert image.dtype == np.uint16
    assert image.dtype.isnative


@pytest.mark.parametrize(("encoding", "pixel_size"), [("bgr8", 3), ("mono8", 1), ("mono16", 2)])
@pytest.mark.parametrize("padding", [1, 5])
def test_padding_of_rows_is_removed(encoding, pixel_size, padding):
    width, height = 4, 3
    rows = np.arange(height * width * pixel_size, dtype=np.uint8).reshape(height, -1)
    padded = np.pad(rows, ((0, 0), (0, padding)), constant_values=255)
    step = padded.shape[1]
    expected = decode_raw(message(rows.tobytes(), width, height, rows.shape[1], encoding))
    image = decode_raw(message(padded.tobytes(), width, height, step, encoding))
    assert np.array_equal(image, expected)
    assert image.flags.aligned


# Parts of names to bytes in a pixel.
BYTES = {"16": 2, "32": 4, "bgr8": 3, "rgb8": 3, "8UC3": 3, "a8": 4, "yu": 2, "uy": 2}


def layout(encoding):
    """Rows of bytes, and bytes in a row, of an image of 50 x 40 px."""
    rows = {"nv21": 60, "nv24": 120}.get(encoding, 40)
    return rows, 50 * next((count for key, count in BYTES.items() if key in encoding), 1)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("padding", [0, 6])
def test_the_tracker_accepts_every_encoding(encoding, noise, padding):
    rows, row = layout(encoding)
    # Padding follows each row, also rows of color.
    data = noise(height=rows, width=row + padding, channels=1).tobytes()
    image = decode_image(message(data, 50, 40, row + padding, encoding), max_pixels=1)
    assert image.shape[:2] == (40, 50)
    tracker = Tracker.from_preset("li2007")
    tracker.start(image, (10, 10, 20, 20))
    tracker.update(image)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_one_byte_less_than_the_layout_needs_is_refused(encoding):
    rows, row = layout(encoding)
    decode_raw(message(bytes(rows * row), 50, 40, row, encoding))
    with pytest.raises(ImageError, match=f"at least {rows * row}"):
        decode_raw(message(bytes(rows * row - 1), 50, 40, row, encoding))


@pytest.mark.parametrize("is_bigendian", [0, 1])
@pytest.mark.parametrize(
    ("encoding", "data"),
    [
        ("8UC3", [10, 20, 30]),
        ("bgr8", [10, 20, 30]),
        ("bgra8", [10, 20, 30, 255]),
        ("rgba8", [30, 20, 10, 0]),
        ("rgb8", [30, 20, 10]),
    ],
)
def test_color_becomes_bgr_whatever_the_byte_order(encoding, data, is_bigendian):
    received = message(data, 1, 1, len(data), encoding, is_bigendian=is_bigendian)
    assert decode_raw(received).tolist() == [[[10, 20, 30]]]


@pytest.mark.parametrize("encoding", ["bgr8", "8UC3", "mono8", "8UC1", "mono16", "16UC1"])
def test_an_encoding_without_conversion_is_a_read_only_view_of_the_data(encoding):
    received = message(range(48), 4, 2, 24, encoding)
    image = decode_raw(received)
    assert np.shares_memory(image, np.frombuffer(received.data, np.uint8))
    assert not image.flags.writeable


# ITU-R BT.601, video levels: (Y, U, V) of colors as (B, G, R).
COLORS = {
    (235, 128, 128): (255, 255, 255),
    (16, 128, 128): (0, 0, 0),
    (82, 90, 240): (0, 0, 255),
    (145, 54, 34): (0, 255, 0),
    (41, 240, 110): (255, 0, 0),
}


def yuv_layouts(y, u, v):
    """The data of a uniform image of 4 x 2 px, and its step, in each layout."""
    uyvy, yuyv = bytes([u, y, v, y]) * 4, bytes([y, u, y, v]) * 4
    return {
        "yuv422": (uyvy, 8),
        "uyvy": (uyvy, 8),
        "yuv422_yuy2": (yuyv, 8),
        "yuyv": (yuyv, 8),
        "nv21": (bytes([y] * 8 + [v, u] * 2), 4),
        "nv24": (bytes([y] * 8 + [u, v] * 8), 4),
    }


@pytest.mark.parametrize("encoding", yuv_layouts(0, 0, 0))
def test_yuv_is_converted_by_the_standard(encoding):
    for yuv, color in COLORS.items():
        data, step = yuv_layouts(*yuv)[encoding]
        image = decode_raw(message(data, 4, 2, step, encoding))
        assert image.shape == (2, 4, 3)
        assert np.abs(image.astype(int) - color).max() <= 3


@pytest.mark.parametrize(
    ("encoding", "width", "height", "field"),
    [
        ("yuv422", 3, 2, "width"),
        ("yuyv", 1, 1, "width"),
        ("nv21", 3, 2, "width"),
        ("nv21", 2, 3, "height"),
        ("bayer_rggb8", 2, 8, "width"),
        ("bayer_bggr16", 8, 2, "height"),
    ],
)
def test_sides_that_an_encoding_does_not_allow_are_refused(encoding, width, height, field):
    with pytest.raises(ImageError, match=f"its {field} is . px; allowed in {encoding}: "):
        decode_raw(message(bytes(200), width, height, 16, encoding))


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_a_bayer_pattern_is_converted_to_its_color(pattern):
    values = {"r": 200, "g": 100, "b": 50}
    tile = np.array([values[letter] for letter in pattern]).reshape(2, 2)
    mosaic = np.tile(tile, (4, 4))
    image = decode_raw(message(mosaic.astype(np.uint8).tobytes(), 8, 8, 8, f"bayer_{pattern}8"))
    assert (image == (50, 100, 200)).all()
    for order in ("<", ">"):
        data = (mosaic * 256).astype(f"{order}u2").tobytes()
        received = message(data, 8, 8, 16, f"bayer_{pattern}16", is_bigendian=order == ">")
        gray = decode_raw(received)
        # The weights of the luminance.
        expected = 256 * (0.299 * 200 + 0.587 * 100 + 0.114 * 50)
        assert gray.dtype == np.uint16
        assert gray[2:-2, 2:-2] == pytest.approx(expected, rel=0.01)


def floats(values, order="<", stamp=0):
    values = np.asarray(values, f"{order}f4")
    height, width = values.shape
    received = message(
        values.tobytes(), width, height, 4 * width, "32FC1", is_bigendian=order == ">"
    )
    received.header.stamp.sec = stamp
    return received


@pytest.mark.parametrize("order", ["<", ">"])
def test_floats_of_either_byte_order_keep_their_values(order):
    values = np.array([[0.5, -290.0, 1e30], [np.nan, np.inf, -np.inf]], np.float32)
    # The tracker determines the range of values.
    image = decode_image(floats(values, order, stamp=2), max_pixels=1)
    assert image.dtype == np.float32
    assert image.dtype.isnative
    np.testing.assert_array_equal(image, values)


ANY_SIDE = f"1 to {LARGEST_SIDE}"


@pytest.mark.parametrize(
    ("sizes", "encoding", "field", "found", "allowed"),
    [
        # Octets, width, height, step.
        ((0, 4, 2, 12), "bgr8", "data", "0 bytes", "at least 24"),
        ((24, 4, 2, 11), "bgr8", "step", "11 bytes", "at least 12"),
        ((24, 4, 2, 0), "bgr8", "step", "0 bytes", "at least 12"),
        ((0, 0, 2, 0), "mono8", "width", "0 px", ANY_SIDE),
        ((0, 4, 0, 4), "mono8", "height", "0 px", ANY_SIDE),
        ((24, 2**32 - 1, 1, 2**32 - 1), "mono8", "width", "4294967295 px", ANY_SIDE),
        ((24, 30000, 30000, 90000), "bgr8", "data", "24 bytes", "at least 2700000000"),
        ((24, 4, 2, 12), "bgr9", "encoding", "'bgr9'", "mono8, rgb8"),
        ((24, 4, 2, 12), "", "encoding", "''", "mono8, rgb8"),
        ((24, 4, 2, 12), "BGR8", "encoding", "'BGR8'", "bgr8"),
        # Shortened, and without control characters.
        ((24, 4, 2, 12), "x" * 10_000_000, "encoding", "'xxx", "bgr8"),
        ((24, 4, 2, 12), "\x1b[2J\n" * 100_000, "encoding", "", "bgr8"),
        ((24, 4, 2, 12), "\u202e" * 50, "encoding", "", "bgr8"),
    ],
    ids=lambda value: str(value)[:20].encode("unicode_escape").decode(),
)
def test_a_malformed_message_is_refused_with_field_value_and_allowed_values(
    sizes, encoding, field, found, allowed
):
    octets, *shape = sizes
    with pytest.raises(ImageError) as refusal:
        decode_raw(message(range(octets), *shape, encoding))
    text = str(refusal.value)
    assert refusal.value.field == field
    assert f"its {field} " in text
    assert found in text.partition("allowed")[0]
    assert allowed in text.partition("allowed")[2]
    assert len(text) < 400
    assert text.isprintable()


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
def test_any_message_gives_an_image_of_its_size_or_an_error(received):
    try:
        image = decode_raw(received)
    except ImageError as error:
        refusal = str(error)
    else:
        refusal = ""
        assert image.shape[:2] == (received.height, received.width)
        assert image.nbytes <= 3 * len(received.data)
    assert not refusal or refusal.startswith("image refused: its ")
    assert len(refusal) < 400
