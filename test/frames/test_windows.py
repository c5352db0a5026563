"""Windows read from an image, against pixels picked and averaged by hand."""

import cv2
import numpy as np
import pytest

from pf_tracker_ros.cues.windows import Crop


@pytest.fixture
def image():
    return np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)


def window(image, center, sides, pixels, gray=False):
    center, sides = np.array(center, float), np.array(sides, float)
    return Crop(image, center, sides, pixels, gray).window(center, sides, pixels)


@pytest.mark.parametrize("corner", [(0, 0), (5, 9), (48, 32), (20, 32)])
def test_a_window_of_the_image_s_own_resolution_holds_its_pixels(image, corner):
    x, y = corner
    expected = image[y : y + 16, x : x + 16]
    np.testing.assert_array_equal(window(image, (x + 8, y + 8), (16, 16), 16), expected)
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    np.testing.assert_array_equal(
        window(gray, (x + 8, y + 8), (16, 16), 16), gray[y : y + 16, x : x + 16]
    )
    np.testing.assert_array_equal(
        window(image, (x + 8, y + 8), (16, 16), 16, gray=True), gray[y : y + 16, x : x + 16]
    )


@pytest.mark.parametrize(("right", "down"), [(0.25, 0.0), (0.5, -0.5), (-0.25, 0.75)])
def test_a_shift_by_part_of_a_pixel_interpolates(right, down):
    rows, columns = np.indices((40, 60))
    ramp = (2 * rows + 2 * columns).astype(np.uint8)
    across = (4 * columns).astype(np.uint8)
    inside = ramp[12:28, 20:36].astype(float)
    moved = window(ramp, (28 + right, 20 + down), (16, 16), 16)
    np.testing.assert_allclose(moved, inside + 2 * right + 2 * down, atol=0.5)
    moved = window(across, (28 + right, 20 + down), (16, 16), 16)
    np.testing.assert_array_equal(moved, across[12:28, 20:36] + 4 * right)


def test_an_enlarged_window_reads_between_the_pixels():
    ramp = np.tile((4 * np.arange(60)).astype(np.uint8), (40, 1))
    # Four window pixels to one of the image: their centers are at -3/8, -1/8, 1/8 and 3/8 of it.
    enlarged = window(ramp, (28, 20), (8, 8), 32)
    expected = 4 * (24 + (np.arange(32) + 0.5) / 4 - 0.5)
    np.testing.assert_allclose(enlarged, np.tile(expected, (32, 1)), atol=0.51)


def test_a_window_of_lower_resolution_holds_the_means_of_blocks(image):
    square = image[:48, :48]
    reduced = window(square, (24, 24), (48, 48), 12)
    means = square.reshape(12, 4, 12, 4, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(reduced, means, atol=0.51)


def test_no_pixel_is_skipped_wherever_the_window_is():
    """Whole factors rarely fit the crop: a chessboard of pixels still becomes gray all over."""
    chessboard = (np.indices((120, 160)).sum(axis=0) % 2 * 255).astype(np.uint8)
    for center in ((60.3, 50.8), (80.0, 61.0), (75.5, 40.25)):
        reduced = window(chessboard, center, (64, 64), 16)
        assert np.abs(reduced.astype(float) - 127.5).max() < 8


def test_each_axis_is_reduced_by_its_own_factor():
    image = np.random.default_rng(1).integers(0, 256, (16, 64), dtype=np.uint8)
    reduced = window(image, (32, 8), (64, 16), 16)
    np.testing.assert_allclose(reduced, image.reshape(16, 16, 4).mean(axis=2), atol=0.51)


@pytest.mark.parametrize(
    "corner", [(-6, 10), (56, 40), (20, -9), (-40, 12), (100, 12), (30, 90), (-50, -70), (300, 400)]
)
def test_outside_the_image_its_border_is_repeated(image, corner):
    x, y = corner
    far = 500
    padded = np.pad(image, ((far, far), (far, far), (0, 0)), mode="edge")
    expected = padded[y + far : y + far + 16, x + far : x + far + 16]
    np.testing.assert_array_equal(window(image, (x + 8, y + 8), (16, 16), 16), expected)


def test_smaller_windows_are_read_from_the_crop_of_a_larger_one(image):
    center, sides = np.array([30.0, 24.0]), np.array([20.0, 20.0])
    crop = Crop(image, center, sides, 20)
    for offset in (0, 2):
        inner = crop.window(center + offset, np.array([16.0, 16.0]), 16)
        expected = image[16 + offset : 32 + offset, 22 + offset : 38 + offset]
        np.testing.assert_array_equal(inner, expected)
