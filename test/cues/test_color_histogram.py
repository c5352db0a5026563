"""The color histogram cue, compared with OpenCV's histograms of single boxes."""

import cv2
import numpy as np
import pytest
from common import region_of

from pf_tracker_ros.cues.color_histogram import (
    ColorHistogram,
    ColorHistogramParameters,
    ForegroundColorHistogram,
)
from pf_tracker_ros.frames import Foreground, Frame, Region

RANGES = [0, 256] * 3


# The square root of 1 - rho amplifies the last bit of a 32-bit share to this.
ROUNDING = 1e-3


def distances(cue, region, boxes, template):
    return np.sqrt(cue.squared_distance(region, boxes, template))


def opencv_histogram(image, box, levels=16):
    x, y, width, height = (int(value) for value in box)
    patch = image[y : y + height, x : x + width]
    histogram = cv2.calcHist([patch], [2, 1, 0], None, [levels] * 3, RANGES)
    return histogram / patch[..., 0].size


def opencv_distance(image, box, template_box):
    return cv2.compareHist(
        opencv_histogram(image, box),
        opencv_histogram(image, template_box),
        cv2.HISTCMP_BHATTACHARYYA,
    )


@pytest.fixture
def image():
    """Smooth color noise, so that neighboring boxes share some colors but not all."""
    noise = np.random.default_rng(0).integers(0, 256, (15, 20, 3), dtype=np.uint8)
    return cv2.resize(noise, (200, 150), interpolation=cv2.INTER_CUBIC)


def test_equals_opencv_on_whole_pixel_boxes(image):
    cue = ColorHistogram(ColorHistogramParameters())
    generator = np.random.default_rng(1)
    boxes = np.column_stack(
        [generator.integers(0, 160, 300), generator.integers(0, 110, 300), *np.full((2, 300), 40)]
    ).astype(float)
    region = region_of(image, boxes)
    template = cue.learn(region, boxes[0])
    np.testing.assert_allclose(
        template.histogram, opencv_histogram(image, boxes[0]).ravel(), rtol=1e-6, atol=1e-12
    )
    expected = [opencv_distance(image, box, boxes[0]) for box in boxes]
    np.testing.assert_allclose(distances(cue, region, boxes, template), expected, atol=ROUNDING)


def test_a_template_of_several_pages_is_compared_completely():
    image = np.random.default_rng(0).integers(0, 256, (60, 120, 3), dtype=np.uint8)
    boxes = np.array([[0.0, 0.0, 50.0, 50.0], [60.0, 5.0, 50.0, 50.0], [30.0, 5.0, 50.0, 50.0]])
    cue = ColorHistogram(ColorHistogramParameters())
    region = region_of(image, boxes)
    template = cue.learn(region, boxes[0])
    assert np.count_nonzero(template.histogram) > 3 * 255
    expected = [opencv_distance(image, box, boxes[0]) for box in boxes]
    np.testing.assert_allclose(distances(cue, region, boxes, template), expected, atol=ROUNDING)


def test_many_boxes_of_several_sizes_are_counted_completely():
    """They are counted in parts, which may differ in size."""
    cue = ColorHistogram(ColorHistogramParameters())
    corners = np.random.default_rng(2).uniform(0, 40, (300, 2))
    sides = np.where(np.arange(300) < 256, 20.0, 40.0)
    boxes = np.column_stack([corners, sides, sides])
    region = region_of(np.full((90, 90, 3), 77, np.uint8), boxes)
    template = cue.learn(region, boxes[0])
    np.testing.assert_allclose(distances(cue, region, boxes, template), 0.0, atol=ROUNDING)


def test_boxes_of_several_sizes_agree_with_opencv_up_to_sampling(image):
    cue = ColorHistogram(ColorHistogramParameters())
    generator = np.random.default_rng(2)
    boxes = np.column_stack(
        [
            generator.integers(0, 140, (50, 2)) * [1.0, 0.7],
            generator.integers(25, 50, 50),
            generator.integers(25, 45, 50),
        ]
    ).astype(np.intp)
    template_box = np.array([80.0, 50.0, 40.0, 40.0])
    region = region_of(image, np.vstack([boxes, template_box]))
    template = cue.learn(region, template_box)
    expected = [opencv_distance(image, box, template_box) for box in boxes]
    np.testing.assert_allclose(
        distances(cue, region, boxes.astype(float), template), expected, atol=0.06
    )


