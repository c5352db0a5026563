"""Gradient orientation vector cue: the edge directions in each part of a box.

1. The box is divided into cells; in each, the gradient magnitudes are summed per direction, with a
   Gaussian weight around the center of the box.
2. The vector of all sums is scaled to unit length, so contrast does not matter.
3. The likelihood is exp(-mu e^2), with the Euclidean distance e to the template vector.

Integral images of each direction give the sums for any number of boxes at little cost.

Source: Li et al. 2007, section 2.2.2 and equations (7) and (10), after Lowe's keypoint descriptor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.correlation_filter import ONE_THREAD
from pf_tracker_ros.cues.cue import CUES, Cue, CueParameters, Match, declared_keep, declared_weight
from pf_tracker_ros.cues.duplicates import DEDUPLICATE_FROM, unique_pairs
from pf_tracker_ros.frames.region import Region, nearest_pixel
from pf_tracker_ros.parameters import declared

# Parts of a cell along each axis; the Gaussian weight is constant in a part.
_PARTS = 2


@dataclass(frozen=True)
class GradientOrientationParameters(CueParameters):
    """The gradient orientation vector cue."""

    weight: float = declared_weight(0.4)
    sharpness: float = declared(
        20.0,
        "How fast the likelihood falls with the squared Euclidean distance (mu).",
        minimum=0.0,
        maximum=1000.0,
    )
    keep: float = declared_keep(0.9, symbol="beta")


@CUES.register("gradient_orientation", GradientOrientationParameters)
class GradientOrientation(Cue):
    """Euclidean distance of a box's gradient orientation vector from the template.

    The template is a (cells^2 * directions,) vector of unit length; without any gradient it is 0.

    Args:
        parameters: Sharpness and rate of template updates.
        cells: Cells along each side of the box.
        directions: Direction bins over 360 degrees.
        gaussian_width: Standard deviation of the Gaussian weight, box sides.
    """

    def __init__(
        self,
        parameters: GradientOrientationParameters,
        *,
        cells: int = 4,
        directions: int = 8,
        gaussian_width: float = 0.5,
    ) -> None:
        self._cells = cells
        self._directions = directions
        self._sharpness = parameters.sharpness
        self._keep = parameters.keep
        self._part_weights = _part_weights(cells, gaussian_width)
        edges = _PARTS * cells + 1
        self._fractions = np.arange(edges)[:, None, None] / (edges - 1)
        self._boxes_at_once = max(ONE_THREAD // (cells**2 * edges * directions), 1)

    def learn(self, region: Region, box: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `Cue.learn`."""
        sums = self._cell_sums(region, *self._corners(region, box[None])).ravel().astype(np.float64)
        length = math.sqrt(sums @ sums)
        return sums / length if length > 0.0 else sums

    def log_likelihood(
        self, region: Region, boxes: NDArray[np.float64], template: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood`; source: Li et al. 2007, equation (7)."""
        return -self._sharpness * self.squared_distance(region, boxes, template)

    def match(self, observation: NDArray[np.float64], template: NDArray[np.float64]) -> Match:
        """See `Cue.match`; the similarity is 1 - e^2 / 2, for unit vectors their cosine."""
        offset = observation - template
        squared_distance = float(offset @ offset)
        similarity = max(1.0 - squared_distance / 2.0, 0.0)
        return Match(-self._sharpness * squared_distance, similarity)

    def squared_distance(
        self, region: Region, boxes: NDArray[np.float64], template: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(N,) squared Euclidean distances e^2, 0 to 2, of (N, 4) boxes from the template.

        |h - r|^2 = |h|^2 - 2 h.r + |r|^2, with |h| = 1, or 0 in a box without any gradient.
        """
        columns, rows = self._corners(region, boxes)
        positions = None
        if len(boxes) >= DEDUPLICATE_FROM and (boxes[:, 2:] == boxes[0, 2:]).all():
            # Corners of boxes of one size move together, so their sums identify them.
            unique, positions = unique_pairs(columns.sum(axis=0), rows.sum(axis=0))
            columns, rows = columns[:, unique], rows[:, unique]
        sums = self._cell_sums(region, columns, rows)
        reference = template.reshape(-1, self._directions)
        projection = np.einsum("cnd,cd->n", sums, reference.astype(np.float32))
        squared_length = np.einsum("cnd,cnd->n", sums, sums)
        textured = squared_length > 0.0
        cosine = projection / np.sqrt(np.where(textured, squared_length, 1.0))
        squared = np.maximum(textured - 2.0 * cosine + template @ template, 0.0)
        return squared if positions is None else squared[positions]

    def _corners(
        self, region: Region, boxes: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """(corners along each axis, N) columns and rows of the corners of the boxes' parts."""
        # Contiguous in the order of access.
        region_boxes = np.ascontiguousarray(region.region_boxes(boxes).T)
        edges = self._fractions * region_boxes[2:]
        edges += region_boxes[:2]
        corners = nearest_pixel(edges)
        return corners[:, 0], corners[:, 1]

    def _cell_sums(
        self, region: Region, columns: NDArray[np.intp], rows: NDArray[np.intp]
    ) -> NDArray[np.float32]:
        """(cells^2, N, directions) Gaussian-weighted sums of gradient magnitude in N boxes.

        The integral image gives the sum of each part. The weight is a product of one along x and
        one along y, so two matrix products give all cells, in blocks of boxes small enough for one
        thread of OpenBLAS.
        """
        integral = region.gradient_integral(self._directions)
        flat, row_starts = integral.reshape(-1, self._directions), rows * integral.shape[1]
        edges, count = columns.shape
        weights, sums = self._part_weights, []
        for start in range(0, count, self._boxes_at_once):
            part = slice(start, start + self._boxes_at_once)
            corners = row_starts[:, None, part] + columns[:, part]
            values = flat.take(corners, axis=0).reshape(edges, edges, -1)
            # Differences of integers are exact; rounding errors would be texture in flat boxes.
            values = values[1:] - values[:-1]
            values = values[:, 1:] - values[:, :-1]
            across = weights @ values.astype(np.float32, copy=False)
            both = weights @ across.reshape(edges - 1, -1)
            sums.append(both.reshape(self._cells**2, -1, self._directions))
        return sums[0] if len(sums) == 1 else np.concatenate(sums, axis=1)

    def blend(
        self, template: NDArray[np.float64], observation: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """See `Cue.blend`; source: Li et al. 2007, equation (10)."""
        return self._keep * template + (1.0 - self._keep) * observation


def _part_weights(cells: int, gaussian_width: float) -> NDArray[np.float32]:
    """(cells, parts) weight of each part along an axis in each cell.

    There are `_PARTS` * `cells` parts. Each has the Gaussian at its center as its weight in its own
    cell, and 0 in the others.
    """
    parts = _PARTS * cells
    centers = (np.arange(parts) + 0.5) / parts - 0.5
    gaussian = np.exp(-0.5 * np.square(centers / gaussian_width))
    weights = np.zeros((cells, parts))
    for part, weight in enumerate(gaussian):
        weights[part // _PARTS, part] = weight
    return weights.astype(np.float32)
