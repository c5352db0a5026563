"""Color histogram cue: which colors a box holds, wherever in it they are.

Source: Li et al. 2007, section 2.2.1; Perez et al. 2002, "Color-based probabilistic tracking".
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

Place = TypeVar("Place", float, NDArray[np.float64])

# 8 bits number the boxes of one calcHist call, and the colors on one page of a template.
_BOXES_AT_ONCE = 256
_COLORS_PER_PAGE = 255
# Their numbers are kept for a multiple of so many.
_NUMBERED_AT_ONCE = 64
# A bin that old updates left with less than this share of one pixel has faded away.
_FADED = 0.01


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
        histogram: (levels^3,) share of each color, numbered as in `Region.color_bins`, and where
            the background is set apart one more, its share. They sum to the share of the box that
            is inside the image.
        smallest_share: Share of one pixel of the box.
    """

    histogram: NDArray[np.float32]
    smallest_share: float

    @cached_property
    def pages(self) -> tuple[tuple[NDArray[np.uint8], NDArray[np.float32]], ...]:
        """The colors that the histogram holds, up to 255 to a page.

        Returns:
            For each page the label of every color, 1, 2, ... for its own and 0 for all others, and
            the (labels,) square roots of their shares, that of label 0 left out as 0.
        """
        # Of truth values, the nonzero ones are found several times as fast.
        held = (self.histogram > 0.0).nonzero()[0]
        pages = []
        for start in range(0, len(held), _COLORS_PER_PAGE):
            page = held[start : start + _COLORS_PER_PAGE]
            labels = np.zeros(len(self.histogram), dtype=np.uint8)
            labels[page] = np.arange(1, len(page) + 1)
            roots = np.zeros(len(page) + 1, dtype=np.float32)
            np.sqrt(self.histogram[page], out=roots[1:])
            pages.append((labels, roots))
        return tuple(pages)


@CUES.register("color_histogram", ColorHistogramParameters)
class ColorHistogram(Cue):
    """RGB histogram against a template histogram by their Bhattacharyya distance.

    Pixels outside the image match nothing; a gray image counts as R = G = B.

    Args:
        parameters: Sharpness, and how slowly the template changes.
        levels: Steps that each of red, green and blue is divided into, at most 32.
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

    def match(self, seen: ColorTemplate, template: ColorTemplate) -> Match | None:
        """See `Cue.match`; the similarity is the Bhattacharyya coefficient."""
        coefficient = min(float(np.sqrt(seen.histogram * template.histogram).sum()), 1.0)
        return Match(-self._sharpness * (1.0 - coefficient), coefficient)

    @property
    def _colors(self) -> int:
        """How many numbers `_bins` has."""
        return self._levels**3

    def _bins(self, region: Region) -> NDArray[np.intp]:
        """(h, w) number of each pixel's color."""
        return region.color_bins(self._levels)

    def squared_distance(
        self, region: Region, boxes: NDArray[np.float64], template: ColorTemplate
    ) -> NDArray[np.float64]:
        """(N,) squared Bhattacharyya distances d^2, 0 to 1, of (N, 4) boxes from the template.

        Only bins that the template holds add to the coefficient, so pixels are labeled with those,
        and all boxes counted at once by a two-dimensional histogram of (box, label).

        Source: Li et al. 2007, equations (4) and (5).
        """
        samples, repeated = _samples(region.region_boxes(boxes))
        coefficient = np.zeros(len(samples))
        for number, (labels_of_colors, roots) in enumerate(template.pages):

            def label_pixels(table: NDArray[np.uint8] = labels_of_colors) -> NDArray[np.uint8]:
                return region.pad(table.take(self._bins(region)))

            labels = region.cached((template, number), label_pixels)
            coefficient += _root_coefficient(labels, samples, roots)
        squared = 1.0 - np.minimum(coefficient, 1.0)
        return squared if repeated is None else squared[repeated]

    def blend(self, template: ColorTemplate, seen: ColorTemplate) -> ColorTemplate:
        """See `Cue.blend`; source: Li et al. 2007, equation (9)."""
        old, new = np.float32(self._keep), np.float32(1.0 - self._keep)
        blended = old * template.histogram + new * seen.histogram
        _, kept = cv2.threshold(blended, _FADED * seen.smallest_share, 0.0, cv2.THRESH_TOZERO)
        return ColorTemplate(kept.ravel(), seen.smallest_share)


