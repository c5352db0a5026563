"""Windows read from a frame, compared with averages and interpolation by hand."""

import cv2
import numpy as np
import pytest
from common import block_means
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.frames.region import read_window


@pytest.fixture
def image():
    return np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)


def window(image, center, side, pixels, gray=False):
    return read_window(Frame(image), np.array(center, float), np.full(2, side), pixels, gray)


def bilinear_window(image, center, side, pixels, reduction):
    """Each pixel of the window, from the four around its center in a reduced image."""
    values = np.rint(block_means(image, reduction)) if reduction > 1 else image.astype(float)
    height, width = values.shape[:2]
    expected = np.empty((pixels, pixels, *image.shape[2:]))
    for row, column in np.ndindex(pixels, pixels):
        # Center of the window's pixel in the image, then in the reduced image.
        x = center[0] - side / 2 + (column + 0.5) * side / pixels
        y = center[1] - side / 2 + (row + 0.5) * side / pixels
        x, y = x / reduction - 0.5, y / reduction - 0.5
        left, top = int(np.floor(x)), int(np.floor(y))
        right_share, lower_share = x - left, y - top
        columns = np.clip([left, left + 1], 0, width - 1)
        upper, lower = (
            values[np.clip(each, 0, height - 1), columns[0]] * (1 - right_share)
            + values[np.clip(each, 0, height - 1), columns[1]] * right_share
            for each in (top, top + 1)
        )
        expected[row, column] = upper * (1 - lower_share) + lower * lower_share
    return expected


# OpenCV interpolates in steps of 1/32 pixel, so the error is at most half a step along each axis.
READING_STEP = 1 / 64


def steepest(image):
    """The largest difference of two neighboring pixels."""
    values = image.astype(float)
    return max(np.abs(np.diff(values, axis=axis)).max(initial=0.0) for axis in (0, 1))


@pytest.fixture(scope="module")
def smooth():
    """Smooth noise with odd sides, so that reduced blocks extend outside."""
    noise = np.random.default_rng(2).integers(0, 256, (9, 12, 3), dtype=np.uint8)
    return cv2.resize(noise, (95, 71), interpolation=cv2.INTER_CUBIC)


def assert_equals_an_independent_reading(image, center, side, pixels, reduction):
    read = window(image, center, side, pixels)
    assert read.dtype == np.uint8
    expected = bilinear_window(image, center, side, pixels, reduction)
    # Half a level for rounding the window, half for rounding the blocks.
    tolerance = 1.01 + 2 * READING_STEP * steepest(block_means(image, reduction))
    np.testing.assert_allclose(read, expected, atol=tolerance)


@pytest.mark.parametrize(
    ("pixels", "side", "reduction"),
    [
        *((16, 12.7, 1), (16, 27.9, 1), (16, 28.5, 2), (16, 43.9, 2)),
        *((16, 44.5, 3), (16, 59.3, 3), (10, 70.0, 7)),
    ],
)
@pytest.mark.parametrize(
    "center",
    [(47.3, 35.6), (30.0, 41.5), (3.2, 60.9), (93.8, 2.1), (-9.4, 33.0), (60.0, 79.7), (-70, 160)],
)
def test_equals_an_independent_reading_inside_and_out_of_the_image(
    smooth, pixels, side, reduction, center
):
    """Reduced by 1 up to a scale of 1.75, by 2 up to 2.75 and so on."""
    for image in (smooth, np.ascontiguousarray(smooth[..., 1])):
        assert_equals_an_independent_reading(image, center, side, pixels, reduction)


@given(
    x=st.floats(-200.0, 300.0),
    y=st.floats(-200.0, 300.0),
    side=st.floats(1.0, 200.0),
    pixels=st.integers(2, 12),
)
def test_any_window_equals_an_independent_reading(smooth, x, y, side, pixels):
    reduction = max(int(side / pixels + 0.25), 1)
    image = np.ascontiguousarray(smooth[..., 0])
    assert_equals_an_independent_reading(image, (x, y), side, pixels, reduction)


@pytest.mark.parametrize("corner", [(0, 0), (5, 9), (48, 32), (20, -9), (100, 12), (-50, -70)])
def test_a_window_of_the_image_s_own_resolution_holds_its_pixels(image, corner):
    """Outside of the image its border is repeated."""
    x, y = np.array(corner) + 100
    padded = np.pad(image, ((100, 100), (100, 100), (0, 0)), mode="edge")
    color = padded[y : y + 16, x : x + 16]
    gray = cv2.cvtColor(color, cv2.COLOR_BGR2GRAY)
    center = np.array(corner) + 8
    np.testing.assert_array_equal(window(image, center, 16, 16), color)
    np.testing.assert_array_equal(window(image, center, 16, 16, gray=True), gray)
    image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    np.testing.assert_array_equal(window(image, center, 16, 16), gray)


@pytest.mark.parametrize(("side", "pixels"), [(16, 16), (48, 16), (40, 64)])
def test_a_window_does_not_depend_on_earlier_reads(image, side, pixels):
    center = np.array([30.0, 24.0])
    frame = Frame(image)
    alone = read_window(frame, center, np.full(2, side), pixels)
    busy = Frame(image)
    for offset in (-20.0, 3.0, 11.5):
        read_window(busy, center + offset, np.full(2, side), pixels)
    np.testing.assert_array_equal(read_window(busy, center, np.full(2, side), pixels), alone)


def test_a_window_of_a_16_bit_frame_is_read_from_its_8_bit_view():
    image = np.random.default_rng(3).integers(7000, 8000, (48, 64), dtype=np.uint16)
    frame = Frame(image)
    frame.expose((7000.0, 8000.0))
    converted = np.floor((image - 7000.0) * (255.0 / 1000.0)).astype(np.uint8)
    read = read_window(frame, np.array([28.0, 22.0]), np.full(2, 16.0), 16)
    np.testing.assert_allclose(read.astype(int), converted[14:30, 20:36], atol=1)
    whole = Frame(frame.pixels)
    for side in (16.0, 40.0):
        np.testing.assert_array_equal(
            read_window(frame, np.array([28.3, 22.1]), np.full(2, side), 16),
            read_window(whole, np.array([28.3, 22.1]), np.full(2, side), 16),
        )
