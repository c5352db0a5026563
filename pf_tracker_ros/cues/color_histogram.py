"""Color histogram cue: which colors a box holds, wherever in it they are.

Source: Li et al. 2007, section 2.2.1; Perez et al. 2002, "Color-based probabilistic tracking".
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from pf_tracker_ros.cues.maps import FrameMaps
from pf_tracker_ros.parameters import declared

# 8 bits each number the particles of one calcHist call and a page of the template's bins.
_PAGE = 255
_CHUNK = 256
# A bin that old updates left with less than this share of one pixel has faded away.
_FADED = 0.01


@dataclass(frozen=True)
class ColorHistogramParameters:
    """The color histogram cue."""

    power: float = declared(
        0.6,
        "Power of this cue in the fused likelihood (alpha_k); 0 switches it off. "
        "The powers of all cues are scaled to a sum of 1.",
        minimum=0.0,
        maximum=1.0,
    )
    levels: int = declared(
        16,
        "Steps that each of red, green and blue is divided into.",
        minimum=2,
        maximum=32,
        read_only=True,
    )
    sharpness: float = declared(
        30.0,
        "How fast the likelihood falls with the squared Bhattacharyya distance (lambda).",
        minimum=0.0,
        maximum=1000.0,
    )


class ColorHistogram:
    """RGB histogram against a template histogram by their Bhattacharyya distance.

    The template is a (levels^3,) histogram whose entries sum to the share of the box that is inside
    the image: pixels outside match nothing.

    Args:
        parameters: Levels and sharpness.
    """

    def __init__(self, parameters: ColorHistogramParameters) -> None:
        self._levels = parameters.levels
        self._sharpness = parameters.sharpness

    def learn(self, maps: FrameMaps, box: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `Cue.learn`."""
        patch = _patches(maps.color_bins(self._levels), maps.region_boxes(box[None]))[0]
        counts = np.bincount(patch.ravel(), minlength=self._levels**3 + 1)
        return counts[:-1] / patch.size

    def log_likelihood(
        self, maps: FrameMaps, boxes: NDArray[np.float64], template: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood`; source: Li et al. 2007, equation (6)."""
        distance = self.distance(maps, boxes, template)
        return -self._sharpness * np.square(distance)

    def distance(
        self, maps: FrameMaps, boxes: NDArray[np.float64], template: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(N,) Bhattacharyya distances, 0 to 1, of (N, 4) boxes from the template.

        Only bins that the template holds add to the coefficient, so pixels are relabeled to those,
        up to 255 at a time, and all boxes counted by one two-dimensional histogram of (box, label).

        Source: Li et al. 2007, equations (4) and (5).
        """
        bins = maps.color_bins(self._levels)
        region_boxes = maps.region_boxes(boxes)
        held = np.flatnonzero(template)
        coefficient = np.zeros(len(boxes))
        for start in range(0, len(held), _PAGE):
            page = held[start : start + _PAGE]
            label_of_bin = np.zeros(self._levels**3 + 1, dtype=np.uint8)
            label_of_bin[page] = np.arange(1, len(page) + 1)
            root = np.sqrt(template[page])
            coefficient += _root_shares(label_of_bin[bins], region_boxes, len(page)) @ root
        return np.sqrt(np.clip(1.0 - coefficient, 0.0, 1.0))

    def blend(
        self, template: NDArray[np.float64], seen: NDArray[np.float64], keep: float
    ) -> NDArray[np.float64]:
        """See `Cue.blend`; source: Li et al. 2007, equation (9)."""
        blended = keep * template + (1.0 - keep) * seen
        smallest_share = seen[seen > 0].min(initial=1.0)
        blended[blended < _FADED * smallest_share] = 0.0
        return blended


def _root_shares(
    labels: NDArray[np.uint8], region_boxes: NDArray[np.float64], label_count: int
) -> NDArray[np.float64]:
    """(N, label_count) square roots of the share of each box's pixels with labels 1, 2, ..."""
    shares = np.empty((len(region_boxes), label_count))
    for start in range(0, len(region_boxes), _CHUNK):
        chunk = region_boxes[start : start + _CHUNK]
        patches = _patches(labels, chunk).reshape(len(chunk), -1)
        box_numbers = np.empty_like(patches)
        box_numbers[:] = np.arange(len(chunk), dtype=np.uint8)[:, None]
        counts = cv2.calcHist(
            [box_numbers, patches],
            [0, 1],
            None,
            [len(chunk), label_count],
            [0, len(chunk), 1, label_count + 1],
        )
        shares[start : start + _CHUNK] = counts / patches.shape[1]
    return np.sqrt(shares)


def _patches(values: NDArray, region_boxes: NDArray[np.float64]) -> NDArray:  # type: ignore[type-arg]
    """(N, rows, columns) of `values` in N boxes, each sampled at the same number of places.

    Boxes of one size give exactly their pixels; boxes of several sizes are sampled at the centers
    of a grid that has one cell a pixel in the box of mean size.
    """
    sizes = region_boxes[:, 2:]
    columns, rows = np.maximum(np.rint(sizes.mean(axis=0)), 1).astype(int)
    if np.ptp(sizes, axis=0).max() == 0.0:
        left, top = np.floor(region_boxes[:, :2] + 0.5 * sizes / (columns, rows)).astype(int).T
        windows: NDArray = sliding_window_view(values, (rows, columns))[top, left]  # type: ignore[type-arg]
        return windows
    x = region_boxes[:, :1] + (np.arange(columns) + 0.5) / columns * sizes[:, :1]
    y = region_boxes[:, 1:2] + (np.arange(rows) + 0.5) / rows * sizes[:, 1:]
    row_starts = np.floor(y).astype(np.intp) * values.shape[1]
    places = row_starts[:, :, None] + np.floor(x).astype(np.intp)[:, None, :]
    return values.reshape(-1).take(places)
