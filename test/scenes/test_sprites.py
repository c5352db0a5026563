"""Sprites: what is drawn lies exactly where it was put."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes.sprites import Drawing, Sprite

COORDINATES = st.floats(15.0, 35.0)


def disc():
    drawing = Drawing(16, 14)
    drawing.ellipse((8.0, 7.0), (5.0, 4.0), (10.0, 120.0, 240.0), angle=20.0)
    return Sprite(drawing.pixels(), (0.0, 0.0)).held_at_centroid()


def centroid(weights):
    rows, columns = np.indices(weights.shape)
    return (columns * weights).sum() / weights.sum(), (rows * weights).sum() / weights.sum()


@given(x=COORDINATES, y=COORDINATES)
def test_centroid_is_where_the_sprite_was_placed_and_nothing_is_lost(x, y):
    canvas = np.zeros((50, 50), np.float32)
    disc().placed(x, y).add_coverage(canvas)
    assert centroid(canvas.astype(float)) == pytest.approx((x, y), abs=1e-4)
    assert canvas.sum() == pytest.approx(disc().pixels[..., 3].sum(), rel=1e-5)


@given(x=COORDINATES, y=COORDINATES)
def test_drawn_color_is_the_mean_of_canvas_and_sprite_by_coverage(x, y):
    canvas = np.full((50, 50, 3), 100.0, np.float32)
    coverage = np.zeros((50, 50), np.float32)
    sprite = disc().painted((200.0, 50.0, 0.0))
    sprite.placed(x, y).draw(canvas)
    sprite.placed(x, y).add_coverage(coverage)
    expected = 100.0 + coverage[..., None] * (np.array([200.0, 50.0, 0.0]) - 100.0)
    assert np.allclose(canvas, expected, atol=1e-2)


@pytest.mark.parametrize("place", [(-3.5, 20.0), (20.0, -2.0), (48.7, 49.2), (-90.0, 400.0)])
def test_what_juts_out_of_the_canvas_is_cut_off(place):
    small, large = np.zeros((50, 50), np.float32), np.zeros((90, 90), np.float32)
    disc().placed(*place).add_coverage(small)
    disc().placed(place[0] + 20, place[1] + 20).add_coverage(large)
    assert np.allclose(small, large[20:70, 20:70], atol=1e-5)


def test_two_half_covers_leave_a_quarter():
    half = Sprite(np.full((1, 1, 4), 0.5, np.float32), (0.0, 0.0))
    canvas = np.zeros((3, 3), np.float32)
    for _ in range(2):
        half.placed(1.0, 1.0).add_coverage(canvas)
    assert canvas[1, 1] == pytest.approx(0.75)
    assert canvas.sum() == pytest.approx(0.75)


def test_a_drawing_covers_the_area_of_its_shapes():
    drawing = Drawing(40, 40, enlargement=8)
    drawing.ellipse((20.0, 20.0), (12.0, 9.0), (255.0, 255.0, 255.0))
    assert drawing.pixels()[..., 3].sum() == pytest.approx(np.pi * 12 * 9, rel=0.02)
    # Premultiplied: no color where there is no coverage, and never more than the coverage allows.
    pixels = drawing.pixels(texture=np.full((40, 40), 3.0, np.float32))
    assert (pixels[..., :3] <= 255.0 * pixels[..., 3:] + 1e-3).all()
