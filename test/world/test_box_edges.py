"""Which edges of a box are the target's, and their covariance."""

import numpy as np
import pytest

from pf_tracker_ros.world.box_edges import BoxEdges

SIZE = (640, 480)


@pytest.mark.parametrize(
    ("box", "has_upper", "has_lower", "is_whole"),
    [
        ((300, 100, 40, 100), True, True, True),
        ((300, 380, 40, 100), True, False, False),
        ((300, 370, 40, 108), True, False, False),
        ((300, -20, 40, 200), False, True, False),
        ((300, -20, 40, 600), False, False, False),
        ((-10, 100, 40, 100), True, True, False),
        ((610, 100, 40, 100), True, True, False),
    ],
)
def test_an_edge_at_the_border_is_cut(box, has_upper, has_lower, is_whole):
    edges = BoxEdges.of(box, None, SIZE)
    assert (edges.has_upper, edges.has_lower, edges.is_whole) == (has_upper, has_lower, is_whole)
    for outside in ((700, 100, 40, 100), (-50, 100, 40, 100), (10, 480, 40, 100)):
        assert BoxEdges.of(outside, None, SIZE) is None


def test_the_edges_inside_the_image():
    edges = BoxEdges.of((300, -20, 40, 120), None, SIZE)
    assert edges.box == (300, 0, 40, 100)
    # Half a pixel less: pixels of a calibration count from the first one's center.
    np.testing.assert_allclose(
        edges.points(), [(319.5, 99.5), (319.5, -0.5), (319.5, 49.5)], atol=1e-12
    )


def test_a_box_cut_at_a_side_has_its_middle_where_a_whole_one_would():
    # One of 200 px height that crosses the image is about 100 px wide; 30 are visible.
    left = BoxEdges.of((-70, 100, 100, 200), None, SIZE)
    right = BoxEdges.of((610, 100, 100, 200), None, SIZE)
    assert left.middle == pytest.approx(30 - 50)
    assert right.middle == pytest.approx(610 + 50)
    whole = BoxEdges.of((300, 100, 80, 200), None, SIZE)
    assert left.covariance[0, 0] > 4.0 * whole.covariance[0, 0]


def test_the_covariance_of_the_edges_is_that_of_samples():
    root = np.random.default_rng(0).normal(size=(4, 4))
    covariance = root @ root.T
    samples = np.random.default_rng(1).multivariate_normal(np.zeros(4), covariance, 200_000)
    x, y, _, height = samples.T
    expected = np.cov([x, y + height / 2, y - height / 2]) + 0.25 * np.eye(3)
    edges = BoxEdges.of((300, 100, 40, 100), covariance, SIZE)
    np.testing.assert_allclose(edges.covariance, expected, atol=0.15)
    np.testing.assert_allclose(edges.root @ edges.root.T, edges.covariance, atol=1e-9)
    center = np.cov([x, y]) + np.diag([0.25, 0.125])
    np.testing.assert_allclose(edges.center_covariance(), center, atol=0.15)


def test_a_covariance_of_one_direction_is_one_at_any_scale():
    direction = np.array([1.0, 2.0, 3.0, 4.0])
    for sd in (1e-6, 1.0, 1e5):
        covariance = sd**2 * np.outer(direction, direction)
        edges = BoxEdges.of((300, 100, 40, 100), covariance, SIZE)
        # The lower edge is center y and half the height.
        assert edges.covariance[1, 1] == pytest.approx((4.0 * sd) ** 2 + 0.25)


def test_a_covariance_of_the_center_leaves_the_size_as_a_detector_has_it():
    by_center = BoxEdges.of((300, 100, 40, 100), np.diag([9.0, 4.0]), SIZE)
    default = BoxEdges.of((300, 100, 40, 100), None, SIZE).covariance[1, 1] - 0.25
    assert by_center.covariance[0, 0] == pytest.approx(9.25)
    assert by_center.covariance[1, 1] == pytest.approx(4.25 + default / 2.0)


FINITE = "four finite numbers"


@pytest.mark.parametrize(
    ("box", "covariance", "message"),
    [
        ((0, 0, 0, 10), None, FINITE),
        ((0, 0, 10, -1), None, FINITE),
        ((np.nan, 0, 1, 1), None, FINITE),
        ((0, 0, np.inf, 1), None, FINITE),
        ((0, 0, 1, 1e200), None, FINITE),
        ((1, 2, 3), None, FINITE),
        ((300, 100, 40, 100), np.eye(3), r"shape \(3, 3\)"),
        ((300, 100, 40, 100), np.full((2, 2), np.nan), "finite"),
        ((300, 100, 40, 100), -np.eye(4), "semidefinite"),
        ((300, 100, 40, 100), [[4.0, 1.0], [-1.0, 4.0]], "symmetric"),
        ((300, 100, 40, 100), 1e20 * np.eye(2), "deviations up to"),
    ],
)
def test_what_is_no_box_or_no_covariance_is_rejected(box, covariance, message):
    with pytest.raises(ValueError, match=message):
        BoxEdges.of(box, covariance, SIZE)
