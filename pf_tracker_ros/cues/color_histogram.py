"""Color histogram cue: the colors in a box, wherever they are in it.

1. Count the box's pixels in levels^3 RGB bins; the histogram p has the shares.
2. Bhattacharyya coefficient with the template q: rho = sum sqrt(p q); distance d = sqrt(1 - rho).
3. Likelihood: exp(-lambda d^2).

Only bins that the template holds contribute to rho. So each pixel gets the label of its bin in the
template, and one two-dimensional histogram of (box, label) counts all boxes at once.

Source: Li et al. 2007, section 2.2.1 and equations (4) to (6) and (9); Perez et al. 2002,
"Color-based probabilistic tracking".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.cue import CUES, Cue, CueParameters, Match, declared_keep, declared_weight
from pf_tracker_ros.cues.duplicates import DEDUPLICATE_FROM, unique_pairs
from pf_tracker_ros.frames import Region
from pf_tracker_ros.parameters import declared

Coordinate = TypeVar("Coordinate", float, NDArray[np.float64])

# 8-bit numbers limit the boxes of one calcHist call, and the labels of one page of a template.
_BOXES_AT_ONCE = 256
_COLORS_PER_PAGE = 255
# Arrays of box numbers are cached for multiples of this.
_CACHED_ROWS_STEP = 64
# A bin with less than this share of one pixel is removed from the template.
_MIN_PIXEL_SHARE = 0.01


@dataclass(frozen=True)
class ColorHistogramParameters(CueParameters):
    """The color histogram cue."""

    weight: float = declared_weight(0.6)
    sharpness: float = declared(
        20.0,
        "How fast the likelihood falls with the squared Bhattacharyya distance (lambda).",
        minimum=0.0,
        maximum=1000.0,
    )
    keep: float = declared_keep(0.9, symbol="beta")


@dataclass(frozen=True, eq=False)
class ColorTemplate:
    """The colors of the target.

    Attributes:
        histogram: (levels^3,) share of each bin of `Region.color_bins`, or (levels^3 + 1,) with the
            background's share last. The sum is the share of the box inside the image.
        pixel_share: Share of one pixel of the box.
    """

    histogram: NDArray[np.float32]
    pixel_share: float

    @cached_property
    def pages(self) -> tuple[tuple[NDArray[np.uint8], NDArray[np.float32]], ...]:
        """Label tables of the nonempty bins, up to 255 bins per page.

        Returns:
            For each page the (bins,) label of every bin: 1, 2, ... for the page's own and 0 for all
            others; and the (labels,) square roots of their shares, 0 for label 0.
        """
        # `nonzero` is several times as fast on booleans.
        nonempty = (self.histogram > 0.0).nonzero()[0]
        pages = []
        for start in range(0, len(nonempty), _COLORS_PER_PAGE):
            page = nonempty[start : start + _COLORS_PER_PAGE]
            labels = np.zeros(len(self.histogram), dtype=np.uint8)
            labels[page] = np.arange(1, len(page) + 1)
            roots = np.zeros(len(page) + 1, dtype=np.float32)
            np.sqrt(self.histogram[page], out=roots[1:])
            pages.append((labels, roots))
        return tuple(pages)


@CUES.register("color_histogram", ColorHistogramParameters)
class ColorHistogram(Cue):
    """Bhattacharyya distance of a box's RGB histogram from the template.

    Pixels outside the image match no bin; gray pixels have R = G = B.

    Args:
        parameters: Sharpness and rate of template updates.
        levels: Levels of each of red, green and blue, at most 32.
    """

    def __init__(self, parameters: ColorHistogramParameters, *, levels: int = 16) -> None:
        self._levels = levels
        self._sharpness = parameters.sharpness
        self._keep = parameters.keep

    def learn(self, region: Region, box: NDArray[np.float64]) -> ColorTemplate:
        """See `Cue.learn`."""
        top, _, left, _ = region.padding
        start_x, start_y, width, height = region.region_boxes(box).tolist()
        columns, rows = _grid((width, height))
        x = int(_first_center(start_x, width, columns)) - left
        y = int(_first_center(start_y, height, rows)) - top
        bins = self._bins(region)
        inside = bins[max(y, 0) : max(y + rows, 0), max(x, 0) : max(x + columns, 0)]
        counts = np.bincount(inside.ravel(), minlength=self._colors).astype(np.float32)
        return ColorTemplate(counts / np.float32(rows * columns), 1.0 / (rows * columns))

    def log_likelihood(
        self, region: Region, boxes: NDArray[np.float64], template: ColorTemplate
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood`; source: Li et al. 2007, equation (6)."""
        return -self._sharpness * self.squared_distance(region, boxes, template)

    def match(self, observation: ColorTemplate, template: ColorTemplate) -> Match | None:
        """See `Cue.match`; the similarity is the Bhattacharyya coefficient."""
        coefficient = min(float(np.sqrt(observation.histogram * template.histogram).sum()), 1.0)
        return Match(-self._sharpness * (1.0 - coefficient), coefficient)

    @property
    def _colors(self) -> int:
        """Number of bins."""
        return self._levels**3

    def _bins(self, region: Region) -> NDArray[np.intp]:
        """(h, w) bin of each pixel."""
        return region.color_bins(self._levels)

    def squared_distance(
        self, region: Region, boxes: NDArray[np.float64], template: ColorTemplate
    ) -> NDArray[np.float64]:
        """(N,) squared Bhattacharyya distances d^2, 0 to 1, of (N, 4) boxes from the template.

        Source: Li et al. 2007, equations (4) and (5).
        """
        samples, positions = _samples(region.region_boxes(boxes))
        coefficient = np.zeros(len(samples))
        for number, (label_table, roots) in enumerate(template.pages):

            def label_pixels(table: NDArray[np.uint8] = label_table) -> NDArray[np.uint8]:
                return region.pad(table.take(self._bins(region)))

            labels = region.cached((template, number), label_pixels)
            coefficient += _root_coefficient(labels, samples, roots)
        squared = 1.0 - np.minimum(coefficient, 1.0)
        return squared if positions is None else squared[positions]

    def blend(self, template: ColorTemplate, observation: ColorTemplate) -> ColorTemplate:
        """See `Cue.blend`; source: Li et al. 2007, equation (9)."""
        old, new = np.float32(self._keep), np.float32(1.0 - self._keep)
        blended = old * template.histogram + new * observation.histogram
        smallest = observation.pixel_share
        _, kept = cv2.threshold(blended, _MIN_PIXEL_SHARE * smallest, 0.0, cv2.THRESH_TOZERO)
        return ColorTemplate(kept.ravel(), smallest)