@CUES.register("foreground_color_histogram", ColorHistogramParameters)
class ForegroundColorHistogram(ColorHistogram):
    """Histogram in which all of the background is one color, whatever its pixels look like.

    So the background cannot be taken for the target, and a box must hold as much of it as the
    target's did. Without a background model, no pixel is background.

    Args:
        parameters: As for `ColorHistogram`.
        levels: As for `ColorHistogram`.

    Source: Zhang Bo, section 2 (the foreground is extracted before its colors are counted).
    """

    needs_foreground = True

    def match(self, seen: ColorTemplate, template: ColorTemplate) -> Match | None:
        """See `Cue.match`; the similarity is that of the target's colors alone.

        It is a share of what a perfect match has: a box full of background is not like the target.
        Of a target that had nothing but background in its box, no color is known to tell it by.
        """
        perfect = float(template.histogram[:-1].sum())
        if perfect == 0.0:
            return None
        roots = np.sqrt(seen.histogram * template.histogram)
        return Match(
            -self._sharpness * (1.0 - min(float(roots.sum()), 1.0)),
            min(float(roots[:-1].sum()) / perfect, 1.0),
        )

    @property
    def _colors(self) -> int:
        return self._levels**3 + 1

    def _bins(self, region: Region) -> NDArray[np.intp]:
        """(h, w) number of each pixel's color, the last one for the background."""
        bins, foreground = super()._bins(region), region.foreground_pixels
        if foreground is None:
            return bins
        return region.cached(
            ("foreground color bins", self._levels),
            lambda: np.where(foreground, bins, self._levels**3),
        )


@dataclass(frozen=True, eq=False)
class _Windows:
    """Boxes of one size: exactly their pixels.

    Attributes:
        left: (N,) x of their first pixels.
        top: (N,) y of them.
        columns: Of a box.
        rows: Of a box.
    """

    left: NDArray[np.intp]
    top: NDArray[np.intp]
    columns: int
    rows: int

    def __len__(self) -> int:
        return len(self.left)

    def read(self, labels: NDArray[np.uint8], part: slice) -> NDArray[np.uint8]:
        """(n, pixels) labels in a part of the boxes."""
        height, width = labels.shape
        shape = (height - self.rows + 1, width - self.columns + 1, self.rows, self.columns)
        # The window whose top-left pixel is (y, x) at [y, x]. `sliding_window_view` would give the
        # same, for more time than reading the windows takes.
        windows = np.ndarray(shape, np.uint8, labels, strides=2 * labels.strides)
        top = self.top[part]
        return windows[top, self.left[part]].reshape(len(top), -1)


@dataclass(frozen=True, eq=False)
class _Grids:
    """Boxes of several sizes: the centers of a grid with one cell a pixel in the box of mean size.

    Attributes:
        region_boxes: (N, 4).
        columns: Of the grid.
        rows: Of the grid.
    """

    region_boxes: NDArray[np.float64]
    columns: int
    rows: int

    def __len__(self) -> int:
        return len(self.region_boxes)

    def read(self, labels: NDArray[np.uint8], part: slice) -> NDArray[np.uint8]:
        """(n, cells) labels in a part of the boxes."""
        boxes = self.region_boxes[part]
        x = boxes[:, :1] + (np.arange(self.columns) + 0.5) / self.columns * boxes[:, 2:3]
        y = boxes[:, 1:2] + (np.arange(self.rows) + 0.5) / self.rows * boxes[:, 3:]
        row_starts = y.astype(np.intp) * labels.shape[1]
        places = row_starts[:, :, None] + x.astype(np.intp)[:, None, :]
        return labels.ravel().take(places).reshape(len(boxes), -1)


def _samples(
    region_boxes: NDArray[np.float64],
) -> tuple[_Windows | _Grids, NDArray[np.intp] | None]:
    """What (N, 4) boxes read, those with the same pixels once, and which of it each box has.

    None if each has its own: where they are few or of several sizes, none are left out.
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
    kept, repeated = unique_pairs(left, top)
    return _Windows(left[kept], top[kept], columns, rows), repeated


def _root_coefficient(
    labels: NDArray[np.uint8], samples: _Windows | _Grids, roots: NDArray[np.float32]
) -> NDArray[np.float32]:
    """(N,) sums over all labels of sqrt(share of a box's pixels with that label) * root."""
    coefficient = np.empty(len(samples), dtype=np.float32)
    for start in range(0, len(samples), _BOXES_AT_ONCE):
        part = slice(start, start + _BOXES_AT_ONCE)
        patches = samples.read(labels, part)
        count, pixels = patches.shape
        # Label 0 is counted, too: to pass over a pixel takes longer, as no processor foresees it.
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
    """(count, pixels) with row i full of i."""
    # How many boxes are read differs from frame to frame: with rows to spare, one array does.
    return _numbered_rows(-(-count // _NUMBERED_AT_ONCE) * _NUMBERED_AT_ONCE, pixels)[:count]


@lru_cache(maxsize=4)
def _numbered_rows(count: int, pixels: int) -> NDArray[np.uint8]:
    return np.repeat(np.arange(count, dtype=np.uint8)[:, None], pixels, axis=1)


def _grid(size: Sequence[float]) -> tuple[int, int]:
    """Whole columns and rows of a box of (width, height)."""
    return max(round(size[0]), 1), max(round(size[1]), 1)


def _first_center(start: Place, side: float, count: int) -> Place:
    """Center of the first of as many cells along a side; a box's first pixel is the one there."""
    return start + 0.5 * side / count
