"""Histograms of oriented gradients, compared with a pixel-by-pixel implementation."""

import cv2
import numpy as np
import pytest
from common import region_of

from pf_tracker_ros.cues.hog import Hog, HogParameters

CELLS_X, CELLS_Y, BINS = 3, 5, 16


def hog(cells=(CELLS_X, CELLS_Y), bins=BINS, smoothed=False, **parameters):
    """Without smoothing, unlike the default."""
    return Hog(HogParameters(**parameters), cells=cells, bins=bins, smoothed=smoothed)


@pytest.fixture
def image():
    noise = np.random.default_rng(0).integers(0, 256, (30, 40), dtype=np.uint8)
    return cv2.resize(noise, (160, 120), interpolation=cv2.INTER_CUBIC)


def bin_shares(angle, bins):
    """The share of each bin for an angle in degrees: three bins, by the quadratic B-spline."""
    shares = np.zeros(bins)
    for number in range(bins):
        apart = abs((angle - number * 180 / bins + 90) % 180 - 90) * bins / 180
        if apart <= 0.5:
            shares[number] = 0.75 - apart**2
        elif apart < 1.5:
            shares[number] = 0.5 * (1.5 - apart) ** 2
    return shares


def pixelwise_descriptor(gray, box, cells_x=CELLS_X, cells_y=CELLS_Y, bins=BINS):
    """Each pixel counts in each cell by their common area; then the blocks are normalized."""
    x0, y0, width, height = box
    padded = cv2.copyMakeBorder(gray.astype(float), 1, 1, 1, 1, cv2.BORDER_REFLECT_101)
    cells = np.zeros((cells_y, cells_x, bins))
    for y in range(int(y0), int(np.ceil(y0 + height))):
        for x in range(int(x0), int(np.ceil(x0 + width))):
            right = padded[y + 1, x + 2] - padded[y + 1, x]
            down = padded[y + 2, x + 1] - padded[y, x + 1]
            magnitude = min(np.hypot(right, down), 127.5)
            votes = magnitude * bin_shares(np.degrees(np.arctan2(down, right)) % 180, bins)
            for i in range(cells_y):
                top, bottom = y0 + i * height / cells_y, y0 + (i + 1) * height / cells_y
                for j in range(cells_x):
                    left, end = x0 + j * width / cells_x, x0 + (j + 1) * width / cells_x
                    area = max(min(end, x + 1) - max(left, x), 0.0)
                    area *= max(min(bottom, y + 1) - max(top, y), 0.0)
                    cells[i, j] += area * votes
    blocks = []
    for i in range(cells_y - 1):
        for j in range(cells_x - 1):
            block = np.array([cells[i, j], cells[i, j + 1], cells[i + 1, j], cells[i + 1, j + 1]])
            blocks.append(block / np.linalg.norm(block))
    descriptor = np.array(blocks).reshape(cells_y - 1, cells_x - 1, 4, bins)
    return descriptor.transpose(2, 0, 1, 3) / descriptor.sum()


def test_seven_by_fifteen_blocks_of_the_paper():
    """64 x 128 px in cells of 8 px: 7 x 15 blocks of 4 x 32 numbers are 13,440, not 4,480."""
    image = np.random.default_rng(0).integers(0, 256, (130, 70), dtype=np.uint8)
    cue = hog((8, 16), bins=32)
    box = np.array([3.0, 1.0, 64.0, 128.0])
    descriptor = cue.learn(region_of(image, box[None]), box)
    assert descriptor.shape == (4, 15, 7, 32)
    assert descriptor.size == 13_440


@pytest.mark.parametrize(
    "box", [(20, 30, 30, 50), (100, 10, 24, 48), (60.3, 55.7, 31.9, 44.1), (8.5, 8.25, 7.5, 9.0)]
)
def test_equals_the_pixelwise_descriptor(image, box):
    """Except for the rounding of magnitudes to half gray levels."""
    box = np.array(box, dtype=float)
    descriptor = hog().learn(region_of(image, box[None]), box)
    expected = pixelwise_descriptor(image, box)
    assert np.abs(descriptor - expected).sum() < 0.01


@pytest.mark.parametrize("bins", [9, 16, 32])
def test_a_gradient_is_shared_among_its_three_nearest_directions(bins):
    """At the center of a bin 1/8, 3/4, 1/8."""
    cue = hog((2, 2), bins)
    box = np.array([12.0, 12.0, 40.0, 40.0])
    steep = np.tile(np.arange(0, 256, 4, dtype=np.uint8), (64, 1))
    shares = cue.learn(region_of(steep, box[None]), box).sum(axis=(0, 1, 2))
    np.testing.assert_allclose(shares[[-1, 0, 1]], [1 / 8, 3 / 4, 1 / 8], atol=1e-6)
    np.testing.assert_allclose(np.delete(shares, [-1, 0, 1 % bins]), 0.0)


def test_a_flip_of_polarity_changes_nothing(image):
    box = np.array([20.0, 30.0, 30.0, 50.0])
    cue = hog()
    hot, cold = (cue.learn(region_of(i, box[None]), box) for i in (image, 255 - image))
    np.testing.assert_allclose(hot, cold, atol=2e-4)


