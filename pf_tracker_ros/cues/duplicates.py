"""Deduplication of boxes that read the same pixels, so that each is computed once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# For fewer boxes, deduplication costs more than it saves.
DEDUPLICATE_FROM = 256
# With more possible positions per pair than this, duplicates are rare.
_MAX_POSITIONS_PER_PAIR = 16


def unique_pairs(
    x: NDArray[np.intp], y: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of the unique pairs among (N,) pairs of integers, like `numpy.unique`.

    If the pairs are so spread out that duplicates are rare, all pairs are returned.

    Returns:
        (K,) indices of the unique pairs, and (N,) for each pair, the position of its equal among
            these.
    """
    (columns, width), (rows, height) = _ranks(x), _ranks(y)
    if width * height > _MAX_POSITIONS_PER_PAIR * len(x):
        everything = np.arange(len(x))
        return everything, everything
    positions = rows * width + columns
    index_at = np.full(width * height, -1)
    index_at[positions] = np.arange(len(positions))
    unique = index_at[index_at >= 0]
    index_at[positions[unique]] = np.arange(len(unique))
    return unique, index_at[positions]


def _ranks(values: NDArray[np.intp]) -> tuple[NDArray[np.intp], int]:
    """(N,) ranks, from 0, among the distinct values, and the number of distinct values."""
    offsets = values - values.min()
    occurs = np.zeros(int(offsets.max()) + 1, dtype=np.bool_)
    occurs[offsets] = True
    ranks = np.cumsum(occurs) - 1
    return ranks[offsets], int(ranks[-1]) + 1
