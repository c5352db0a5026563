"""Color contrast cue: colors that the target has and its surroundings do not.

1. The template has two color histograms: of the box, and of the ring around it.
2. A pixel of color c is the target's with probability P(c) = inside(c) / (inside(c) + ring(c)).
3. The contrast of a box is the mean of P inside minus the mean of P in its ring. An integral image
   of P gives it for any number of boxes at little cost.
4. The log likelihood falls linearly with the contrast that is missing to the template's.

Unlike a color histogram, this cue ignores colors that are also around the target.

Sources: Possegger, Mauthner, Bischof 2015, "In defense of color-based model-free tracking",
section 3.1; Collins, Liu, Leordeanu 2005, "Online selection of discriminative tracking
features".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxGrid
from pf_tracker_ros.cues.cue import (
    CUES,
    CueParameters,
    Match,
    SearchableCue,
    box_sums,
    box_sums_on_grid,
)
from pf_tracker_ros.frames.region import Region, nearest_pixel

# Levels of each of red, green and blue.
_LEVELS = 16
# Added to both histograms, so that unseen colors have probability 1/2.
_PRIOR_SHARE = 1e-4


@dataclass(frozen=True)
class ColorContrastParameters(CueParameters):
    """The color contrast cue."""


@dataclass(frozen=True, eq=False)
class ContrastTemplate:
    """The colors of the target and of its surroundings.

    Attributes:
        inside: (levels^3,) share of each color in the box.
        ring: (levels^3,) share of each color in the ring around it.
    """

    inside: NDArray[np.float32]
    ring: NDArray[np.float32]

    @cached_property
    def probabilities(self) -> NDArray[np.float32]:
        """(levels^3,) probability, 0 to 1, that a pixel of each color is the target's."""
        inside, ring = self.inside + _PRIOR_SHARE, self.ring + _PRIOR_SHARE
        return (inside / (inside + ring)).astype(np.float32)

    @cached_property
    def contrast(self) -> float:
        """The target's own contrast, 0 to 1."""
        return max(float((self.inside - self.ring) @ self.probabilities), 0.0)


Contrast = TypeVar("Contrast", np.float64, NDArray[np.float64])


