"""Fourier transforms of small squares, as products of matrices.

For a few dozen points along each side they take less time than a fast transform. Whatever else is
done to rows and columns, such as a window or a stretch, is in the matrices, and costs nothing.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

Spectrum = NDArray[np.complex64]


class SquareTransform:
    """The Fourier transform of squares to whose rows and columns a matrix is applied first.

    Args:
        matrix: (n, n), n even; the identity for the transform alone.
    """

    def __init__(self, matrix: NDArray[np.float64]) -> None:
        waves = _waves(len(matrix)) @ matrix
        self._down = waves.astype(np.complex64)
        across = waves[: len(matrix) // 2 + 1].T
        # Real and imaginary part side by side, as in the memory of complex numbers.
        parts = np.stack([across.real, across.imag], axis=-1)
        self._across = parts.reshape(len(matrix), -1).astype(np.float32)

    def apply(self, squares: NDArray[np.float32]) -> Spectrum:
        """(..., n, n // 2 + 1) spectra of (..., n, n) squares: the half that tells the other."""
        return self._down @ (squares @ self._across).view(np.complex64)


@cache
def transform(n: int) -> SquareTransform:
    """The Fourier transform of n x n squares, n even, and nothing else."""
    return SquareTransform(np.eye(n))


def invert(spectra: Spectrum) -> NDArray[np.float32]:
    """(..., n, n) squares of (..., n, n // 2 + 1) spectra."""
    down, across = _inverse(spectra.shape[-2])
    return (down @ spectra).view(np.float32) @ across


def _waves(n: int) -> NDArray[np.complex128]:
    return np.exp(-2j * np.pi / n * np.outer(np.arange(n), np.arange(n)))


@cache
def _inverse(n: int) -> tuple[NDArray[np.complex64], NDArray[np.float32]]:
    """The matrices for columns, and for rows with their halves of real and imaginary parts."""
    waves = np.conj(_waves(n)) / n
    # Those between stand for their counterparts in the other half, too.
    waves[1 : n // 2] *= 2.0
    half = waves[: n // 2 + 1]
    across = np.stack([half.real, -half.imag], axis=1).reshape(-1, n)
    return (np.conj(_waves(n)) / n).astype(np.complex64), across.astype(np.float32)
