"""Foreground cue: shares of foreground in boxes, by hand."""

import cv2
import numpy as np
import pytest

from pf_tracker_ros.boxes import BoxGrid
from pf_tracker_ros.cues.foreground import (
    ForegroundCue,
    ForegroundParameters,
    box_sums,
    box_sums_on_grid,
)
from pf_tracker_ros.frames import Foreground, Frame, Region

IMAGE = np.zeros((80, 100), np.uint8)
TARGET = np.array([40.0, 30.0, 20.0, 20.0])


def region_of(mask, boxes, reduction=1):
    frame = Frame(IMAGE)
    frame.foreground = Foreground(mask, reduction)
    return Region(frame, boxes)


def cue(ring=0.5, sharpness=10.0):
    return ForegroundCue(ForegroundParameters(sharpness=sharpness), ring=ring)


@pytest.mark.parametrize("reduction", [1, 2])
def test_contrast_by_hand(reduction):
    mask = np.zeros((80 // reduction, 100 // reduction), np.uint8)
    mask[30 // reduction : 50 // reduction, 40 // reduction : 60 // reduction] = 255
    # The second box contains half the target; its ring of 1200 px contains the other 200 px.
    boxes = np.array([TARGET, TARGET + [10, 0, 0, 0], [4.0, 4.0, 20.0, 20.0]])
    contrast = cue().contrast(region_of(mask, boxes, reduction), boxes)
    np.testing.assert_allclose(contrast, [1.0, 0.5 - 200 / 1200, 0.0])


def test_likelihood_is_one_only_where_foreground_fills_the_box_and_not_the_ring():
    mask = np.zeros((80, 100), np.uint8)
    mask[30:50, 40:60] = 255
    boxes = np.array([TARGET, [4.0, 4.0, 20.0, 20.0]])
    np.testing.assert_allclose(cue().log_likelihood(region_of(mask, boxes), boxes, None), [0, -10])


def test_there_is_no_foreground_outside_the_image():
    boxes = np.array([[-10.0, -10.0, 20.0, 20.0]])
    mask = np.full((80, 100), 255, np.uint8)
    # A quarter of the box, and 300 of the 1200 px of its ring.
    contrast = cue().contrast(region_of(mask, boxes), boxes)
    np.testing.assert_allclose(contrast, [0.25 - 300 / 1200], atol=1e-12)


def test_without_a_background_model_all_boxes_are_equal():
    boxes = np.array([TARGET, [4.0, 4.0, 20.0, 20.0]])
    np.testing.assert_array_equal(
        cue().log_likelihood(Region(Frame(IMAGE), boxes), boxes, None), [0.0, 0.0]
    )


def test_there_is_no_contrast_without_a_mask():
    boxes = TARGET[None]
    with pytest.raises(ValueError, match="no foreground"):
        cue().contrast(Region(Frame(IMAGE), boxes), boxes)


@pytest.mark.parametrize("reduction", [1, 3])
def test_a_grid_has_the_values_of_its_boxes(reduction):
    mask = np.random.default_rng(2).choice([0, 255], (80, 100)).astype(np.uint8)
    grid = BoxGrid(np.linspace(-9.0, 60.3, 7), np.linspace(2.6, 70.0, 5), np.array([18.0, 25.5]))
    region = region_of(mask, grid.boxes, reduction)
    on_grid = cue().log_likelihood_on_grid(region, grid, None)
    np.testing.assert_array_equal(on_grid, cue().log_likelihood(region, grid.boxes, None))
    assert np.ptp(on_grid) > 1.0
    nothing = cue().log_likelihood_on_grid(Region(Frame(IMAGE), grid.boxes), grid, None)
    np.testing.assert_array_equal(nothing, np.zeros(35))


def test_it_needs_the_foreground():
    assert cue().needs_foreground


def test_it_has_no_template_and_no_match():
    """Foreground does not identify the target."""
    boxes = np.array([TARGET])
    region = region_of(np.full((80, 100), 255, np.uint8), boxes)
    assert cue().learn(region, TARGET) is None
    assert cue().match(None, None) is None
    assert cue().blend(None, None) is None


# Sums over boxes, compared with sums over their pixels

DRAW = np.random.default_rng(5)
PIXELS = DRAW.integers(0, 256, (40, 60)).astype(np.uint8)
INTEGRAL = cv2.integral(PIXELS, sdepth=cv2.CV_32S)


def edges(length, shape):
    """(..., 2, N) starts and ends, in order."""
    return np.sort(DRAW.integers(0, length + 1, shape), axis=-2)


def total(columns, rows):
    (left, right), (top, bottom) = columns, rows
    return int(PIXELS[top:bottom, left:right].sum())


@pytest.mark.parametrize("kinds", [(), (2,)])
def test_sums_over_boxes(kinds):
    columns, rows = edges(60, (*kinds, 2, 25)), edges(40, (*kinds, 2, 25))
    added = box_sums(INTEGRAL, columns, rows)
    assert added.shape == (*kinds, 25)
    for place in np.ndindex(added.shape):
        kind, number = place[:-1], place[-1]
        assert added[place] == total(columns[kind][:, number], rows[kind][:, number])


def test_sums_over_a_grid_are_those_over_its_boxes():
    columns, rows = edges(60, (2, 7)), edges(40, (2, 5))
    expected = [[total(columns[:, x], rows[:, y]) for x in range(7)] for y in range(5)]
    np.testing.assert_array_equal(box_sums_on_grid(INTEGRAL, columns, rows), expected)