@CUES.register("foreground_color_histogram", ColorHistogramParameters)
class ForegroundColorHistogram(ColorHistogram):
    """Color histogram with one bin for all background pixels.

    The background cannot match the target's colors, and a box must contain as much background as
    the target's did. Without a background model, no pixel is background.

    Source: Zhang Bo, section 2 (foreground extraction before the color histogram).
    """

    needs_foreground = True

    def match(self, observation: ColorTemplate, template: ColorTemplate) -> Match | None:
        """See `Cue.match`; the similarity is that of the foreground colors, None without any.

        It is divided by that of a perfect match, so a box of background is not similar.
        """
        perfect = float(template.histogram[:-1].sum())
        if perfect == 0.0:
            return None
        roots = np.sqrt(observation.histogram * template.histogram)
        return Match(
            -self._sharpness * (1.0 - min(float(roots.sum()), 1.0)),
            min(float(roots[:-1].sum()) / perfect, 1.0),
        )

    @property
    def _colors(self) -> int:
        return self._levels**3 + 1

    def _bins(self, region: Region) -> NDArray[np.intp]:
        """(h, w) bin of each pixel, the last one for background."""
        bins, foreground = super()._bins(region), region.foreground_pixels
        if foreground is None:
            return bins
        return region.cached(
            ("foreground color bins", self._levels),
            lambda: np.where(foreground, bins, self._levels**3),
        )


@dataclass(frozen=True, eq=False)
class _Windows:
    """Samples of boxes of one size: all their pixels, from (N,) first columns and rows."""

    left: NDArray[np.intp]
    top: NDArray[np.intp]
    columns: int
    rows: int

    def __len__(self) -> int:
        return len(self.left)

    def read(self, labels: NDArray[np.uint8], part: slice) -> NDArray[np.uint8]:
        """(n, pixels) labels in a slice of the boxes."""
        height, width = labels.shape
        shape = (height - self.rows + 1, width - self.columns + 1, self.rows, self.columns)
        # [y, x] is the window with its top-left pixel at (y, x), as by `sliding_window_view`, which
        # takes longer than reading the windows.
        windows = np.ndarray(shape, np.uint8, labels, strides=2 * labels.strides)
        top = self.top[part]
        return windows[top, self.left[part]].reshape(len(top), -1)


