"""Color contrast cue: colors of the target that its surroundings do not have.

A color histogram also counts colors that lie all around the target; here they say nothing. A box
scores by the contrast between its inside and the ring around it, so it is drawn to the target's
place and to its size at once.

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
    declared_keep,
)
from pf_tracker_ros.frames.region import Region, nearest_pixel
from pf_tracker_ros.parameters import declared

# The share that inside and ring are granted of every color, so that unseen ones count as undecided.
_PRIOR_SHARE = 1e-4
# How fast the log odds that it is the target grow, and where they are even: with the Bhattacharyya
# coefficient of a box's colors and the first ones, ...
_LIKENESS_ODDS, _EVEN_LIKENESS = 3.3, 0.4
# ... and with its contrast by the first colors, as a share of what it was then. Gray levels are
# shared by too much for that to tell.
_CONTRAST_ODDS, _EVEN_CONTRAST, _LEAST_CONTRAST_SHARE = 2.8, 0.7, -0.2
# Share of pixels that must not be gray for there to be colors.
_LEAST_COLORED = 0.05
# Targets of less contrast are as their surroundings.
_LEAST_CONTRAST = 1e-3


@dataclass(frozen=True)
class ColorContrastParameters(CueParameters):
    """The color contrast cue."""

    sharpness: float = declared(
        400.0,
        "How fast the likelihood falls as the contrast between box and ring does.",
        minimum=0.0,
        maximum=1000.0,
    )
    keep: float = declared_keep(0.96)


@dataclass(frozen=True, eq=False)
class ContrastTemplate:
    """The colors of the target and of its surroundings.

    Attributes:
        inside: (levels^3,) share of each color among the pixels of the box.
        ring: (levels^3,) share of each color among the pixels of the ring around it.
    """

    inside: NDArray[np.float32]
    ring: NDArray[np.float32]

    @cached_property
    def probabilities(self) -> NDArray[np.float32]:
        """(levels^3,) probability, 0 to 1, that a pixel of each color belongs to the target."""
        inside, ring = self.inside + _PRIOR_SHARE, self.ring + _PRIOR_SHARE
        return (inside / (inside + ring)).astype(np.float32)

    @cached_property
    def contrast(self) -> float:
        """0 to 1: the target's own contrast, and so how much its colors say."""
        return max(float((self.inside - self.ring) @ self.probabilities), 0.0)

    @cached_property
    def is_colored(self) -> bool:
        """Whether there are other colors than grays."""
        levels = round(len(self.inside) ** (1 / 3))
        grays = np.arange(levels) * (levels**2 + levels + 1)
        return float(1.0 - self.inside[grays].sum()) >= _LEAST_COLORED


Contrast = TypeVar("Contrast", np.float64, NDArray[np.float64])


