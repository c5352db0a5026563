"""The gradient orientation vector, compared with a pixel-by-pixel implementation."""

import cv2
import numpy as np
import pytest
from common import region_of

from pf_tracker_ros.cues.gradient_orientation import (
    GradientOrientation,
    GradientOrientationParameters,
)

PARAMETERS = GradientOrientationParameters()


def pixelwise_vector(gray, box, cells=4, directions=8, gaussian_width=0.5):
    """For each pixel: gradient (up to 127.5), Gaussian at the pixel, cell, direction."""
    x0, y0, width, height = (int(value) for value in box)
    gray = gray.astype(float)
    padded = cv2.copyMakeBorder(gray, 1, 1, 1, 1, cv2.BORDER_REFLECT_101)
    vector = np.zeros((cells, cells, directions))
    for row in range(height):
        for column in range(width):
            y, x = y0 + row + 1, x0 + column + 1
            right = padded[y, x + 1] - padded[y, x - 1]
            down = padded[y + 1, x] - padded[y - 1, x]
            angle = np.arctan2(down, right) % (2 * np.pi)
            direction = int(angle / (2 * np.pi) * directions + 1e-9) % directions
            across = (column + 0.5) / width - 0.5
            along = (row + 0.5) / height - 0.5
            weight = np.exp(-(across**2 + along**2) / (2 * gaussian_width**2))
            cell = int(row * cells / height), int(column * cells / width)
            vector[(*cell, direction)] += weight * min(np.hypot(right, down), 127.5)
    return vector.ravel() / np.linalg.norm(vector)


@pytest.fixture
def image():
    noise = np.random.default_rng(0).integers(0, 256, (30, 40), dtype=np.uint8)
    return cv2.resize(noise, (160, 120), interpolation=cv2.INTER_CUBIC)


@pytest.mark.parametrize(
    "box", [(20, 30, 40, 40), (100, 10, 24, 48), (0, 0, 64, 32), (60, 60, 80, 56)]
)
def test_close_to_the_pixelwise_vector(image, box):
    """The Gaussian is constant over an eighth of the box: an error of at most 3 %."""
    box = np.array(box, dtype=float)
    cue = GradientOrientation(PARAMETERS)
    vector = cue.learn(region_of(image, box[None]), box)
    expected = pixelwise_vector(image, box)
    assert np.linalg.norm(vector - expected) < 0.03


@pytest.mark.parametrize(
    ("cells", "directions", "tolerance"),
    [(4, 8, 1e-3), (1, 8, 2e-3), (2, 4, 2e-3), (8, 12, 2e-3)],
)
def test_equals_the_pixelwise_vector_under_a_flat_gaussian(image, cells, directions, tolerance):
    """Except for the rounding of gradients to half gray levels."""
    box = np.array([20.0, 30.0, 48.0, 48.0])
    cue = GradientOrientation(PARAMETERS, cells=cells, directions=directions, gaussian_width=100.0)
    vector = cue.learn(region_of(image, box[None]), box)
    expected = pixelwise_vector(image, box, cells, directions, gaussian_width=100.0)
    assert vector.shape == (cells**2 * directions,)
    np.testing.assert_allclose(vector, expected, atol=tolerance)


def test_a_brightness_ramp_fills_the_direction_in_which_it_rises():
    ramp = np.tile(np.arange(0, 200, 2, dtype=np.uint8), (100, 1))
    box = np.array([[20.0, 20.0, 40.0, 40.0]])
    cue = GradientOrientation(PARAMETERS)
    for turned, direction in [(ramp, 0), (ramp.T, 2), (ramp[:, ::-1], 4), (ramp.T[::-1], 6)]:
        region = region_of(np.ascontiguousarray(turned), box)
        vector = cue.learn(region, box[0]).reshape(4, 4, 8)
        assert (vector[..., direction] > 0).all()
        others = np.delete(vector, direction, axis=2)
        np.testing.assert_allclose(others, 0.0, atol=1e-9)


def test_contrast_and_brightness_do_not_matter(image):
    box = np.array([20.0, 30.0, 40.0, 40.0])
    cue = GradientOrientation(PARAMETERS)
    dim = (image.astype(float) * 0.5 + 40).astype(np.uint8)
    bright, darker = (cue.learn(region_of(i, box[None]), box) for i in (image, dim))
    assert np.linalg.norm(bright - darker) < 0.05


