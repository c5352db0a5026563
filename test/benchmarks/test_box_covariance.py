"""The fit of the box covariance recovers known coefficients; its figures by hand."""

import numpy as np
import pytest

from pf_tracker_ros.footage import read_sequence


@pytest.fixture
def fitting(benchmark):
    pytest.importorskip("scipy")
    return benchmark("box_covariance")


def drawn(fitting, coefficients, frames=40_000):
    generator = np.random.default_rng(1)
    features = np.column_stack([np.ones(frames), generator.normal(0.0, 0.5, (frames, 3))])
    size = np.array([[1.0, fitting.SIZE_CORRELATION], [fitting.SIZE_CORRELATION, 1.0]])
    errors = generator.standard_normal((frames, 4))
    errors[:, 2:] = errors[:, 2:] @ np.linalg.cholesky(size).T
    errors *= np.exp(features @ coefficients.T)
    edges = errors[:, 1] + errors[:, 3] / 2
    return fitting.Errors(features, errors, edges)


def test_the_fit_finds_the_coefficients_that_the_errors_were_drawn_with(fitting):
    """With a variance 25 % larger, as on unseen footage."""
    coefficients = np.random.default_rng(2).uniform(-0.3, 0.3, (4, 4)) - np.eye(1, 4) * 2.5
    found = fitting.fit([drawn(fitting, coefficients)])
    unseen = np.eye(1, 4) * np.log(1.25) / 2
    np.testing.assert_allclose(found, coefficients + unseen, atol=0.03)


def test_true_coefficients_are_consistent_and_smaller_ones_are_not(fitting):
    coefficients = np.tile([-2.5, 0.1, -0.1, 0.2], (4, 1))
    errors = drawn(fitting, coefficients)
    for name, (squared, degrees) in fitting.squared_errors(errors, coefficients).items():
        assert squared.mean() / degrees == pytest.approx(1.0, abs=0.03), name
    half = coefficients - np.eye(1, 4) * np.log(2.0)
    squared, degrees = fitting.squared_errors(errors, half)["center"]
    assert squared.mean() / degrees == pytest.approx(4.0, abs=0.1)
    row = fitting.summary("title", [errors], [coefficients]).groups[0][0]
    assert [float(value) for value in row[2:]] == pytest.approx([0.5, 0.9, 0.99], abs=0.01)


def test_it_measures_tracked_boxes(fitting, moving_square_sequence):
    """Boxes of a square on a plain ground are within a fifth of its side."""
    measured = fitting.measure(read_sequence(moving_square_sequence), "default", 1)
    assert len(measured.edges) > 10
    assert measured.features.shape == (len(measured.edges), 4)
    assert np.abs(measured.errors).max() < 0.2
