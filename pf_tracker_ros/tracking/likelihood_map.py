"""How likely the target is at each place around its box, to look at: nothing is tracked by it."""

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

# Side of the square that is looked at, in box sizes, and places along each of its sides.
_WINDOW = 4.0
_CELLS = 32

# From (N, 4) boxes to the (N,) log likelihoods of each cue.
LogLikelihoods = Callable[[NDArray[np.float64]], Mapping[str, NDArray[np.float64]]]


class CueLikelihood(NamedTuple):
    """What one cue says of two boxes.

    Attributes:
        at_target: Log likelihood at the target's box, at most 0.
        at_second_peak: The same at the rival's.
    """

    at_target: float
    at_second_peak: float


@dataclass(frozen=True, eq=False)
class LikelihoodMap:
    """The fused likelihood of boxes of the target's size on a grid around it.

    Attributes:
        extent: (x, y, side, side) that the grid's cells fill, pixels.
        log_likelihood: (rows, columns) fused, at most 0, of a box whose center is that of the cell,
            or the nearest place inside the image.
        second_peak: The likeliest box beside the target, (x, y, width, height) in pixels.
        cues: Name of each cue to what it says of target and rival.
    """

    extent: Box
    log_likelihood: NDArray[np.float64]
    second_peak: Box
    cues: Mapping[str, CueLikelihood]


def boxes_around(box: Box, image_size: tuple[int, int]) -> tuple[SearchGrid, NDArray[np.float64]]:
    """The grid around a box, and the box itself, before (N, 4) boxes of its size on the grid.

    Args:
        box: Pixels.
        image_size: (width, height); no center lies outside.
    """
    size = np.array(box[2:])
    middle = np.array(box[:2]) + size / 2
    spacing = _WINDOW * math.sqrt(size[0] * size[1]) / _CELLS
    grid = SearchGrid(middle, spacing, _CELLS)
    centers = np.clip(np.vstack([middle, grid.centers]), 0.0, image_size)
    return grid, np.hstack([centers - size / 2, np.broadcast_to(size, centers.shape)])


def map_likelihood(
    box: Box, image_size: tuple[int, int], cue_weights: CueWeights, log_likelihoods: LogLikelihoods
) -> LikelihoodMap:
    """Ask the cues about the boxes around a box.

    Args:
        box: Of the target, pixels.
        image_size: (width, height) of the frame.
        cue_weights: Of the cues.
        log_likelihoods: Of the frame.
    """
    grid, boxes = boxes_around(box, image_size)
    of_cues = log_likelihoods(boxes)
    fused = np.zeros(len(boxes))
    for name, values in of_cues.items():
        fused += cue_weights[name] * values
    beside = (np.abs(boxes[:, :2] - boxes[0, :2]) > boxes[0, 2:] / 2).any(axis=1)
    # In an image that the box fills there is nothing beside it.
    second_peak = int(np.argmax(np.where(beside, fused, -np.inf))) if beside.any() else 0
    side = grid.spacing * grid.count
    x, y = grid.center - side / 2
    return LikelihoodMap(
        extent=(float(x), float(y), side, side),
        log_likelihood=fused[1:].reshape(grid.count, grid.count),
        second_peak=as_box(boxes[second_peak]),
        cues={
            name: CueLikelihood(float(values[0]), float(values[second_peak]))
            for name, values in of_cues.items()
        },
    )
