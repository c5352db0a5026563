"""Transforms of small squares, compared with NumPy's FFT."""

import numpy as np
import pytest

from pf_tracker_ros.cues.correlation_filter import SquareTransform, invert, transform


def squares(n, *many):
    return np.random.default_rng(n).normal(size=(*many, n, n)).astype(np.float32)


@pytest.mark.parametrize("n", [2, 8, 24, 40, 64])
@pytest.mark.parametrize("many", [(), (3,), (2, 3)])
def test_a_transform_equals_the_fft(n, many):
    values = squares(n, *many)
    spectra = transform(n).apply(values)
    assert spectra.dtype == np.complex64
    np.testing.assert_allclose(spectra, np.fft.rfft2(values), atol=1e-5 * n)


@pytest.mark.parametrize("n", [2, 8, 24, 40, 64])
def test_the_inverse_gives_the_squares_back(n):
    values = squares(n, 5)
    back = invert(np.fft.rfft2(values).astype(np.complex64))
    assert back.dtype == np.float32
    np.testing.assert_allclose(back, values, atol=1e-5)


def test_the_matrix_is_applied_to_rows_and_columns_first():
    matrix = np.random.default_rng(1).normal(size=(8, 8))
    values = squares(8, 2)
    expected = np.fft.rfft2(matrix @ values @ matrix.T)
    spectra = SquareTransform(matrix).apply(values)
    np.testing.assert_allclose(spectra, expected, atol=1e-3)
