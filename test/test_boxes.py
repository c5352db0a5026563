import math

import numpy as np
import pytest

from pf_tracker_ros.boxes import (
    bounding_box,
    bounding_box_of_rotated,
    box_corners,
    intersection_areas,
    iou,
    pairwise_coverage,
    pairwise_iou,
)

BOXES = np.array([[0.0, 0.0, 4.0, 2.0], [2.0, 1.0, 4.0, 2.0], [9.0, 9.0, 1.0, 1.0]])


def test_intersection_areas():
    assert intersection_areas(BOXES, BOXES).tolist() == [8.0, 8.0, 1.0]
    assert intersection_areas(BOXES[0], BOXES[1:]).tolist() == [2.0, 0.0]


def test_iou_is_1_of_equal_boxes_and_0_of_empty_ones():
    thirds = np.array([[0.1, 1.1, 1 / 3, 10 / 3], [1e5, 0.1, 0.7, 1e-3], [1.0, 1.0, 0.0, 2.0]])
    assert iou(thirds, thirds).tolist() == [1.0, 1.0, 0.0]
    assert iou(BOXES[0], BOXES[1]) == pytest.approx(2 / 14)


def test_pairwise_iou_and_coverage():
    # 2 px^2 of 8 + 8 - 2.
    assert pairwise_iou(BOXES[:2], BOXES) == pytest.approx(np.array([[1, 1 / 7, 0], [1 / 7, 1, 0]]))
    assert pairwise_coverage(BOXES[:2], BOXES[:1]).tolist() == [[1.0], [0.25]]


def test_a_box_is_the_bounding_box_of_its_corners():
    assert box_corners((1, 2, 3, 4)) == [(1, 2), (4, 2), (4, 6), (1, 6)]
    assert bounding_box(box_corners((1, 2, 3, 4))) == (1, 2, 3, 4)
    assert bounding_box([(5.0, -1.0)]) == (5, -1, 0, 0)


@pytest.mark.parametrize(
    ("angle", "sides"),
    [
        (0.0, (4, 2)),
        (math.pi / 2, (2, 4)),
        (-math.pi / 4, (6 / math.sqrt(2), 6 / math.sqrt(2))),
        (math.nan, (4, 2)),
    ],
)
def test_the_bounding_box_of_a_rotated_box_keeps_its_center(angle, sides):
    width, height = sides
    expected = (10 - width / 2, 20 - height / 2, width, height)
    assert bounding_box_of_rotated((10, 20), (4, 2), angle) == pytest.approx(expected)
