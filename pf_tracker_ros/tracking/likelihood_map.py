"""The fused likelihood on a grid around the target, for display only.

Each cell holds the log likelihood of the target's box with its center there, Li et al. 2007,
equation (8).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.cues.fusion import CueWeights
from pf_tracker_ros.filter import SearchGrid

# Side of the map, box sizes, and its number of cells along each axis.
_WINDOW = 4.0
_CELLS = 32

# From (N, 4) boxes to the (N,) log likelihoods of each cue.
LogLikelihoods = Callable[[NDArray[np.float64]], Mapping[str, NDArray[np.float64]]]


class CueLikelihood(NamedTuple):
    """One cue's log likelihoods, at most 0, of the boxes of the target and of the second peak."""

    at_target: float
    at_second_peak: float


@dataclass(frozen=True, eq=False)
class LikelihoodMap:
    """The fused likelihood of boxes of the target's size on a grid around it.

    Attributes:
        extent: (x, y, side, side) of the grid, pixels.
        log_likelihood: (rows, columns) fused, at most 0, of a box with its center in that cell;
            centers are clamped to the image.
        second_peak: The likeliest box beside the target, (x, y, width, height) in pixels.
        cues: Name of each cue to its log likelihood of target and second peak.
    """

    extent: Box
    log_likelihood: NDArray[np.float64]
    second_peak: Box
    cues: Mapping[str, CueLikelihood]


def map_likelihood(
    box: Box, image_size: tuple[int, int], cue_weights: CueWeights, log_likelihoods: LogLikelihoods
) -> LikelihoodMap:
    """The likelihood map around a box."""
    size = np.array(box[2:])
    middle = np.array(box[:2]) + size / 2
    grid = SearchGrid(middle, _WINDOW * math.sqrt(size[0] * size[1]) / _CELLS, _CELLS)
    # The target's box first, then those of the grid.
    centers = np.clip(np.vstack([middle, grid.centers]), 0.0, image_size)
    boxes = np.hstack([centers - size / 2, np.broadcast_to(size, centers.shape)])
    cues = log_likelihoods(boxes)
    fused = np.zeros(len(boxes))
    for name, values in cues.items():
        fused += cue_weights[name] * values
    beside = (np.abs(boxes[:, :2] - boxes[0, :2]) > boxes[0, 2:] / 2).any(axis=1)
    # Nothing is beside a box that fills the image.
    second_peak = int(np.argmax(np.where(beside, fused, -np.inf))) if beside.any() else 0
    side = grid.spacing * grid.count
    x, y = grid.center - side / 2
    return LikelihoodMap(
        extent=(float(x), float(y), side, side),
        log_likelihood=fused[1:].reshape(grid.count, grid.count),
        second_peak=as_box(boxes[second_peak]),
        cues={
            name: CueLikelihood(float(values[0]), float(values[second_peak]))
            for name, values in cues.items()
        },
    )
