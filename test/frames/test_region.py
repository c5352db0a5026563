"""The maps of a region: computed once, independent of the region's extent."""

import cv2
import numpy as np
import pytest

from pf_tracker_ros.frames import Foreground, Frame, Region


@pytest.fixture
def image():
    noise = np.random.default_rng(0).integers(0, 256, (12, 16, 3), dtype=np.uint8)
    return cv2.resize(noise, (161, 121), interpolation=cv2.INTER_CUBIC)


def test_the_region_covers_only_the_boxes_and_computes_a_map_once(image):
    region = Region(Frame(image), np.array([[50.0, 40.0, 10.0, 10.0], [60.0, 45.0, 12.0, 8.0]]))
    assert region.pixels.shape[1] <= 22 + 6
    assert region.pixels.shape[0] <= 13 + 6
    assert region.padding == (0, 0, 0, 0)
    assert region.gradient_integral(8) is region.gradient_integral(8)
    assert region.gradient_integral(4) is not region.gradient_integral(8)
    assert region.gray is region.gray


@pytest.mark.parametrize("reduction", [2, 3])
def test_a_reduced_pixel_is_the_mean_of_its_block_whatever_the_region(image, reduction):
    box = np.array([[60.0, 48.0, 24.0, 24.0]])
    near = Region(Frame(image), box, reduction)
    far = Region(Frame(image), np.vstack([box, [[0.0, 0.0, 161.0, 121.0]]]), reduction)
    x, y = near.region_boxes(box)[0, :2].astype(int)
    far_x, far_y = far.region_boxes(box)[0, :2].astype(int)
    patch = near.pixels[y : y + 5, x : x + 5]
    top, _, left, _ = far.padding
    far_patch = far.pixels[far_y - top : far_y - top + 5, far_x - left : far_x - left + 5]
    np.testing.assert_array_equal(patch, far_patch)
    block = image[48 : 48 + reduction, 60 : 60 + reduction].reshape(-1, 3)
    np.testing.assert_allclose(patch[0, 0], block.mean(axis=0), atol=0.51)


def test_a_box_that_reaches_outside_is_padded(image):
    region = Region(Frame(image), np.array([[-5.0, 110.0, 20.0, 20.0]]))
    top, bottom, left, right = region.padding
    assert (top, right) == (0, 0)
    assert left >= 5
    assert bottom >= 9
    values = region.pad(np.ones(region.pixels.shape[:2], np.uint8))
    assert (values[:, :left] == 0).all()
    assert (values[-bottom:] == 0).all()
    assert (values[:-bottom, left:] == 1).all()


def test_the_integral_holds_the_sum_of_all_gradient_magnitude(image):
    box = np.array([[30.0, 30.0, 20.0, 20.0]])
    region = Region(Frame(image), box)
    gray = region.gray.astype(float)
    padded = cv2.copyMakeBorder(gray, 1, 1, 1, 1, cv2.BORDER_REFLECT_101)
    right = padded[1:-1, 2:] - padded[1:-1, :-2]
    down = padded[2:, 1:-1] - padded[:-2, 1:-1]
    total = region.gradient_integral(8)[-1, -1].sum()
    assert total == np.minimum(np.rint(2 * np.hypot(right, down)), 255).sum()


@pytest.mark.parametrize("reduction", [1, 2, 3])
@pytest.mark.parametrize("mask_reduction", [1, 2, 4])
def test_the_foreground_of_a_region_is_the_mask_below_pixel_centers(reduction, mask_reduction):
    generator = np.random.default_rng(0)
    mask_size = -(-47 // mask_reduction), -(-63 // mask_reduction)
    mask = generator.integers(0, 2, mask_size).astype(np.uint8) * 255
    frame = Frame(np.zeros((47, 63, 3), np.uint8))
    frame.foreground = Foreground(mask, mask_reduction)
    for box in ([-5.0, 20.0, 20.0, 40.0], [20.0, 11.0, 30.0, 16.0]):
        region = Region(frame, np.array([box]), reduction)
        pixels = region.foreground_pixels
        assert pixels.shape == region.pixels.shape[:2]
        corner = region.region_boxes(np.zeros((1, 4)))[0, :2]
        left, top = -corner + (region.padding[2], region.padding[0])
        for row, column in np.ndindex(*pixels.shape):
            y = int((top + row + 0.5) * reduction // mask_reduction)
            x = int((left + column + 0.5) * reduction // mask_reduction)
            below = mask[min(y, mask.shape[0] - 1), min(x, mask.shape[1] - 1)]
            assert pixels[row, column] == (below == 255)
    frame.foreground = None
    assert Region(frame, np.array([box])).foreground_pixels is None


@pytest.mark.parametrize("side", [60, 400])
def test_gradient_sums_are_exact_however_large_the_region_is(side):
    """The sum of the larger one exceeds the exact range of single precision."""
    stripes = np.zeros((side + 8, side + 8), np.uint8)
    stripes[:, np.arange(side + 8) % 4 >= 2] = 255
    region = Region(Frame(stripes), np.array([[4.0, 4.0, side, side]]))
    padded = cv2.copyMakeBorder(region.gray, 0, 0, 1, 1, cv2.BORDER_REFLECT_101)
    rising = (padded[:, 2:] > padded[:, :-2]).astype(np.int64)
    expected = 255 * rising.cumsum(axis=0).cumsum(axis=1)
    np.testing.assert_array_equal(region.gradient_integral(8)[1:, 1:, 0], expected)
