"""Histograms of oriented gradients (HOG) cue: the outline of the target, without a sign.

A person who is brighter than the ground and one who is darker have the same outline: directions
are counted over 180 degrees, so the cue outlives the change of polarity that infrared images know.

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

# Cells along each side of a block, and in it; neighboring blocks share half of theirs.
_BLOCK = 2
_CORNERS = _BLOCK**2
# Sums of magnitude in a cell, in halves of a gray level, below which there is none.
_ROUNDING = 1e-3


@dataclass(frozen=True)
class HogParameters(CueParameters):
    """The cue of histograms of oriented gradients (HOG)."""

    sharpness: float = declared(
        300.0,
        "How fast the likelihood falls with half the squared Bhattacharyya distance (lambda).",
        minimum=0.0,
        maximum=1000.0,
    )
    keep: float = declared_keep(0.995)


@CUES.register("hog", HogParameters)
class Hog(Cue):
    """HOG descriptor against a template descriptor by their Bhattacharyya distance.

    The descriptor has one number for each block, cell of the block and direction bin, and sums to
    1, or to 0 for a box without any gradient. What is missing to 1 counts as one more number, the
    share of the box that has no gradient. The template is such a descriptor, (4, blocks down,
    blocks across, bins), the cells of a block in reading order.

    Args:
        parameters: Sharpness, and how slowly the template changes.
        cells: (across, down) the box, each at least 2.
        bins: Direction bins that the 180 degrees are divided into.
        smoothed: Whether each pixel is averaged with its neighbors before the gradients are taken,
            for noisy sensors.
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
        # It takes several frames' time, which the first frame of a target does not have.
        _direction_table(bins)

    def learn(self, region: Region, box: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `Cue.learn`; source: Zhang et al. 2015, section 2."""
        cells = self._cells(region, box[None])
        descriptor = _corners(cells) * _inverse_lengths(cells)[..., None]
        total = descriptor.sum(dtype=np.float64)
        return descriptor[..., 0, :] / np.float64(total if total > 0.0 else 1.0)

    def log_likelihood(
        self, region: Region, boxes: NDArray[np.float64], template: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood`; source: Zhang et al. 2015, equation (9).

        Its constant factor 1 / sqrt(2 pi) cancels in the normalization of the weights, (11), and
        is left out, so that a perfect match has likelihood 1.
        """
        return -0.5 * self._sharpness * self.squared_distance(region, boxes, template)

    def match(self, seen: NDArray[np.float64], template: NDArray[np.float64]) -> Match:
        """See `Cue.match`; the similarity is 1 - D."""
        coefficient = np.sqrt(seen * template).sum()
        coefficient += np.sqrt(_missing(seen) * _missing(template))
        squared_distance = max(1.0 - float(coefficient), 0.0)
        return Match(-0.5 * self._sharpness * squared_distance, 1.0 - squared_distance**0.5)

    def squared_distance(
        self, region: Region, boxes: NDArray[np.float64], template: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(N,) squared Bhattacharyya distances D^2, 0 to 1, of (N, 4) boxes from the template.

        The root of a cell's number is the same in each of the up to four blocks that the cell is
        in, but for the block's length. So roots are taken, and multiplied with the template's
        roots, once a cell, and only the products are put together by block.

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
        self, template: NDArray[np.float64], seen: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """See `Cue.blend`; with a share of 0 the template is replaced, as the paper has it."""
        return self._keep * template + (1.0 - self._keep) * seen

    def _cells(self, region: Region, boxes: NDArray[np.float64]) -> NDArray[np.float32]:
        """(cells down, cells across, N, bins) sums of gradient magnitude in N boxes."""

        def integrate() -> NDArray[np.int32]:
            differences = region.differences(self._smoothed)
            channels = _direction_table(self._bins).take(differences, axis=0)
            return cv2.integral(channels, sdepth=cv2.CV_32S)

        integral = region.cached(("oriented gradients", self._bins, self._smoothed), integrate)
        x, y, width, height = region.region_boxes(boxes).T
        sums = _interpolated(integral, x + self._columns * width, y + self._rows * height)
        cells = np.diff(np.diff(sums, axis=0), axis=1).astype(np.float32)
        # Interpolated sums round, and a block's length would blow up what is left of nothing.
        cells[cells < _ROUNDING] = 0.0
        return cells


def _interpolated(
    integral: NDArray[np.int32], x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(rows, columns, N, bins) sums above and left of edges that may cut through pixels.

    Linear in between, which counts a pixel with the share of it that is above and left: cells of a
    small target, a few pixels large, change with every part of a pixel that a box moves or grows.

    Args:
        integral: (h + 1, w + 1, bins).
        x: (columns, N) edges from left to right.
        y: (rows, N) edges from top to bottom.
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


def _corners(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """(4, blocks down, blocks across, ...) what the cells of each block have, in reading order.

    Args:
        values: (cells down, cells across, ...).
    """
    down, across = values.shape[0] - 1, values.shape[1] - 1
    return np.stack(
        [values[i : i + down, j : j + across] for i in range(_BLOCK) for j in range(_BLOCK)]
    )


def _inverse_lengths(cells: NDArray[np.float32]) -> NDArray[np.float32]:
    """(blocks down, blocks across, N) 1 / Euclidean length of each block; 0 without a gradient.

    Args:
        cells: (cells down, cells across, N, bins).
    """
    squared = _corners(np.einsum("yxnd,yxnd->yxn", cells, cells)).sum(axis=0)
    textured = squared > 0.0
    return np.where(textured, 1.0 / np.sqrt(np.where(textured, squared, 1.0)), 0.0)


def _roots_by_cell(template: NDArray[np.float64]) -> NDArray[np.float32]:
    """(cells down, cells across, bins, 4) roots of what the template has of a cell.

    The last axis is the cell's place in a block; where a cell at the border is in no such block,
    there are zeros.
    """
    _, down, across, bins = template.shape
    roots = np.zeros((down + 1, across + 1, bins, _CORNERS), dtype=np.float32)
    for corner in range(_CORNERS):
        i, j = divmod(corner, _BLOCK)
        roots[i : i + down, j : j + across, :, corner] = np.sqrt(template[corner])
    return roots


def _missing(descriptor: NDArray[np.float64]) -> float:
    """What the descriptor's numbers lack to a sum of 1."""
    return max(1.0 - float(descriptor.sum()), 0.0)


@cache
def _direction_table(bins: int) -> NDArray[np.uint8]:
    """(511 * 511, bins) shares of any two differences' magnitude, numbered as in `Region`.

    Bin k is centered on k * 180 / bins degrees. A gradient t bins off the center of the nearest
    one, at most half a bin, gives it 3/4 - t^2 of its magnitude, the bin towards which it is off
    (1/2 + t)^2 / 2 and the one on the other side (1/2 - t)^2 / 2, the values of the quadratic
    B-spline: they sum to 1, and no share jumps where a gradient turns to another nearest bin.

    The magnitude is in halves of a gray level, at most 255; the shares are whole numbers that sum
    to it, rounded by largest remainder.

    Source: Zhang et al. 2015, section 2.
    """
    magnitudes, angles = all_gradients()
    position = angles % np.pi * (bins / np.pi)
    nearest = np.rint(position)
    off = position - nearest
    shares = np.stack([np.square(0.5 - off) / 2, 0.75 - np.square(off), np.square(0.5 + off) / 2])
    exact = np.minimum(np.rint(2 * magnitudes), 255.0) * shares
    whole = np.floor(exact)
    rank = np.argsort(np.argsort(whole - exact, axis=0, kind="stable"), axis=0)
    whole += rank < np.rint((exact - whole).sum(axis=0))
    table = np.zeros((len(angles), bins), dtype=np.uint8)
    for neighbor, counts in zip((-1, 0, 1), whole, strict=True):
        table[np.arange(len(table)), (nearest.astype(np.intp) + neighbor) % bins] = counts
    return table
