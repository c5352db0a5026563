"""The 8-bit view of a frame and its reductions: their values and cost."""

import numpy as np
import pytest
from common import block_means
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.frames import Foreground, Frame, Region
from pf_tracker_ros.frames import frame as frame_module
from pf_tracker_ros.frames.exposure import gray_range, to_8_bit
from pf_tracker_ros.frames.frame import PixelRect

# Pixels beyond a part that may also be computed.
TILE = 32


def noise(shape, seed=0, dtype=np.uint8):
    return np.random.default_rng(seed).integers(0, np.iinfo(dtype).max + 1, shape, dtype=dtype)


def thermal(height, width, seed=0):
    return np.random.default_rng(seed).integers(7000, 8000, (height, width), dtype=np.uint16)


def rounded_means(pixels, reduction):
    """Means of blocks as `cv2.resize` with INTER_AREA rounds them: halves of 2 x 2 pixels up."""
    means = block_means(pixels, reduction)
    return (np.floor(means + 0.5) if reduction == 2 else np.rint(means)).astype(np.uint8)


@pytest.fixture
def converted(monkeypatch):
    """Makes a 16-bit frame that counts how often each pixel is converted."""

    def make(image, **options):
        times = np.zeros(image.shape, int)
        start = image.__array_interface__["data"][0]

        def counting(part, span):
            offset = part.__array_interface__["data"][0] - start
            row, column = divmod(offset // image.itemsize, image.shape[1])
            height, width = part.shape
            times[row : row + height, column : column + width] += 1
            return to_8_bit(part, span)

        monkeypatch.setattr(frame_module, "to_8_bit", counting)
        frame = Frame(image)
        frame.expose(**options)
        return frame, times

    return make


def near(part, shape, margin=TILE):
    """Whether each pixel is in a part or next to it."""
    inside = np.zeros(shape, bool)
    top, left = max(part.top - margin, 0), max(part.left - margin, 0)
    inside[top : part.bottom + margin, left : part.right + margin] = True
    return inside


@st.composite
def view_requests(draw, height, width):
    """A reduction, and a part of the reduced view."""
    reduction = draw(st.integers(1, 12))
    ends = []
    for length in (-(-height // reduction), -(-width // reduction)):
        start = draw(st.integers(0, length - 1))
        ends += [start, draw(st.integers(start + 1, length))]
    return reduction, PixelRect(*ends)


@st.composite
def frames_and_view_requests(draw):
    height, width = draw(st.integers(1, 140)), draw(st.integers(1, 140))
    kind = draw(st.sampled_from(["gray", "color", "thermal"]))
    seed = draw(st.integers(0, 100))
    if kind == "thermal":
        image = thermal(height, width, seed)
    else:
        image = noise((height, width, 3) if kind == "color" else (height, width), seed)
    return image, draw(st.lists(view_requests(height, width), min_size=1, max_size=6))


@given(frames_and_view_requests())
def test_every_view_is_a_part_of_the_whole_one_in_any_order(drawn):
    image, requests = drawn
    frame = Frame(image)
    whole = to_8_bit(image, gray_range(image))
    for reduction, part in requests:
        expected = whole if reduction == 1 else rounded_means(whole, reduction)
        view = frame.view(part, reduction)
        assert view.dtype == np.uint8
        np.testing.assert_array_equal(view, expected[part.slices])
    np.testing.assert_array_equal(frame.pixels, whole)


def test_means_of_blocks_by_hand():
    rows = [[10, 20, 30, 40, 50], [20, 30, 40, 50, 61], [7, 9, 0, 255, 3]]
    frame = Frame(np.array(rows, np.uint8))
    # 80 / 4, 160 / 4 and 222 / 4 = 55.5; the last row and column are repeated.
    np.testing.assert_array_equal(frame.view(PixelRect(0, 2, 0, 3), 2), [[20, 40, 56], [8, 128, 3]])
    # 166 / 9 = 18.4 and (40 + 2 x 50 + 50 + 2 x 61 + 255 + 2 x 3) / 9 = 63.7.
    np.testing.assert_array_equal(frame.view(PixelRect(0, 1, 0, 2), 3), [[18, 64]])
    np.testing.assert_array_equal(frame.view(PixelRect(0, 1, 1, 2), 3), [[64]])


def test_a_16_bit_image_is_converted_once_and_only_where_it_is_read(converted):
    image = thermal(300, 400)
    frame, times = converted(image)
    assert not times.any()
    part = PixelRect(100, 140, 200, 230)
    view = frame.view(part)
    np.testing.assert_array_equal(view, to_8_bit(image, gray_range(image))[part.slices])
    assert (times[part.slices] == 1).all()
    assert not times[~near(part, image.shape)].any()

    frame.view(PixelRect(110, 120, 190, 240))
    frame.view(part)
    assert times.max() == 1
    assert not times[:60].any()


@pytest.mark.parametrize("reduction", [2, 3])
def test_reduced_views_convert_only_the_pixels_they_need_and_only_once(converted, reduction):
    frame, times = converted(thermal(400, 500))
    part = PixelRect(20, 30, 40, 60)
    frame.view(part, reduction)
    source = PixelRect(*(edge * reduction for edge in part))
    assert (times[source.slices] == 1).all()
    assert not times[~near(source, times.shape, margin=TILE * (reduction + 1))].any()
    for other in (1, 2, 3, 4):
        frame.view(PixelRect(10, 40, 10, 70), other)
        assert times.max() == 1
    assert not times[300:].any()
    # Targets share them, adjacent, large and small.
    for box, of_box in (
        ([100.0, 80.0, 30.0, 40.0], 1),
        ([60.0, 40.0, 160.0, 160.0], 4),
        ([-20.0, 70.0, 50.0, 50.0], 2),
    ):
        assert Region(frame, np.array([box]), of_box).pixels.dtype == np.uint8
    assert times.max() == 1
    assert not times[300:].any()
    assert frame.pixels.shape == times.shape
    assert (times == 1).all()


@pytest.mark.parametrize("kind", ["thermal", "gray", "color"])
def test_the_cost_of_a_large_reduction_is_independent_of_the_block_size(monkeypatch, kind):
    """The view of a large target costs as much as that of a small one."""
    read, size = [], 24

    def counting(values, span):
        read.append(values.shape[0] * values.shape[1])
        return to_8_bit(values, span)

    monkeypatch.setattr(frame_module, "to_8_bit", counting)
    counts = []
    for reduction in (9, 16, 40):
        shape = (size * reduction, size * reduction)
        image = (
            thermal(*shape)
            if kind == "thermal"
            else noise((*shape, 3)[: 3 if kind == "color" else 2])
        )
        read.clear()
        Frame(image).view(PixelRect(0, size, 0, size), reduction)
        counts.append(sum(read))
    assert counts == [16 * size**2] * 3


@pytest.mark.parametrize("reduction", [9, 12, 37])
def test_sampled_views_are_not_shifted(reduction):
    """On a gradient, asymmetric samples would change the values."""
    height, width = 5 * reduction, 7 * reduction
    slope = np.add.outer(np.arange(height) * 0.2, np.arange(width) * 0.5)
    image = (slope * 250.0 / slope.max()).astype(np.uint8)
    view = Frame(image).view(PixelRect(0, 5, 0, 7), reduction)
    means = image.reshape(5, reduction, 7, reduction).mean(axis=(1, 3))
    assert np.abs(view.astype(int) - np.rint(means)).max() <= 1


def test_the_view_uses_the_given_span_or_the_image_s_own():
    image = np.array([[1000, 1500, 2000, 900, 2100]], np.uint16)
    part = PixelRect(0, 1, 0, 5)
    spanned = Frame(image)
    spanned.expose((1000.0, 2000.0))
    np.testing.assert_array_equal(spanned.view(part), [[0, 127, 255, 0, 255]])
    own = Frame(image).view(part)
    assert 0 < own[0, 3] < own[0, 0] < own[0, 1] < own[0, 2] < own[0, 4] < 255


@pytest.mark.parametrize("shape", [(40, 50), (40, 50, 3)])
def test_an_8_bit_image_is_its_own_view(shape):
    image = noise(shape)
    frame = Frame(image, stamp=17)
    assert frame.image is image
    assert (frame.stamp, frame.size, Frame(image).stamp) == (17, (50, 40), 0)
    assert np.shares_memory(frame.view(PixelRect(3, 9, 4, 20)), image)
    assert np.shares_memory(frame.pixels, image)
    np.testing.assert_array_equal(frame.pixels, image)
    assert frame.foreground is frame.background is None
    mask = np.zeros((20, 25), np.uint8)
    frame.foreground = Foreground(mask, 2)
    assert frame.foreground == (mask, 2)


def test_a_cached_map_is_computed_once_for_each_key():
    frame, computed = Frame(noise((4, 4))), []

    def compute():
        computed.append(len(computed))
        return [computed[-1]]

    first = frame.cached("one", compute)
    assert frame.cached("one", compute) is first
    assert frame.cached(("one", 2), compute) == [1]
    assert Frame(frame.image).cached("one", compute) == [2]
    assert computed == [0, 1, 2]
