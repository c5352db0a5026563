"""Which of some belong to which of others, at the least cost over all of them."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray


def check_installed() -> None:
    """Make sure that there is SciPy, which is imported with the first detections.

    Raises:
        ValueError: It is not installed; the message says how to get it.
    """
    if find_spec("scipy") is None:
        raise ValueError(
            "detections need SciPy: pip install scipy (with ROS from apt: apt install "
            "python3-scipy)"
        )


def assign(costs: NDArray[np.float64], most: float) -> dict[int, int]:
    """Row to column, each at most once.

    Args:
        costs: (N, M) of each pair; infinite for those that cannot be.
        most: What costs this or more is no pair.
    """
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(np.minimum(costs, most))
    return {
        int(row): int(column)
        for row, column in zip(rows, columns, strict=True)
        if costs[row, column] < most
    }