@dataclass(frozen=True, eq=False)
class _Grids:
    """Samples of (N, 4) boxes of several sizes, region pixels: a grid in each.

    A grid has one cell per pixel of the mean box.
    """

    region_boxes: NDArray[np.float64]
    columns: int
    rows: int

    def __len__(self) -> int:
        return len(self.region_boxes)

    def read(self, labels: NDArray[np.uint8], part: slice) -> NDArray[np.uint8]:
        """(n, cells) labels in a slice of the boxes."""
        boxes = self.region_boxes[part]
        x = boxes[:, :1] + (np.arange(self.columns) + 0.5) / self.columns * boxes[:, 2:3]
        y = boxes[:, 1:2] + (np.arange(self.rows) + 0.5) / self.rows * boxes[:, 3:]
        row_starts = y.astype(np.intp) * labels.shape[1]
        indices = row_starts[:, :, None] + x.astype(np.intp)[:, None, :]
        return labels.ravel().take(indices).reshape(len(boxes), -1)


def _samples(
    region_boxes: NDArray[np.float64],
) -> tuple[_Windows | _Grids, NDArray[np.intp] | None]:
    """Samples of (N, 4) boxes without duplicates, and (N,) the position of each box in these.

    Few boxes, or boxes of several sizes, are not deduplicated; the positions are then None.
    """
    sizes = region_boxes[:, 2:]
    if not (sizes == sizes[0]).all():
        return _Grids(region_boxes, *_grid(sizes.mean(axis=0).tolist())), None
    width, height = sizes[0].tolist()
    columns, rows = _grid((width, height))
    left = _first_center(region_boxes[:, 0], width, columns).astype(np.intp)
    top = _first_center(region_boxes[:, 1], height, rows).astype(np.intp)
    if len(region_boxes) < DEDUPLICATE_FROM:
        return _Windows(left, top, columns, rows), None
    unique, positions = unique_pairs(left, top)
    return _Windows(left[unique], top[unique], columns, rows), positions


def _root_coefficient(
    labels: NDArray[np.uint8], samples: _Windows | _Grids, roots: NDArray[np.float32]
) -> NDArray[np.float32]:
    """(N,) sums over all labels of sqrt(share of the box's pixels) * root."""
    coefficient = np.empty(len(samples), dtype=np.float32)
    for start in range(0, len(samples), _BOXES_AT_ONCE):
        part = slice(start, start + _BOXES_AT_ONCE)
        patches = samples.read(labels, part)
        count, pixels = patches.shape
        # Counting label 0 too is faster than skipping its pixels.
        counts = cv2.calcHist(
            [_box_numbers(count, pixels), patches],
            [0, 1],
            None,
            [count, len(roots)],
            [0, count, 0, len(roots)],
        )
        coefficient[part] = np.sqrt(counts, out=counts) @ roots
    return coefficient / np.float32(math.sqrt(pixels))


def _box_numbers(count: int, pixels: int) -> NDArray[np.uint8]:
    """(count, pixels) array of row numbers."""
    # The number of boxes varies from frame to frame; spare rows let one cached array serve.
    return _numbered_rows(-(-count // _CACHED_ROWS_STEP) * _CACHED_ROWS_STEP, pixels)[:count]


@lru_cache(maxsize=4)
def _numbered_rows(count: int, pixels: int) -> NDArray[np.uint8]:
    return np.repeat(np.arange(count, dtype=np.uint8)[:, None], pixels, axis=1)


def _grid(size: Sequence[float]) -> tuple[int, int]:
    """Columns and rows of a box of (width, height)."""
    return max(round(size[0]), 1), max(round(size[1]), 1)


def _first_center(start: Coordinate, side: float, count: int) -> Coordinate:
    """Center of the first of `count` cells along a side; it lies in the box's first pixel."""
    return start + 0.5 * side / count
