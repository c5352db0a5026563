"""Products of matrices that leave the other processors alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

ONE_THREAD = 2**18
"""Multiplications in a matrix product up to which OpenBLAS starts no threads."""


def product(matrix: NDArray[np.float32], columns: NDArray[np.float32]) -> NDArray[np.float32]:
    """The matrix times the columns, in blocks that OpenBLAS computes on one thread.

    Its other threads would keep a processor busy for longer than a whole frame takes.
    """
    block = max(ONE_THREAD // matrix.size, 1)
    result = np.empty((len(matrix), columns.shape[1]), dtype=np.float32)
    for start in range(0, columns.shape[1], block):
        result[:, start : start + block] = matrix @ columns[:, start : start + block]
    return result