@CUES.register("color_contrast", ColorContrastParameters)
class ColorContrast(SearchableCue):
    """Contrast of the target's colors between a box and the ring around it.

    All boxes are read in the size of `Region.center_box`: the contrast locates the target, and
    another cue measures its size. Other objects of the same colors have the same contrast.

    Args:
        parameters: Its weight, which the fusion applies.
        ring: Width of the ring on each side of the box, box sides.
        sharpness: How fast the log likelihood falls with a falling contrast.
        keep: Share of the old template that an update keeps.
    """

    uses_center_box_size = True
    is_discriminative = False

    def __init__(
        self,
        parameters: ColorContrastParameters,
        *,
        ring: float = 0.4,
        sharpness: float = 400.0,
        keep: float = 0.96,
    ) -> None:
        self._ring = ring
        self._sharpness = sharpness
        self._keep = keep

    @property
    def context_margin(self) -> float:
        """See `Cue.context_margin`."""
        return self._ring

    def learn(self, region: Region, box: NDArray[np.float64]) -> ContrastTemplate:
        """See `Cue.learn`."""
        bins = region.color_bins(_LEVELS)
        top, _, left, _ = region.padding
        region_box = region.region_boxes(box[None]).T
        edges = self._edges(region_box[:2], region_box[2:])[..., 0]
        inner, outer = np.maximum(edges - (left, top), 0).tolist()
        inside, whole = (
            self._counts(bins[top:bottom, left:right])
            for (left, top), (right, bottom) in (inner, outer)
        )
        ring = whole - inside
        return ContrastTemplate(_shares(inside), _shares(ring))

    def response(
        self, region: Region, boxes: NDArray[np.float64], template: ContrastTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.response`; the response is the contrast."""
        return self.contrast(region, _in_center_box_size(region, boxes), template)

    def response_on_grid(
        self, region: Region, grid: BoxGrid, template: ContrastTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.response_on_grid`."""
        integral = self._integral(region, template)
        row, column = (
            region.region_boxes(_in_center_box_size(region, boxes)).T
            for boxes in (grid.boxes[: len(grid.left)], grid.boxes[:: len(grid.left)])
        )
        columns, rows = self._edges(row[0], row[2]), self._edges(column[1], column[3])
        inside, outer = (
            box_sums_on_grid(integral, *edges) for edges in zip(columns, rows, strict=True)
        )
        widths, heights = columns[:, 1] - columns[:, 0], rows[:, 1] - rows[:, 0]
        area, outer_area = heights[:, :, None] * widths[:, None]
        return _contrast(inside, outer, area, outer_area).ravel()

    def log_likelihood_of(
        self, response: NDArray[np.float64], template: ContrastTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.log_likelihood_of`."""
        return self._log_likelihood(response, template)

    def match(self, observation: ContrastTemplate, template: ContrastTemplate) -> Match:
        """See `Cue.match`; the similarity is the contrast / the template's own contrast."""
        contrast = np.float64((observation.inside - observation.ring) @ template.probabilities)
        share = contrast / template.contrast if template.contrast > 0.0 else 1.0
        return Match(
            float(self._log_likelihood(contrast, template)), min(max(float(share), 0.0), 1.0)
        )

    def contrast(
        self, region: Region, boxes: NDArray[np.float64], template: ContrastTemplate
    ) -> NDArray[np.float64]:
        """(N,) contrasts, -1 to 1, of (N, 4) boxes; pixels outside the image have probability 0."""
        # Contiguous in the order of access.
        region_boxes = np.ascontiguousarray(region.region_boxes(boxes).T)
        edges = self._edges(region_boxes[:2], region_boxes[2:])
        sides = edges[:, 1] - edges[:, 0]
        area, outer_area = sides[:, 0] * sides[:, 1]
        inside, outer = box_sums(self._integral(region, template), edges[:, :, 0], edges[:, :, 1])
        return _contrast(inside, outer, area, outer_area)

    def blend(self, template: ContrastTemplate, observation: ContrastTemplate) -> ContrastTemplate:
        """See `Cue.blend`."""
        old, new = np.float32(self._keep), np.float32(1.0 - self._keep)
        return ContrastTemplate(
            old * template.inside + new * observation.inside,
            old * template.ring + new * observation.ring,
        )

    def _log_likelihood(self, contrast: Contrast, template: ContrastTemplate) -> Contrast:
        missing = np.maximum(template.contrast - contrast, 0.0)
        return -self._sharpness * missing

    def _counts(self, bins: NDArray[np.intp]) -> NDArray[np.intp]:
        return np.bincount(bins.ravel(), minlength=_LEVELS**3)

    def _integral(self, region: Region, template: ContrastTemplate) -> NDArray[np.float64]:
        """(h + 1, w + 1) integral image of the probabilities."""

        def integrate() -> NDArray[np.float64]:
            probabilities = template.probabilities.take(region.color_bins(_LEVELS))
            return cv2.integral(region.pad(probabilities), sdepth=cv2.CV_64F)

        return region.cached(template, integrate)

    def _edges(self, starts: NDArray[np.float64], sides: NDArray[np.float64]) -> NDArray[np.intp]:
        """Whole-pixel edges of boxes and of their rings, in region pixels.

        Args:
            starts: (..., N) left or upper edges of the boxes.
            sides: (..., N) widths or heights.

        Returns:
            (2, 2, ..., N): boxes and rings, then first and last edges.
        """
        edges = np.empty((2, 2, *starts.shape))
        edges[0, 0] = starts
        np.add(starts, sides, out=edges[0, 1])
        np.subtract(starts, self._ring * sides, out=edges[1, 0])
        np.add(starts, (1.0 + self._ring) * sides, out=edges[1, 1])
        whole = nearest_pixel(edges)
        np.maximum(whole[0, 1], whole[0, 0] + 1, out=whole[0, 1])
        return whole


def _shares(counts: NDArray[np.intp]) -> NDArray[np.float32]:
    return (counts / max(int(counts.sum()), 1)).astype(np.float32)


def _in_center_box_size(region: Region, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 4) boxes with the size of `Region.center_box` and the same centers."""
    size = region.center_box[2:]
    resized = boxes.copy()
    resized[:, :2] += (boxes[:, 2:] - size) / 2
    resized[:, 2:] = size
    return resized


def _contrast(
    inside: NDArray[np.float64],
    outer: NDArray[np.float64],
    area: NDArray[np.intp],
    outer_area: NDArray[np.intp],
) -> NDArray[np.float64]:
    """Mean over boxes minus mean over their rings, from the sums inside and in both."""
    return inside / area - (outer - inside) / np.maximum(outer_area - area, 1)