def test_likelihood_by_hand():
    """A box half red, half green against an all red template: rho = sqrt(0.5)."""
    image = np.zeros((20, 40, 3), np.uint8)
    image[:, :20, 2] = 255
    image[:, 20:, 1] = 255
    red, half = np.array([0.0, 0.0, 10.0, 10.0]), np.array([15.0, 0.0, 10.0, 10.0])
    region = region_of(image, np.array([red, half]))
    cue = ColorHistogram(ColorHistogramParameters(sharpness=20.0))
    log_likelihood = cue.log_likelihood(region, np.array([red, half]), cue.learn(region, red))
    np.testing.assert_allclose(
        np.exp(log_likelihood), [1.0, np.exp(-20.0 * (1 - np.sqrt(0.5)))], rtol=1e-6
    )
    match = cue.match(cue.learn(region, half), cue.learn(region, red))
    assert match == pytest.approx((-20.0 * (1 - np.sqrt(0.5)), np.sqrt(0.5)))


def test_the_paper_s_constant_hardly_distinguishes_match_from_mismatch():
    """With lambda = 0.02 a box without a common color has 98 % of the likelihood."""
    image = np.zeros((10, 20, 3), np.uint8)
    image[:, :10] = (0, 0, 255)
    image[:, 10:] = (255, 0, 0)
    boxes = np.array([[0.0, 0.0, 10.0, 10.0], [10.0, 0.0, 10.0, 10.0]])
    region = region_of(image, boxes)
    literal = ColorHistogram(ColorHistogramParameters(sharpness=0.02))
    match, mismatch = np.exp(literal.log_likelihood(region, boxes, literal.learn(region, boxes[0])))
    assert mismatch / match == pytest.approx(np.exp(-0.02))
    shipped = ColorHistogram(ColorHistogramParameters())
    assert shipped.log_likelihood(region, boxes, shipped.learn(region, boxes[0]))[1] < -5


def test_pixels_outside_the_image_match_nothing():
    image = np.full((50, 50, 3), 200, np.uint8)
    inside, half_outside = [10.0, 10.0, 20.0, 20.0], [-10.0, 10.0, 20.0, 20.0]
    boxes = np.array([inside, half_outside])
    region = region_of(image, boxes)
    cue = ColorHistogram(ColorHistogramParameters())
    distance = distances(cue, region, boxes, cue.learn(region, boxes[0]))
    np.testing.assert_allclose(distance, [0.0, np.sqrt(1 - np.sqrt(0.5))], atol=1e-6)


def test_a_gray_image_is_a_color_image_of_equal_channels(image):
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    box = np.array([30.0, 30.0, 25.0, 35.0])
    cue = ColorHistogram(ColorHistogramParameters())
    np.testing.assert_array_equal(
        cue.learn(region_of(gray, box[None]), box).histogram,
        cue.learn(region_of(cv2.merge([gray] * 3), box[None]), box).histogram,
    )


@pytest.mark.parametrize("levels", [2, 3, 16, 32])
def test_every_level_holds_an_equal_share_of_a_gray_ramp(levels):
    ramp = np.repeat(np.arange(256, dtype=np.uint8)[None], 4, axis=0)
    box = np.array([0.0, 0.0, 256.0, 4.0])
    cue = ColorHistogram(ColorHistogramParameters(), levels=levels)
    histogram = cue.learn(region_of(ramp, box[None]), box).histogram
    diagonal = histogram[np.arange(levels) * (levels**2 + levels + 1)]
    assert histogram.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(diagonal, 1 / levels, atol=1 / 256)


def test_blend_by_hand_and_negligible_bins_are_removed():
    cue = ColorHistogram(ColorHistogramParameters(keep=0.9), levels=2)
    image = np.zeros((10, 30, 3), np.uint8)
    image[:, 15:, 0] = 255
    half, blue = np.array([10.0, 0.0, 10.0, 10.0]), np.array([20.0, 0.0, 10.0, 10.0])
    region = region_of(image, np.array([half, blue]))
    template, observation = cue.learn(region, half), cue.learn(region, blue)
    blended = cue.blend(template, observation).histogram
    assert blended[0] == pytest.approx(0.45)
    assert blended[1] == pytest.approx(0.55)
    for _ in range(100):
        template = cue.blend(template, observation)
    assert template.histogram[0] == 0.0
    assert template.histogram[1] == pytest.approx(1.0, abs=1e-2)


