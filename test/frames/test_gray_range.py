"""The gray range of 16-bit images: of one image, and over time."""

import math

import numpy as np
import pytest

from pf_tracker_ros.frames.gray_range import adapt_range, gray_range, to_8_bit


def thermal(low, high, seed=0):
    return np.random.default_rng(seed).integers(low, high, (120, 160), dtype=np.uint16)


def test_dead_and_hot_pixels_do_not_stretch_the_range():
    image = thermal(7000, 8000)
    expected = gray_range(image)
    image[5, 5:15], image[6, 5:15] = 0, 65535
    assert gray_range(image) == pytest.approx(expected, rel=0.01)


def test_the_range_of_a_large_image_is_that_of_a_sample():
    large = np.tile(thermal(7000, 8000), (5, 5))
    assert gray_range(large) == pytest.approx(gray_range(thermal(7000, 8000)), rel=0.01)


def test_the_range_follows_the_images_exponentially():
    before, image = (1000.0, 2000.0), thermal(7000, 8000)
    own = gray_range(image)
    once = adapt_range(before, image, 10.0)
    assert once == pytest.approx(
        [old + (1 - 1 / math.e) * (new - old) for old, new in zip(before, own, strict=True)]
    )
    twice = adapt_range(adapt_range(before, image, 4.0), image, 6.0)
    assert twice == pytest.approx(once)
    assert adapt_range(before, image, 0.0) == before


def test_8_bit_images_have_no_range():
    image = thermal(7000, 8000).astype(np.uint8)
    assert gray_range(image) is None
    assert adapt_range(None, image, 1.0) is None
    assert to_8_bit(image, None) is image
