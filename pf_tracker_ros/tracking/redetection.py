"""Where to look for a target that is lost: all over the image, a few windows in each frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.parameters import declared

# Windows overlap by half, so that the target is near enough to the middle of one of them.
_OVERLAP = 0.5
# Steps of this share of a whole row of places visit it evenly, neighbors far apart in time.
_GOLDEN_RATIO = (math.sqrt(5.0) - 1.0) / 2.0


@dataclass(frozen=True)
class RedetectionParameters:
    """Looking all over the image for a target that is lost."""

    windows: int = declared(
        0,
        "Windows of the image, beside the one around the last estimate, that are searched in each "
        "frame while the target is lost; each costs about as much as tracking does. 0 searches "
        "nowhere else, as does 'proposal.search_share' 0.",
        minimum=0,
        maximum=100,
    )
    accept_above: float = declared(
        0.7,
        "Confidence that what is found there must exceed to be taken for the target.",
        minimum=0.0,
        maximum=1.0,
    )


def window_centers(
    image_size: tuple[int, int], side: float, first: int, count: int
) -> NDArray[np.float64]:
    """(count, 2) centers, pixels, of the next windows to look at.

    The windows cover the image and are visited over and over, all before any is visited again, each
    far from the one before.

    Args:
        image_size: (width, height), pixels.
        side: Of a window, pixels.
        first: Number of windows that were looked at before.
        count: How many to look at.
    """
    across, down = (max(math.ceil(length / (side * (1.0 - _OVERLAP))), 1) for length in image_size)
    total = across * down
    stride = max(round(total * _GOLDEN_RATIO), 1)
    while math.gcd(stride, total) > 1:
        stride += 1
    number = np.arange(first, first + count) * stride % total
    places = np.stack([number % across, number // across], axis=1) + 0.5
    return places * np.array([image_size[0] / across, image_size[1] / down])
