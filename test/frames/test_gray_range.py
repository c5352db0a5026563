"""The gray range of images of more than 8 bits: one image and one update."""

import math

import numpy as np
import pytest

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.frames.exposure import GainControl, adapt_range, gray_range, sample, to_8_bit


def thermal(low, high, seed=0):
    return np.random.default_rng(seed).integers(low, high, (120, 160), dtype=np.uint16)


def test_dead_and_hot_pixels_do_not_stretch_the_range_and_a_large_image_is_sampled():
    image = thermal(7000, 8000)
    expected = gray_range(image)
    assert gray_range(np.tile(image, (5, 5))) == pytest.approx(expected, rel=0.01)
    image[5, 5:15], image[6, 5:15] = 0, 65535
    assert gray_range(image) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("shape", [(1, 10**6), (10**6, 1), (3, 300_000), (700, 900), (5, 7)])
def test_a_limited_number_of_pixels_is_sampled_from_the_whole_image(shape):
    image = np.arange(shape[0] * shape[1], dtype=np.float32).reshape(shape)
    values = sample(image)
    assert min(image.size, 9_000) <= values.size <= min(image.size, 20_500)
    assert values.min() == 0
    assert values.max() > 0.99 * image.max() - 3


def test_the_range_follows_the_images_exponentially():
    before, own = (1000.0, 2000.0), gray_range(thermal(7000, 8000))
    once = adapt_range(before, own, 10.0)
    assert once == pytest.approx(
        [old + (1 - 1 / math.e) * (new - old) for old, new in zip(before, own, strict=True)]
    )
    twice = adapt_range(adapt_range(before, own, 4.0), own, 6.0)
    assert twice == pytest.approx(once)
    assert adapt_range(before, own, 0.0) == before


def test_8_bit_images_have_no_range():
    image = thermal(7000, 8000).astype(np.uint8)
    assert gray_range(image) is None
    assert GainControl().update(image, 1.0).span is None
    assert to_8_bit(image, None) is image


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (290.0, 310.0), (-1e30, 1e30)])
def test_floats_of_any_range_become_evenly_spaced_grays(low, high):
    ramp = np.linspace(low, high, 64, dtype=np.float32).reshape(8, 8)
    image = Frame(ramp).pixels
    assert image.dtype == np.uint8
    steps = np.diff(image.ravel().astype(int))
    assert image.max() - image.min() > 120
    assert steps.min() >= steps.max() - 1 > 0


def test_nan_is_black_and_outliers_do_not_change_the_range():
    values = np.random.default_rng(0).uniform(20, 30, (40, 50)).astype(np.float32)
    clean = Frame(values).pixels
    values = values.copy()
    values[3, 3:8] = [np.nan, np.inf, -np.inf, 1e9, -1e9]
    image = Frame(values).pixels
    assert image[3, 3:8].tolist() == [0, 255, 0, 255, 0]
    assert np.abs(np.delete(image - clean.astype(int), 3, axis=0)).max() <= 5
    assert not Frame(np.full((4, 4), np.nan, np.float32)).pixels.any()


def test_the_view_is_the_position_in_the_range_in_255_steps_rounded_down():
    values = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    span = (7000.0, 9000.0)
    exact = np.clip((values.astype(float) - 7000.0) / 2000.0 * 255.0, 0.0, 255.0)
    for image in (values, values.astype(np.float32)):
        view = to_8_bit(image, span)
        # On an edge between two grays, single precision may give the lower one.
        assert ((view == np.floor(exact)) | (view == np.floor(exact - 1e-3))).all()
        assert (image == values).all()
