from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pf_tracker_ros.evaluation import (
    center_errors,
    has_target,
    overlap,
    precision,
    success_auc,
    success_curve,
)
from pf_tracker_ros.evaluation.metrics import SUCCESS_THRESHOLDS

POSITIONS = st.floats(-2000, 2000)
SIZES = st.floats(0.01, 1000)
BOXES = st.tuples(POSITIONS, POSITIONS, SIZES, SIZES)
WHOLE_BOXES = st.tuples(
    st.integers(0, 12), st.integers(0, 12), st.integers(1, 20), st.integers(1, 20)
)


def rasterized_overlap(first, second):
    """Intersection over union by counting pixels."""
    masks = np.zeros((2, 40, 40), bool)
    for mask, (x, y, width, height) in zip(masks, (first, second), strict=True):
        mask[y : y + height, x : x + width] = True
    return Fraction(int(masks.all(axis=0).sum()), int(masks.any(axis=0).sum()))


@pytest.mark.parametrize(
    ("box", "true_box", "expected"),
    [
        ((5, 5, 10, 10), (0, 0, 10, 10), 25 / 175),
        ((-30, 80, 4, 4), (0, 0, 10, 10), 0.0),
        ((0.25, 0, 0.5, 1), (0, 0, 1, 1), 0.5),
        ((2, 2, 0, 5), (0, 0, 10, 10), 0.0),
        ((5, 5, -3, 4), (0, 0, 10, 10), 0.0),
    ],
)
def test_overlap_by_hand(box, true_box, expected):
    assert overlap(box, true_box) == pytest.approx(expected, abs=1e-15)


@given(WHOLE_BOXES, WHOLE_BOXES)
def test_overlap_of_whole_boxes_counts_pixels(first, second):
    assert float(overlap(first, second)) == float(rasterized_overlap(first, second))


@given(BOXES, BOXES)
def test_overlap_is_symmetric_at_most_1_and_exactly_1_with_itself(first, second):
    value = overlap(first, second)
    assert value == overlap(second, first)
    assert 0 <= value <= 1
    assert overlap(first, first) == 1.0


@given(BOXES, BOXES, st.tuples(POSITIONS, POSITIONS), st.integers(-8, 8))
def test_overlap_ignores_translation_and_scale(first, second, shift, exponent):
    first, second, shift = np.array(first), np.array(second), np.array((*shift, 0, 0))
    value = overlap(first, second)
    assert overlap(first * 2.0**exponent, second * 2.0**exponent) == value
    # Positions near 4000 are rounded to some 1e-12 px, against sides from .01 px.
    assert overlap(first + shift, second + shift) == pytest.approx(value, abs=1e-9)


def test_metrics_broadcast_runs_against_true_boxes_and_errors_are_of_centers():
    boxes = np.tile((0, 0, 2, 2), (3, 5, 1))
    true_boxes = np.tile((1, 0, 2, 2), (5, 1))
    assert overlap(boxes, true_boxes) == pytest.approx(np.full((3, 5), 1 / 3))
    assert center_errors(boxes, true_boxes) == pytest.approx(np.ones((3, 5)))
    assert center_errors((0, 0, 10, 10), (0, 0, 16, 18)) == 5.0
    assert center_errors((3, 4, 10, 10), (5, 6, 6, 6)) == 0.0


@pytest.mark.parametrize(
    "missing", [(np.nan,) * 4, (0, 0, 0, 0), (5, 5, 10, 0), (5, 5, -1, 10), (np.inf, 0, 10, 10)]
)
def test_an_absent_target_has_neither_overlap_nor_error(missing):
    true_boxes = [(0, 0, 10, 10), missing]
    boxes = [(0, 0, 10, 10)] * 2
    with np.errstate(all="raise"):
        assert has_target(true_boxes).tolist() == [True, False]
        assert np.isnan(overlap(boxes, true_boxes)).tolist() == [False, True]
        assert np.isnan(center_errors(boxes, true_boxes)).tolist() == [False, True]


@pytest.mark.parametrize("metric", [overlap, center_errors])
def test_metrics_refuse_other_values_than_boxes(metric):
    with pytest.raises(ValueError, match=r"\(2, 3\).*x, y, width, height"):
        metric(np.zeros((2, 3)), np.ones((2, 4)))
    with pytest.raises(ValueError, match="finite"):
        metric((np.nan, 0, 1, 1), (0, 0, 1, 1))


def test_success_by_hand():
    assert SUCCESS_THRESHOLDS.tolist() == [float(Fraction(k, 20)) for k in range(21)]
    assert success_curve([1.0, 1.0]).tolist() == [1.0] * 20 + [0.0]
    assert success_auc([1.0, 1.0]) == pytest.approx(20 / 21)
    # .5 is above 0 .. .45 (10 thresholds), .07 above 0 and .05 (2), 1 above 20, 0 above none.
    assert success_auc([0.5, 0.07, 1.0, 0.0]) == pytest.approx((10 + 2 + 20 + 0) / 4 / 21)


@pytest.mark.parametrize("twentieths", range(21))
def test_overlap_equal_to_a_threshold_is_not_above_it(twentieths):
    value = overlap((0, 0, twentieths, 1), (0, 0, 20, 1))
    assert success_curve([value]).sum() == twentieths


@given(st.lists(st.tuples(WHOLE_BOXES, WHOLE_BOXES), min_size=1, max_size=20))
def test_success_auc_agrees_with_exact_arithmetic(pairs):
    exact = [rasterized_overlap(*pair) for pair in pairs]
    above = sum(value > Fraction(k, 20) for value in exact for k in range(21))
    first, second = zip(*pairs, strict=True)
    assert success_auc(overlap(first, second)) == pytest.approx(above / len(pairs) / 21)


def test_precision_counts_errors_up_to_20_px_and_frames_without_target_do_not_count():
    boxes = [(12, 16, 4, 4), (20, 0, 4, 4), (20.001, 0, 4, 4), (0, 0, 4, 4)]
    assert precision(center_errors(boxes, (0, 0, 4, 4))) == 0.75
    assert success_auc([1.0, np.nan, 0.0]) == success_auc([1.0, 0.0])
    assert precision([np.nan, 3.0, 40.0, np.nan]) == 0.5


@pytest.mark.parametrize("share", [success_curve, success_auc, precision])
@pytest.mark.parametrize("values", [[], [np.nan, np.nan]])
def test_shares_of_no_frame_are_refused(share, values):
    with pytest.raises(ValueError, match="every frame lacks its true box"):
        share(values)
