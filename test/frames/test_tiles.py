"""Tiled images: computed only where they are read, in any order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.frames.frame import PixelRect, TiledImage

SIDE = 16


def numbered(shape):
    """An image whose pixel values depend on their position."""
    return (np.arange(np.prod(shape)) * 37 % 251).astype(np.uint8).reshape(shape)


class Computed:
    """Computes by cropping an image, and counts how often each pixel is computed."""

    def __init__(self, image):
        self.image = image
        self.times = np.zeros(image.shape[:2], int)
        self.parts = []

    def __call__(self, part):
        self.parts.append(part)
        self.times[part.slices] += 1
        return self.image[part.slices]


def sections(length):
    """A start and an end, at least one pixel apart."""
    return st.tuples(st.integers(0, length - 1), st.integers(1, length)).map(
        lambda ends: (min(ends), max(ends)) if ends[0] != ends[1] else (ends[0] - 1, ends[1])
    )


@st.composite
def readings(draw):
    """The shape of an image, and parts to read in order."""
    height, width = draw(st.integers(1, 150)), draw(st.integers(1, 150))
    shape = draw(st.sampled_from([(height, width), (height, width, 3)]))
    parts = st.tuples(sections(height), sections(width)).map(
        lambda ends: PixelRect(*ends[0], *ends[1])
    )
    return shape, draw(st.lists(parts, min_size=1, max_size=8))


@given(readings())
def test_every_read_is_right_and_computes_each_needed_tile_once(reading):
    shape, parts = reading
    computed = Computed(numbered(shape))
    tiled = TiledImage(shape)
    touched = np.zeros(shape[:2], bool)
    for part in parts:
        np.testing.assert_array_equal(tiled.read(part, computed), computed.image[part.slices])
        rows, columns = (
            slice(start // SIDE * SIDE, -(-end // SIDE) * SIDE)
            for start, end in (part[:2], part[2:])
        )
        touched[rows, columns] = True
        np.testing.assert_array_equal(computed.times, touched)
    for top, bottom, left, right in computed.parts:
        assert top % SIDE == left % SIDE == 0
        assert bottom % SIDE == 0 or bottom == shape[0]
        assert right % SIDE == 0 or right == shape[1]


def test_the_unknown_tiles_of_a_part_are_computed_in_few_rectangles():
    """A new part is one rectangle; around known tiles there is one on each side."""
    computed = Computed(numbered((96, 96)))
    tiled = TiledImage((96, 96))
    tiled.read(PixelRect(32, 64, 32, 48), computed)
    tiled.read(PixelRect(20, 90, 20, 60), computed)
    assert computed.parts[0] == PixelRect(32, 64, 32, 48)
    assert sorted(computed.parts[1:]) == [
        PixelRect(16, 32, 16, 64),
        PixelRect(32, 64, 16, 32),
        PixelRect(32, 64, 48, 64),
        PixelRect(64, 96, 16, 64),
    ]


def test_a_failed_computation_is_repeated():
    image = numbered((80, 80))

    def compute(part):
        if fails:
            raise MemoryError
        return image[part.slices]

    tiled, fails = TiledImage(image.shape), False
    tiled.read(PixelRect(0, 10, 0, 10), compute)
    fails = True
    with pytest.raises(MemoryError):
        tiled.read(PixelRect(0, 80, 0, 80), compute)
    fails = False
    np.testing.assert_array_equal(tiled.read(PixelRect(0, 80, 0, 80), compute), image)
