"""Probability of the pixels in a box to be the target's, from the colors of one image.

Two histograms of colors, of the inner box and of a ring around the box, give
p = inner / (inner + ring) for each color, with both normalized to 1.

Source: Swain and Ballard 1991, "Color Indexing" (histogram backprojection).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.world.box_samples import BoxSamples

# Levels of a channel.
_SHIFT, _LEVELS = 5, 8
# Side of the inner box, relative to the box.
_INNER = 0.5
# Samples that a histogram has in advance, over all colors.
_PRIOR = 2.0


def color_probability(
    image: NDArray[Any], box: Box, image_size: tuple[int, int]
) -> NDArray[np.float64]:
    """(R, C) probabilities, 0 to 1, on a grid over a box.

    Args:
        image: (H, W, 3) uint8 BGR.
        box: In pixels of the camera's image, not outside of it.
        image_size: (width, height) of that.

    Raises:
        ValueError: The image is of another kind.
    """
    is_array = isinstance(image, np.ndarray) and image.ndim == 3 and image.size > 0
    if not is_array or image.shape[2] != 3 or image.dtype != np.uint8:
        raise ValueError("image must be (H, W, 3) uint8 BGR, with pixels")
    samples = BoxSamples.of(as_box(box), image_size, image.shape[:2])
    colors = _colors(samples.take(image))
    in_box = colors[samples.inside]
    is_inner = (np.abs(samples.down - 0.5) < _INNER / 2.0)[:, None] & (
        np.abs(samples.across - 0.5) < _INNER / 2.0
    )
    all_of_box = np.bincount(in_box.ravel(), minlength=_COLORS)
    target = np.bincount(in_box[is_inner], minlength=_COLORS) + _PRIOR / _COLORS
    ring = np.bincount(colors.ravel(), minlength=_COLORS) - all_of_box + _PRIOR / _COLORS
    target /= target.sum()
    probability = target / (target + ring / ring.sum())
    return probability[in_box]


_COLORS = _LEVELS**3


def _colors(pixels: NDArray[Any]) -> NDArray[np.intp]:
    """(...,) indices of the colors of (..., 3) pixels."""
    levels = (pixels >> _SHIFT).astype(np.intp)
    return (levels[..., 0] * _LEVELS + levels[..., 1]) * _LEVELS + levels[..., 2]
