"""Probability of the pixels in a box to be the target's, from the colors of one image.

Two histograms of colors, of the inner box and of a ring around the box, give
p = inner / (inner + ring) for each color, with both normalized to 1.

Source: Swain and Ballard 1991, "Color Indexing" (histogram backprojection).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.world.depth import BoxSamples

# Levels of a channel.
_SHIFT, _LEVELS = 5, 8
# Width of the ring and side of the inner box, relative to the box.
_RING, _INNER = 0.25, 0.5
# Samples that each color has in advance.
_PRIOR = 2.0


def color_probability(
    image: NDArray[np.generic], box: Box, image_size: tuple[int, int], samples: BoxSamples
) -> NDArray[np.float64] | None:
    """(R, C) probabilities, 0 to 1, of samples of a box; None without a ring in the image.

    Args:
        image: (H, W, 3) uint8 BGR.
        box: In pixels of the camera's image.
        image_size: (width, height) of that.
        samples: Of the box in the image.
    """
    x, y, width, height = box
    wider = (
        x - _RING * width,
        y - _RING * height,
        (1.0 + 2.0 * _RING) * width,
        (1.0 + 2.0 * _RING) * height,
    )
    around = BoxSamples.of(wider, image_size, image.shape)
    if around is None:
        return None
    colors = _colors(around.take(image))
    share = 1.0 / (1.0 + 2.0 * _RING)
    across, down = (2.0 * np.abs(one - 0.5) for one in (around.across, around.down))
    outside = (across[None] > share) | (down[:, None] > share)
    inside = (across[None] < _INNER * share) & (down[:, None] < _INNER * share)
    if not (outside.any() and inside.any()):
        return None
    count = _LEVELS**3
    target = np.bincount(colors[inside], minlength=count) + _PRIOR / count
    background = np.bincount(colors[outside], minlength=count) + _PRIOR / count
    target /= target.sum()
    probability = target / (target + background / background.sum())
    return probability[_colors(samples.take(image))]


def _colors(pixels: NDArray[np.generic]) -> NDArray[np.intp]:
    """(...,) indices of the colors of (..., 3) pixels."""
    levels = (pixels >> np.uint8(_SHIFT)).astype(np.intp)  # type: ignore[operator]
    return (levels[..., 0] * _LEVELS + levels[..., 1]) * _LEVELS + levels[..., 2]