def two_tone():
    """Left half red, right half blue, and a mask whose foreground is a square around the border."""
    image = np.zeros((60, 80, 3), np.uint8)
    image[:, :40] = (10, 10, 200)
    image[:, 40:] = (200, 10, 10)
    mask = np.zeros((60, 80), np.uint8)
    mask[20:40, 30:50] = 255
    return image, mask


FOREGROUND_CUE = ForegroundColorHistogram(ColorHistogramParameters(sharpness=10.0), levels=4)


def region_with_foreground(image, boxes, mask, reduction=1):
    frame = Frame(image)
    frame.foreground = Foreground(mask, reduction)
    return Region(frame, boxes)


@pytest.mark.parametrize("reduction", [1, 2])
def test_the_background_is_one_bin(reduction):
    image, mask = two_tone()
    boxes = np.array([[30.0, 20.0, 20.0, 40.0], [4.0, 4.0, 20.0, 40.0], [36.0, 20.0, 20.0, 40.0]])
    reduced = mask[::reduction, ::reduction].copy()
    region = region_with_foreground(image, boxes, reduced, reduction)
    template = FOREGROUND_CUE.learn(region, boxes[0])
    red, blue, background = 3 * 16, 3, 64
    shares = {index: share for index, share in enumerate(template.histogram) if share > 0}
    assert shares == pytest.approx({red: 0.25, blue: 0.25, background: 0.5})
    # All background: sqrt(.5 x 1). Third: 4 of 20 columns red and 10 blue, over half the height.
    coefficients = [1.0, 0.5**0.5, (0.25 * 0.1) ** 0.5 + 0.25 + (0.5 * 0.65) ** 0.5]
    np.testing.assert_allclose(
        FOREGROUND_CUE.squared_distance(region, boxes, template),
        1.0 - np.array(coefficients),
        atol=1e-6,
    )


def test_a_box_of_background_is_not_similar_to_a_target_with_much_background():
    image, mask = two_tone()
    boxes = np.array([[30.0, 20.0, 20.0, 40.0], [4.0, 4.0, 20.0, 40.0]])
    region = region_with_foreground(image, boxes, mask)
    template, empty = (FOREGROUND_CUE.learn(region, box) for box in boxes)
    assert FOREGROUND_CUE.match(template, template) == pytest.approx((0.0, 1.0), abs=1e-6)
    log_likelihood, similarity = FOREGROUND_CUE.match(empty, template)
    assert log_likelihood == pytest.approx(-10.0 * (1.0 - 0.5**0.5), abs=1e-5)
    assert similarity == 0.0


def test_a_target_of_background_only_has_no_match():
    image, mask = two_tone()
    boxes = np.array([[4.0, 4.0, 20.0, 10.0], [30.0, 20.0, 20.0, 20.0]])
    region = region_with_foreground(image, boxes, mask)
    template, other = (FOREGROUND_CUE.learn(region, box) for box in boxes)
    assert FOREGROUND_CUE.match(template, template) is None
    assert FOREGROUND_CUE.match(other, template) is None


def test_without_a_mask_every_pixel_has_its_color():
    image, _ = two_tone()
    boxes = np.array([[30.0, 20.0, 20.0, 40.0]])
    histogram = FOREGROUND_CUE.learn(region_of(image, boxes), boxes[0]).histogram
    assert (histogram[3 * 16], histogram[3], histogram[64]) == pytest.approx((0.5, 0.5, 0.0))


def test_only_the_foreground_histogram_needs_the_foreground():
    assert FOREGROUND_CUE.needs_foreground
    assert not ColorHistogram(ColorHistogramParameters()).needs_foreground


def test_both_cues_can_read_one_region():
    """They share color bins, but not the bins with background."""
    image, mask = two_tone()
    boxes = np.array([[30.0, 20.0, 20.0, 40.0]])
    region = region_with_foreground(image, boxes, mask)
    plain = ColorHistogram(ColorHistogramParameters(), levels=4)
    apart = FOREGROUND_CUE.learn(region, boxes[0]).histogram
    together = plain.learn(region, boxes[0]).histogram
    assert (together[3 * 16], together[3]) == pytest.approx((0.5, 0.5))
    assert (apart[3 * 16], apart[3], apart[64]) == pytest.approx((0.25, 0.25, 0.5))
