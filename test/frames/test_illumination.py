"""Changes of illumination: distinguished from other changes, and compensated."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.frames.exposure import Illumination, gain_table
from pf_tracker_ros.frames.frame import PixelRect

INTERVAL = 0.04
SIZE = (120, 160)


def scene(seed=0, low=40, high=140, size=SIZE):
    coarse = np.random.default_rng(seed).integers(low, high, (12, 16, 3), np.uint8)
    return cv2.resize(coarse, size[::-1], interpolation=cv2.INTER_CUBIC)


def gray(seed, low, high):
    return scene(seed, low, high)[..., :1].repeat(3, axis=2)


def dark_noise():
    """What a sensor sees behind a cap."""
    noise = np.random.default_rng(5).normal(14.0, 4.0, (*SIZE, 3))
    return noise.clip(0, 255).astype(np.uint8)


def lit(image, gain):
    return cv2.convertScaleAbs(image, alpha=gain)


def gain_after(images, illumination=None, interval=INTERVAL):
    illumination = illumination or Illumination()
    for image in images:
        illumination = illumination.update(image, interval)
    return illumination.gain


@pytest.mark.parametrize("gain", [0.4, 0.5, 0.8, 1.3, 1.7, 2.5])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_jump_of_the_illumination_is_measured(gain, channels):
    image = scene()
    image = image if channels == 3 else image[..., 0]
    assert gain_after([image, lit(image, gain)]) == pytest.approx(gain, rel=0.02)
    # Saturated pixels are ignored: half of the scene is so bright that it becomes white.
    if channels == 3 and gain > 1.5:
        image[:, 80:] = scene(1, 180, 255)[:, 80:]
        assert gain_after([image, lit(image, gain)]) == pytest.approx(gain, rel=0.03)


@pytest.mark.parametrize(
    ("gains", "has_jumped"),
    [
        ([1.0], False),
        ([1.0, 1.0], False),
        ([1.0, 1.7], True),
        ([1.0, 0.5], True),
        ([1.0, 1.7, 1.7], False),
        ([1.0, 1.1, 1.2, 1.3, 1.4], False),
    ],
)
def test_a_jump_lasts_one_image(gains, has_jumped):
    illumination = Illumination()
    for gain in gains:
        illumination = illumination.update(lit(scene(), gain), INTERVAL)
    assert illumination.has_jumped is has_jumped


@pytest.mark.parametrize("gain", [0.15, 0.2])
def test_also_when_the_gain_exceeded_the_largest_correction(gain):
    image = scene(low=100, high=190)
    illumination = Illumination().update(image, INTERVAL).update(lit(image, gain), INTERVAL)
    assert illumination.gain == pytest.approx(gain, rel=0.05)
    np.testing.assert_array_equal(gain_table(illumination.gain), gain_table(0.25))
    assert gain_after([image, image], illumination) == 1.0


def test_the_changes_of_several_images_add_up_and_a_light_that_goes_leaves_none():
    image = scene()
    steps = [lit(image, gain) for gain in (1.0, 0.9, 0.8, 0.7, 0.6)]
    assert gain_after(steps) == pytest.approx(0.6, rel=0.03)
    assert gain_after([image, lit(image, 0.5), image]) == 1.0


def with_a_bright_object():
    image = scene()
    image[20:100, 30:90] = 230
    return image


@pytest.mark.parametrize(
    ("before", "after"),
    [
        pytest.param(scene(), with_a_bright_object(), id="a bright object"),
        pytest.param(scene(), scene(), id="nothing"),
        pytest.param(gray(0, 20, 120), gray(1, 40, 190), id="another, brighter scene"),
        pytest.param(scene(), np.roll(scene(), (3, 9), (0, 1)), id="the camera's view"),
        pytest.param(scene(), np.zeros((*SIZE, 3), np.uint8), id="a shutter"),
        pytest.param(scene(), np.full((*SIZE, 3), 255, np.uint8), id="a flash"),
        pytest.param(scene(), dark_noise(), id="a covered lens"),
        pytest.param(dark_noise(), scene(), id="an uncovered lens"),
    ],
)
def test_other_changes_do_not_change_the_gain(before, after):
    assert gain_after([before, after]) == 1.0


def test_the_gain_decays_to_1():
    """After 10 s, 1 / e of its logarithm is left; small gains become 1."""
    image = scene()
    illumination = Illumination().update(image, INTERVAL).update(lit(image, 0.5), INTERVAL)
    assert gain_after([lit(image, 0.5)], illumination, 10.0) == pytest.approx(
        0.5 ** np.exp(-1), rel=0.02
    )
    assert gain_after([lit(image, 0.5)], illumination, 40.0) == 1.0
    # It stays while nothing learns the illumination.
    dimmed = [lit(image, 0.5)] * 300
    assert gain_after(dimmed, illumination, 0.0) == pytest.approx(illumination.gain, rel=1e-6)


@settings(max_examples=40)
@given(
    st.lists(st.floats(0.0, 30.0), min_size=1, max_size=8),
    st.sampled_from([(1, 1), (1, 400), (300, 2), (37, 53)]),
)
def test_levels_change_at_most_by_a_factor_of_four(gains, size):
    image = scene(3, 0, 256, size).reshape(*size, 3)
    illumination = Illumination()
    for gain in gains:
        illumination = illumination.update(lit(image, gain).reshape(*size, 3), INTERVAL)
        levels = np.arange(256)
        assert (gain_table(illumination.gain) >= np.floor(levels / 4.0)).all()
        assert (gain_table(illumination.gain) <= np.minimum(4 * levels, 255)).all()


@pytest.mark.parametrize("kind", [np.uint16, np.float32])
def test_images_of_more_than_8_bits_have_no_gain(kind):
    image = scene()[..., 0].astype(kind)
    assert gain_after([image, image // 2]) == 1.0
    levels = gain_table(0.5)[[0, 1, 100, 127, 128, 255]]
    assert levels.tolist() == [0, 2, 200, 254, 255, 255]


def test_the_view_of_a_frame_is_divided_by_the_gain():
    """The whole view, a part and a reduced one."""
    image = scene()
    dark = Frame(lit(image, 0.5))
    dark.expose(illumination=Illumination(0.5))
    part = PixelRect(10, 50, 20, 90)
    assert np.abs(dark.pixels.astype(int) - image).max() <= 1
    np.testing.assert_array_equal(dark.view(part), dark.pixels[part.slices])
    reduced, expected = (
        dark.view(PixelRect(0, 30, 0, 40), 4),
        Frame(image).view(PixelRect(0, 30, 0, 40), 4),
    )
    assert np.abs(reduced.astype(int) - expected).max() <= 2
    assert dark.image.max() < image.max()
