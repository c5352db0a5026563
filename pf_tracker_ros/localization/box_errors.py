"""Errors of a tracker's box that last, beyond those that its covariance tells.

1. The size of a box follows that of a target that comes near or goes away, but later. So while it
   grows or shrinks, its error is about as large as what it has changed: the logarithm of the height
   less its mean over the last seconds.
2. Also while it does not change, the size of a box keeps a part of an earlier error.
3. The middle of a box is not above the place where the target stands, as people make steps.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.stamps import NANOSECONDS

# Time constant of the mean of the logarithm of the height, seconds, and standard deviation of the
# error of the size, of its difference from the mean.
_MEMORY, _LAG = 2.0, 0.5
# Standard deviations that last: of the size, a share of it, and of the middle, box heights.
_SIZE_SD, _MIDDLE_SD = 0.06, 0.03


class BoxErrors:
    """Errors of the boxes of one target."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the earlier boxes."""
        self._stamp: int | None = None
        self._mean = 0.0

    def add(self, stamp: int, box: Box, covariance: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take the box of a frame; its covariance with all errors.

        Args:
            stamp: Of the frame, later than the last one, nanoseconds.
            box: (x, y, width, height), pixels.
            covariance: (4, 4) of center x, center y, width and height, px^2.

        Returns:
            (4, 4).

        Raises:
            ValueError: The height is no positive, finite number.
        """
        width, height = box[2:]
        if not 0.0 < height < math.inf:
            raise ValueError(f"the height of the box is {height!r}; expected a positive number")
        size = math.log(height)
        if self._stamp is None:
            self._mean = size
        else:
            interval = (stamp - self._stamp) / NANOSECONDS
            self._mean += -math.expm1(-interval / _MEMORY) * (size - self._mean)
        self._stamp = stamp
        scaled = math.hypot(_LAG * (size - self._mean), _SIZE_SD) * np.array([width, height])
        total = covariance.copy()
        total[0, 0] += (_MIDDLE_SD * height) ** 2
        total[2:, 2:] += np.outer(scaled, scaled)
        return total