@CUES.register("color_contrast", ColorContrastParameters)
class ColorContrast(SearchableCue):
    """Mean probability that a pixel of the box is the target's, minus that in the ring around it.

    All boxes are measured in the size that the target is expected in: so the contrast tells its
    place, and leaves its size to another cue. Whatever has the target's colors has the contrast.

    Args:
        parameters: Sharpness, and how slowly the template changes.
        levels: Steps that each of red, green and blue is divided into, at most 32.
        ring: Width of the ring of surroundings on each side of the box, box sides.
    """

    uses_center_box_size = True
    is_discriminative = False

    def __init__(
        self, parameters: ColorContrastParameters, *, levels: int = 16, ring: float = 0.4
    ) -> None:
        self._levels = levels
        self._ring = ring
        self._sharpness = parameters.sharpness
        self._keep = parameters.keep

    @property
    def context_margin(self) -> float:
        """See `Cue.context_margin`."""
        return self._ring

    def learn(self, region: Region, box: NDArray[np.float64]) -> ContrastTemplate:
        """See `Cue.learn`."""
        bins = region.color_bins(self._levels)
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
        """See `SearchableCue.response`: the contrast."""
        return self.contrast(region, _in_expected_size(region, boxes), template)

    def response_on_grid(
        self, region: Region, grid: BoxGrid, template: ContrastTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.response_on_grid`."""
        integral = self._integral(region, template)
        row, column = (
            region.region_boxes(_in_expected_size(region, boxes)).T
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
        self, strength: NDArray[np.float64], template: ContrastTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.log_likelihood_of`."""
        return self._log_likelihood(strength, template)

    def match(self, seen: ContrastTemplate, template: ContrastTemplate) -> Match:
        """See `Cue.match`; the similarity is the contrast's share of the target's own."""
        contrast = np.float64((seen.inside - seen.ring) @ template.probabilities)
        share = contrast / template.contrast if template.contrast > 0.0 else 1.0
        return Match(
            float(self._log_likelihood(contrast, template)), min(max(float(share), 0.0), 1.0)
        )

    def log_odds(
        self, seen: ContrastTemplate, template: ContrastTemplate, first: ContrastTemplate
    ) -> dict[str, float]:
        """See `Cue.log_odds`: whether the box has the first colors, and stands out by them."""
        likeness = float(np.sqrt(seen.inside * first.inside).sum())
        odds = {"first colors": _LIKENESS_ODDS * (likeness - _EVEN_LIKENESS)}
        if first.is_colored:
            contrast = float((seen.inside - seen.ring) @ first.probabilities)
            share = contrast / max(first.contrast, _LEAST_CONTRAST)
            share = min(max(share, _LEAST_CONTRAST_SHARE), 1.0)
            odds["contrast by the first colors"] = _CONTRAST_ODDS * (share - _EVEN_CONTRAST)
        return odds

    def contrast(
        self, region: Region, boxes: NDArray[np.float64], template: ContrastTemplate
    ) -> NDArray[np.float64]:
        """(N,) contrasts, -1 to 1, of (N, 4) boxes; pixels outside the image have probability 0."""
        # In memory as it is read, each of x, y, width and height in a row.
        region_boxes = np.ascontiguousarray(region.region_boxes(boxes).T)
        edges = self._edges(region_boxes[:2], region_boxes[2:])
        sides = edges[:, 1] - edges[:, 0]
        area, outer_area = sides[:, 0] * sides[:, 1]
        inside, outer = box_sums(self._integral(region, template), edges[:, :, 0], edges[:, :, 1])
        return _contrast(inside, outer, area, outer_area)

    def blend(self, template: ContrastTemplate, seen: ContrastTemplate) -> ContrastTemplate:
        """See `Cue.blend`."""
        old, new = np.float32(self._keep), np.float32(1.0 - self._keep)
        return ContrastTemplate(
            old * template.inside + new * seen.inside, old * template.ring + new * seen.ring
        )

    def _log_likelihood(self, contrast: Contrast, template: ContrastTemplate) -> Contrast:
        missing = np.maximum(template.contrast - contrast, 0.0)
        return -self._sharpness * missing

    def _counts(self, bins: NDArray[np.intp]) -> NDArray[np.intp]:
        return np.bincount(bins.ravel(), minlength=self._levels**3)

    def _integral(self, region: Region, template: ContrastTemplate) -> NDArray[np.float64]:
        """(h + 1, w + 1) integral image of the probabilities that a pixel is the target's."""

        def integrate() -> NDArray[np.float64]:
            probabilities = template.probabilities.take(region.color_bins(self._levels))
            return cv2.integral(region.pad(probabilities), sdepth=cv2.CV_64F)

        return region.cached(template, integrate)

    def _edges(self, starts: NDArray[np.float64], sides: NDArray[np.float64]) -> NDArray[np.intp]:
        """Whole-pixel edges of boxes and of the rings around them, in region pixels.

        Args:
            starts: (..., N) left or upper edges of the boxes.
            sides: (..., N) widths or heights.

        Returns:
            (2, 2, ..., N): of the boxes, then of the rings; where they start, then where they end.
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


def _in_expected_size(region: Region, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 4) boxes in the size of `Region.center_box`, around the same centers."""
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
    """What the mean over boxes has above that over their rings, from the sums over both."""
    return inside / area - (outer - inside) / np.maximum(outer_area - area, 1)
