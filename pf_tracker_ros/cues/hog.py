"""Histograms of oriented gradients (HOG) cue: the outline of the target.

1. In each cell of the box, gradient magnitudes are summed per direction, over 180 degrees. A
   gradient and its opposite count alike, so the cue survives polarity changes of infrared images.
2. Blocks of 2 x 2 cells, which overlap by half, are scaled to unit length; all blocks together form
   the descriptor, scaled to a sum of 1.
3. Bhattacharyya distance from the template: D = sqrt(1 - sum sqrt(p q)).
4. Likelihood: exp(-lambda D^2 / 2).

Integral images of each direction give the cells of any number of boxes.

Sources: Zhang et al. 2015, sections 2 and 3.2; Dalal, Triggs 2005, "Histograms of oriented
gradients for human detection".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.cue import CUES, Cue, CueParameters, Match, declared_keep
from pf_tracker_ros.frames import Region
from pf_tracker_ros.frames.region import all_gradients
from pf_tracker_ros.parameters import declared

# Cells along each side of a block, and in a block.
_BLOCK = 2
_CORNERS = _BLOCK**2
# A smaller sum of magnitudes in a cell, half gray levels, is a rounding error.
_ROUNDING = 1e-3


@dataclass(frozen=True)
class HogParameters(CueParameters):
    """The HOG cue."""

    sharpness: float = declared(
        300.0,
        "How fast the likelihood falls with half the squared Bhattacharyya distance (lambda).",
        minimum=0.0,
        maximum=1000.0,
    )
    keep: float = declared_keep(0.995)


@CUES.register("hog", HogParameters)
class Hog(Cue):
    """Bhattacharyya distance of a box's HOG descriptor from the template.

    The template is a descriptor, (4, blocks down, blocks across, bins), the 4 cells of a block in
    reading order. It sums to 1, or to 0 without any gradient. A sum below 1 counts as one more bin
    with the rest.

    Args:
        parameters: Sharpness and rate of template updates.
        cells: Cells (across, down) of the box, each at least 2.
        bins: Direction bins over 180 degrees.
        smoothed: Average each pixel with its neighbors first, for noisy sensors.
    """

    def __init__(
        self,
        parameters: HogParameters,
        *,
        cells: tuple[int, int] = (5, 6),
        bins: int = 16,
        smoothed: bool = True,
    ) -> None:
        self._bins = bins
        self._smoothed = smoothed
        self._sharpness = parameters.sharpness
        self._keep = parameters.keep
        across, down = cells
        self._columns = np.arange(across + 1)[:, None] / across
        self._rows = np.arange(down + 1)[:, None] / down
        # Computed in advance: it takes the time of several frames.
        direction_table(bins)

    def learn(self, region: Region, box: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `Cue.learn`; source: Zhang et al. 2015, section 2."""
        descriptor = normalized_blocks(self._cells(region, box[None]))
        total = descriptor.sum(dtype=np.float64)
        return descriptor[..., 0, :] / np.float64(total if total > 0.0 else 1.0)

    def log_likelihood(
        self, region: Region, boxes: NDArray[np.float64], template: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood`; source: Zhang et al. 2015, equation (9).

        Its constant factor 1 / sqrt(2 pi) is omitted, so a perfect match has likelihood 1; it
        cancels when the weights are normalized, equation (11).
        """
        return -0.5 * self._sharpness * self.squared_distance(region, boxes, template)

    def match(self, observation: NDArray[np.float64], template: NDArray[np.float64]) -> Match:
        """See `Cue.match`; the similarity is 1 - D."""
        coefficient = np.sqrt(observation * template).sum()
        coefficient += np.sqrt(_missing(observation) * _missing(template))
        squared_distance = max(1.0 - float(coefficient), 0.0)
        return Match(-0.5 * self._sharpness * squared_distance, 1.0 - squared_distance**0.5)

    def squared_distance(
        self, region: Region, boxes: NDArray[np.float64], template: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(N,) squared Bhattacharyya distances D^2, 0 to 1, of (N, 4) boxes from the template.

        A cell is in up to four blocks, where its values differ only by the block's length. So the
        products of square roots are computed once per cell, and then summed by block.

        Source: Zhang et al. 2015, equation (8).
        """
        cells = self._cells(region, boxes)
        inverse_lengths = _inverse_lengths(cells)
        total = (_corners(cells.sum(axis=-1)).sum(axis=0) * inverse_lengths).sum(axis=(0, 1))
        products = np.sqrt(cells) @ _roots_by_cell(template)
        by_block = sum(_corners(products)[corner, ..., corner] for corner in range(_CORNERS))
        overlap = (by_block * np.sqrt(inverse_lengths)).sum(axis=(0, 1))
        textured = total > 0.0
        coefficient = np.where(
            textured,
            overlap / np.sqrt(np.where(textured, total, 1.0)),
            np.sqrt(_missing(template)),
        )
        return np.maximum(1.0 - coefficient, 0.0).astype(np.float64)

    def blend(
        self, template: NDArray[np.float64], observation: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """See `Cue.blend`; `keep` 0 replaces the template, as in the paper."""
        return self._keep * template + (1.0 - self._keep) * observation

    def _cells(self, region: Region, boxes: NDArray[np.float64]) -> NDArray[np.float32]:
        """(cells down, cells across, N, bins) sums of gradient magnitude in N boxes."""

        def integrate() -> NDArray[np.int32]:
            differences = region.differences(self._smoothed)
            channels = direction_table(self._bins).take(differences, axis=0)
            return cv2.integral(channels, sdepth=cv2.CV_32S)

        integral = region.cached(("oriented gradients", self._bins, self._smoothed), integrate)
        x, y, width, height = region.region_boxes(boxes).T
        sums = _interpolated(integral, x + self._columns * width, y + self._rows * height)
        cells = np.diff(np.diff(sums, axis=0), axis=1).astype(np.float32)
        # Rounding errors of interpolated sums would be amplified by the block's length.
        cells[cells < _ROUNDING] = 0.0
        return cells


def _interpolated(
    integral: NDArray[np.int32], x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(rows, columns, N, bins) bilinear values of an (h + 1, w + 1, bins) integral image.

    They are at subpixel edges, (columns, N) along x and (rows, N) along y. A pixel counts with the
    share of it inside, so the small cells of a small target change smoothly when a box moves or
    grows by part of a pixel.
    """
    column, row = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
    right = (x - column)[None, :, :, None]
    down = (y - row)[:, None, :, None]
    stride = integral.shape[1]
    flat = integral.reshape(-1, integral.shape[2])
    corner = row[:, None] * stride + column[None]
    above, above_right, below, below_right = (
        flat.take(corner + offset, axis=0) for offset in (0, 1, stride, stride + 1)
    )
    upper = above + (above_right - above) * right
    lower = below + (below_right - below) * right
    return upper + (lower - upper) * down


def normalized_blocks(cells: NDArray[np.float32]) -> NDArray[np.float32]:
    """(4, blocks down, blocks across, N, bins) cells of each block, scaled to its unit length.

    The cells are (cells down, cells across, N, bins) sums of gradient magnitude in N boxes.
    """
    return _corners(cells) * _inverse_lengths(cells)[..., None]


def _corners(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """(4, blocks down, blocks across, ...) values of the cells of each block, in reading order.

    The values are (cells down, cells across, ...).
    """
    down, across = values.shape[0] - 1, values.shape[1] - 1
    return np.stack(
        [values[i : i + down, j : j + across] for i in range(_BLOCK) for j in range(_BLOCK)]
    )


def _inverse_lengths(cells: NDArray[np.float32]) -> NDArray[np.float32]:
    """(blocks down, blocks across, N) 1 / Euclidean length of each block of `normalized_blocks`.

    It is 0 without a gradient.
    """
    squared = _corners(np.einsum("yxnd,yxnd->yxn", cells, cells)).sum(axis=0)
    textured = squared > 0.0
    return np.where(textured, 1.0 / np.sqrt(np.where(textured, squared, 1.0)), 0.0)


def _roots_by_cell(template: NDArray[np.float64]) -> NDArray[np.float32]:
    """(cells down, cells across, bins, 4) square roots of the template, arranged by cell.

    The last axis is the cell's position in a block. Cells at the border are in fewer blocks; the
    rest is 0.
    """
    _, down, across, bins = template.shape
    roots = np.zeros((down + 1, across + 1, bins, _CORNERS), dtype=np.float32)
    for corner in range(_CORNERS):
        i, j = divmod(corner, _BLOCK)
        roots[i : i + down, j : j + across, :, corner] = np.sqrt(template[corner])
    return roots


def _missing(descriptor: NDArray[np.float64]) -> float:
    """1 minus the descriptor's sum, at least 0."""
    return max(1.0 - float(descriptor.sum()), 0.0)


@cache
def direction_table(bins: int) -> NDArray[np.uint8]:
    """(511 * 511, bins) gradient magnitude in each direction bin, by `paired_differences` index.

    Bin k is centered on k * 180 / bins degrees. A gradient at t bins from the nearest center,
    |t| <= 1/2, is shared by three bins with the weights of the quadratic B-spline: 3/4 - t^2 for
    the nearest, (1/2 + t)^2 / 2 for the next on its side, (1/2 - t)^2 / 2 for the other. They sum
    to 1 and are continuous in the direction.

    Magnitudes are in half gray levels, at most 255. The shares are integers with the magnitude as
    their sum, rounded by largest remainder.

    Source: Zhang et al. 2015, section 2.
    """
    magnitudes, angles = all_gradients()
    position = angles % np.pi * (bins / np.pi)
    nearest = np.rint(position)
    t = position - nearest
    shares = np.stack([np.square(0.5 - t) / 2, 0.75 - np.square(t), np.square(0.5 + t) / 2])
    exact = np.minimum(np.rint(2 * magnitudes), 255.0) * shares
    whole = np.floor(exact)
    first, second, third = rest = exact - whole
    # The number of larger remainders; of equal ones, the earlier counts as the larger.
    rank = np.array([second > first, first >= second, first >= third], np.uint8)
    rank += [third > first, third > second, second >= third]
    whole += rank < np.rint(rest.sum(axis=0))
    table = np.zeros((len(angles), bins), dtype=np.uint8)
    for neighbor, counts in zip((-1, 0, 1), whole, strict=True):
        table[np.arange(len(table)), (nearest.astype(np.intp) + neighbor) % bins] = counts
    return table
