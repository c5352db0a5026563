"""Sums over boxes, compared with sums over their pixels."""

import cv2
import numpy as np
import pytest

from pf_tracker_ros.cues.foreground import box_sums, box_sums_on_grid

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
