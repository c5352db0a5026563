"""Sums over boxes, read from an integral image at their corners."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Value = TypeVar("Value", np.int32, np.float64)


def sums(
    integral: NDArray[Value], columns: NDArray[np.intp], rows: NDArray[np.intp]
) -> NDArray[Value]:
    """(..., N) sums over boxes.

    Args:
        integral: (h + 1, w + 1), the sum over all pixels above and left of each place.
        columns: (..., 2, N) where each box starts and where it ends, 0 to w.
        rows: (..., 2, N) the same down, 0 to h.
    """
    starts = rows * integral.shape[1]
    corners = integral.ravel().take(starts[..., :, None, :] + columns[..., None, :, :])
    across = corners[..., 1, :] - corners[..., 0, :]
    added: NDArray[Value] = across[..., 1, :] - across[..., 0, :]
    return added


def sums_on_grid(
    integral: NDArray[Value], columns: NDArray[np.intp], rows: NDArray[np.intp]
) -> NDArray[Value]:
    """(R, C) sums over boxes in rows and columns.

    Args:
        integral: As for `sums`.
        columns: (2, C) where the boxes of each column start and where they end.
        rows: (2, R) the same of each row.
    """
    down = integral.take(rows[1], axis=0)
    down -= integral.take(rows[0], axis=0)
    return down.take(columns[1], axis=1) - down.take(columns[0], axis=1)
