"""Frozen images: a camera driver that repeats one image under new stamps.

The sensor noise makes any two images of a real camera differ, also of a still scene. So images that
are equal to the bit for some time are not new ones. Generated scenes have no noise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.track_manager import NOMINAL_INTERVAL

DEFAULT_FROZEN_AFTER = 0.5
"""Seconds of equal images after which they are frozen."""

# Rows of the first comparison. Noise shows in them, so that few images are compared as a whole.
_ROWS = 8


class FrozenImages:
    """Measures for how long the images have been equal to the bit, by their stamps."""

    def __init__(self) -> None:
        self._image: NDArray[Any] | None = None
        self._stamp = 0
        self._seconds = 0.0

    def forget(self) -> None:
        """Start anew with the next image, as after a jump of time."""
        self._image = None

    def seconds_unchanged(self, frame: Frame) -> float:
        """Seconds from the first of the equal images to a frame, which must not change any more."""
        image, stamp = frame.image, frame.stamp
        if self._image is not None and _are_equal(self._image, image):
            is_stamped = 0 not in (stamp, self._stamp)
            elapsed = (stamp - self._stamp) / NANOSECONDS if is_stamped else NOMINAL_INTERVAL
            self._seconds += elapsed
        else:
            self._seconds = 0.0
        self._image, self._stamp = image, stamp
        return self._seconds


def _are_equal(one: NDArray[Any], other: NDArray[Any]) -> bool:
    if one.shape != other.shape or one.dtype != other.dtype:
        return False
    step = max(1, len(one) // _ROWS)
    return np.array_equal(one[::step], other[::step]) and np.array_equal(one, other)