def test_distance_and_likelihood_by_hand():
    """Two boxes without a common direction, and a template of half of each."""
    boxes = np.array([[4.0, 4.0, 32.0, 32.0], [44.0, 4.0, 32.0, 32.0]])
    across = np.full((40, 80), 100, np.uint8)
    across[:, :40] += np.arange(40, dtype=np.uint8)
    across[:, 40:] += np.arange(40, dtype=np.uint8)[:, None]
    region = region_of(across, boxes)
    cue = hog((2, 2), sharpness=3.0)
    template = cue.learn(region, boxes[0])
    np.testing.assert_allclose(cue.squared_distance(region, boxes, template), [0.0, 1.0], atol=1e-6)
    # exp(-3 * 1 / 2)
    log_likelihood = cue.log_likelihood(region, boxes, template)
    np.testing.assert_allclose(log_likelihood, [0.0, -1.5], atol=1e-5)

    mixed = 0.5 * template + 0.5 * cue.learn(region, boxes[1])
    # Equation (8): rho = sqrt(1 / 2), D^2 = 1 - sqrt(1 / 2), for either of the two boxes.
    expected = 1 - np.sqrt(0.5)
    np.testing.assert_allclose(cue.squared_distance(region, boxes, mixed), expected, atol=1e-6)
    match = cue.match(template, mixed)
    assert match == pytest.approx((-1.5 * expected, 1 - np.sqrt(expected)))


def test_as_printed_without_the_root_a_perfect_match_would_be_far_away(image):
    """Equation (8) as printed lacks the root: D of a box from itself would be near 1."""
    box = np.array([20.0, 30.0, 30.0, 50.0])
    cue = hog()
    region = region_of(image, box[None])
    descriptor = cue.learn(region, box)
    assert np.sqrt(1 - (descriptor * descriptor).sum()) > 0.99
    assert cue.squared_distance(region, box[None], descriptor) == pytest.approx(0.0, abs=1e-6)


def test_the_distances_of_boxes_of_any_size_are_those_of_their_descriptors(image):
    cue = hog()
    generator = np.random.default_rng(1)
    boxes = np.column_stack([generator.uniform(0, 80, (30, 2)), generator.uniform(6, 40, (30, 2))])
    region = region_of(image, boxes)
    template = cue.learn(region, boxes[0])
    descriptors = [cue.learn(region, box) for box in boxes]
    expected = [1 - np.sqrt(descriptor * template).sum() for descriptor in descriptors]
    distances = cue.squared_distance(region, boxes, template)
    np.testing.assert_allclose(distances, expected, atol=1e-5)
    matches = [cue.match(descriptor, template) for descriptor in descriptors]
    np.testing.assert_allclose(
        [match.log_likelihood for match in matches],
        cue.log_likelihood(region, boxes, template),
        atol=1e-3,
    )


def test_smoothing_weights_a_pixel_and_its_neighbors_by_1_2_1(image):
    box = np.array([20.0, 30.0, 30.0, 50.0])
    smooth = hog(smoothed=True)
    rows = image.astype(float)
    for axis in (0, 1):
        rows = (np.roll(rows, 1, axis) + 2 * rows + np.roll(rows, -1, axis)) / 4
    before = hog().learn(region_of(np.floor(rows + 0.5).astype(np.uint8), box[None]), box)
    np.testing.assert_allclose(smooth.learn(region_of(image, box[None]), box), before, atol=1e-4)


def test_a_box_without_any_gradient_matches_only_another_one(image):
    flat = image.copy()
    flat[:, 80:] = 77
    boxes = np.array(
        [[100.0, 10.0, 30.0, 50.0], [110.0, 20.0, 20.0, 40.0], [20.0, 10.0, 30.0, 50.0]]
    )
    cue = hog()
    region = region_of(flat, boxes)
    template = cue.learn(region, boxes[0])
    np.testing.assert_array_equal(template, 0.0)
    distances = cue.squared_distance(region, boxes, template)
    np.testing.assert_allclose(distances, [0.0, 0.0, 1.0], atol=1e-6)
    assert cue.match(template, template) == (0.0, 1.0)
    textured = cue.learn(region, boxes[2])
    distances = cue.squared_distance(region, boxes, textured)
    np.testing.assert_allclose(distances, [1.0, 1.0, 0.0], atol=1e-6)
    assert cue.match(template, textured).similarity == pytest.approx(0.0, abs=1e-3)


def test_there_is_no_gradient_outside_the_image():
    image = np.random.default_rng(0).integers(0, 256, (40, 40), dtype=np.uint8)
    box = np.array([-20.0, 0.0, 40.0, 40.0])
    cue = hog((4, 4))
    descriptor = cue.learn(region_of(image, box[None]), box)
    np.testing.assert_array_equal(descriptor[:, :, 0], 0.0)
    np.testing.assert_array_equal(descriptor[[0, 2], :, 1], 0.0)
    assert (descriptor[:, :, 2].sum(axis=2) > 0).all()


def test_blend_by_hand_and_replacement():
    old, new = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    np.testing.assert_allclose(hog(keep=0.9).blend(old, new), [0.9, 0.1])
    np.testing.assert_allclose(hog(keep=0.0).blend(old, new), new)
