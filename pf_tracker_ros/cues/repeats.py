"""Particles that read the same pixels: what is said of one is said of all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# With fewer, finding those that repeat costs more than it saves.
WORTHWHILE = 256


def distinct(x: NDArray[np.intp], y: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Which of (N,) pairs of whole numbers are to be looked at, and which stands for each.

    The cost grows with the ranges of the numbers, so they should be of one neighborhood.

    Args:
        x: (N,) of any sign.
        y: (N,) of any sign.

    Returns:
        (K,) numbers of pairs, each different from all others; and for each of the N pairs the place
        in that list of one that is equal to it.
    """
    left, top = x.min(), y.min()
    columns = int(x.max() - left) + 1
    places = (y - top) * columns + (x - left)
    holder = np.full((int(y.max() - top) + 1) * columns, -1)
    holder[places] = np.arange(len(places))
    held = np.flatnonzero(holder >= 0)
    numbers = np.empty_like(holder)
    numbers[held] = np.arange(len(held))
    return holder[held], numbers[places]
