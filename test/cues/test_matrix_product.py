"""Products in blocks equal those in one piece."""

import numpy as np
import pytest

from pf_tracker_ros.cues.correlation_filter import product


@pytest.mark.parametrize(
    ("rows", "inner", "columns"),
    [
        (3, 4, 5),  # one block
        (17, 1984, 17),  # blocks of 7: the last is a part
        (64, 512, 24),  # blocks of 8, all whole
        (300, 1000, 3),  # a column is more than a block
    ],
)
def test_equals_the_product_in_one_piece(rows, inner, columns):
    generator = np.random.default_rng(0)
    matrix = generator.normal(size=(rows, inner)).astype(np.float32)
    other = generator.normal(size=(columns, inner)).astype(np.float32)
    result = product(matrix, other.T)
    assert result.shape == (rows, columns)
    assert result.dtype == np.float32
    expected = matrix.astype(float) @ other.T.astype(float)
    np.testing.assert_allclose(result, expected, atol=1e-5 * inner)
