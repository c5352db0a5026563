"""Particles that read the same pixels: what is said of one is said of all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# With fewer, finding those that repeat costs more than it saves.
DEDUPLICATE_FROM = 256
# Where there are more places than this for each pair, hardly any repeats.
_MOST_PLACES = 16


def unique_pairs(
    x: NDArray[np.intp], y: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Which of (N,) pairs of whole numbers are to be looked at, and which stands for each.

    Args:
        x: (N,) of any sign.
        y: (N,) of any sign.

    Returns:
        (K,) numbers of pairs, each different from all others unless they are spread so far that
        hardly any could be equal; and for each of the N pairs the place in that list of one that
        is equal to it.
    """
    (columns, width), (rows, height) = _ranks(x), _ranks(y)
    if width * height > _MOST_PLACES * len(x):
        all_of_them = np.arange(len(x))
        return all_of_them, all_of_them
    places = rows * width + columns
    holder = np.full(width * height, -1)
    holder[places] = np.arange(len(places))
    kept = holder[holder >= 0]
    holder[places[kept]] = np.arange(len(kept))
    return kept, holder[places]


def _ranks(values: NDArray[np.intp]) -> tuple[NDArray[np.intp], int]:
    """(N,) ranks among the different values there are, from 0, and how many these are."""
    offsets = values - values.min()
    there = np.zeros(int(offsets.max()) + 1, dtype=np.bool_)
    there[offsets] = True
    ranks = np.cumsum(there) - 1
    return ranks[offsets], int(ranks[-1]) + 1