@pytest.mark.parametrize("count", [30, 500])
def test_the_distances_are_those_of_the_vectors(image, count):
    """e^2 of many boxes at once equals |h - r|^2 of their vectors, learned one by one."""
    cue = GradientOrientation(GradientOrientationParameters(sharpness=1.0))
    generator = np.random.default_rng(1)
    corners, sizes = generator.uniform(0, 80, (count, 2)), generator.uniform(12, 40, (count, 2))
    boxes = np.column_stack([corners, sizes])
    region = region_of(image, boxes)
    template = cue.learn(region, boxes[0])
    expected = [np.square(cue.learn(region, box) - template).sum() for box in boxes]
    np.testing.assert_allclose(-cue.log_likelihood(region, boxes, template), expected, atol=1e-5)
    matches = [-cue.match(cue.learn(region, box), template).log_likelihood for box in boxes]
    np.testing.assert_allclose(matches, expected, atol=1e-9)


def test_likelihood_by_hand():
    """Orthogonal unit vectors are sqrt(2) apart: exp(-mu * 2)."""
    image = np.full((40, 80), 100, np.uint8)
    image[:, :40] += np.arange(40, dtype=np.uint8)
    image[:, 40:] += np.arange(40, dtype=np.uint8)[:, None]
    boxes = np.array([[4.0, 4.0, 32.0, 32.0], [44.0, 4.0, 32.0, 32.0]])
    region = region_of(image, boxes)
    cue = GradientOrientation(GradientOrientationParameters(sharpness=3.0))
    log_likelihood = cue.log_likelihood(region, boxes, cue.learn(region, boxes[0]))
    np.testing.assert_allclose(log_likelihood, [0.0, -6.0], atol=1e-5)
    same, other = (cue.match(cue.learn(region, box), cue.learn(region, boxes[0])) for box in boxes)
    assert same == (0.0, 1.0)
    assert other == pytest.approx((-6.0, 0.0), abs=1e-5)


def test_the_paper_s_constant_hardly_distinguishes_match_from_mismatch():
    """With mu = 0.01 orthogonal unit vectors have 98 % of the likelihood."""
    cue = GradientOrientation(GradientOrientationParameters(sharpness=0.01))
    ramp = np.tile(np.arange(0, 80, dtype=np.uint8), (40, 1))
    image = np.vstack([ramp, ramp[:, ::-1]])
    boxes = np.array([[4.0, 4.0, 32.0, 32.0], [4.0, 44.0, 32.0, 32.0]])
    region = region_of(image, boxes)
    mismatch = np.exp(cue.log_likelihood(region, boxes, cue.learn(region, boxes[0])))[1]
    assert mismatch == pytest.approx(np.exp(-0.02))


def test_a_flat_box_among_textured_ones_has_no_texture():
    """Exactly zero: scaling rounding errors to unit length would make a texture."""
    image = np.random.default_rng(0).integers(0, 256, (240, 320), dtype=np.uint8)
    image[80:160, 100:200] = 128
    flat, textured = np.array([120.0, 100.0, 40.0, 40.0]), np.array([60.0, 60.0, 40.0, 40.0])
    boxes = np.array([flat, flat + [13.0, 7.0, 0.0, 0.0], textured, [220.0, 140.0, 40.0, 40.0]])
    region = region_of(image, boxes)
    cue = GradientOrientation(PARAMETERS)
    nothing, template = cue.learn(region, flat), cue.learn(region, textured)
    np.testing.assert_array_equal(nothing, np.zeros(128))
    np.testing.assert_allclose(cue.squared_distance(region, boxes, nothing), [0, 0, 1, 1])
    np.testing.assert_allclose(
        cue.squared_distance(region, boxes[:3], template), [1, 1, 0], atol=1e-5
    )


def test_there_is_no_gradient_outside_the_image():
    image = np.random.default_rng(0).integers(0, 256, (40, 40), dtype=np.uint8)
    box = np.array([[-20.0, 0.0, 40.0, 40.0]])
    cue = GradientOrientation(PARAMETERS)
    vector = cue.learn(region_of(image, box), box[0]).reshape(4, 4, 8)
    np.testing.assert_allclose(vector[:, :2], 0.0, atol=1e-12)
    assert (vector[:, 2:].sum(axis=2) > 0).all()


def test_blend_by_hand():
    cue = GradientOrientation(GradientOrientationParameters(keep=0.9))
    np.testing.assert_allclose(cue.blend(np.array([1.0, 0.0]), np.array([0.0, 1.0])), [0.9, 0.1])
