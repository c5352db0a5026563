"""Color contrast cue: colors that the target has and its surroundings do not.

1. The template has two color histograms: of the box, and of the ring around it.
2. A pixel of color c is the target's with probability P(c) = inside(c) / (inside(c) + ring(c)).
3. The contrast of a box is the mean of P inside minus the mean of P in its ring. Two box filters of
   P give it everywhere, and any number of boxes read it there at little cost.
4. The log likelihood falls linearly with the contrast that is missing to the template's.

Unlike a color histogram, this cue ignores colors that are also around the target.

Sources: Possegger, Mauthner, Bischof 2015, "In defense of color-based model-free tracking",
section 3.1; Collins, Liu, Leordeanu 2005, "Online selection of discriminative tracking
features".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.cue import CUES, CueParameters, Match, SearchableCue
from pf_tracker_ros.frames.region import Region, nearest_pixel, read_map

# Levels of each of red, green and blue.
_LEVELS = 16
# Added to both histograms, so that unseen colors have probability 1/2.
_PRIOR_SHARE = 1e-4


@dataclass(frozen=True)
class ColorContrastParameters(CueParameters):
    """The color contrast cue."""


@dataclass(frozen=True, eq=False)
class ContrastTemplate:
    """(levels^3,) share of each color in the box of the target, and in the ring around it."""

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
        start = nearest_pixel(region.region_points(box[:2])) - (left, top)
        sides, margins = self._whole_sides(region, box)

        def counts(first: NDArray[np.intp], last: NDArray[np.intp]) -> NDArray[np.intp]:
            """Of the colors from the first pixel (x, y) to before the last one."""
            (left, top), (right, bottom) = np.maximum([first, last], 0).tolist()
            return np.bincount(bins[top:bottom, left:right].ravel(), minlength=_LEVELS**3)

        inside = counts(start, start + sides)
        whole = counts(start - margins, start + sides + margins)
        return ContrastTemplate(_shares(inside), _shares(whole - inside))

    def response(
        self, region: Region, boxes: NDArray[np.float64], template: ContrastTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.response`; the response is the contrast."""
        contrasts = self._contrasts(region, template)
        # Of the same centers, in the size of the center box.
        corners = boxes[:, :2] + (boxes[:, 2:] - region.center_box[2:]) / 2
        points = region.region_points(corners).astype(np.float32)
        return read_map(contrasts, points).astype(np.float64)

    def log_likelihood_of(
        self, response: NDArray[np.float64], template: ContrastTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.log_likelihood_of`."""
        missing = np.maximum(template.contrast - response, 0.0)
        return -self._sharpness * missing

    def match(self, observation: ContrastTemplate, template: ContrastTemplate) -> Match:
        """See `Cue.match`; the similarity is the contrast / the template's own contrast."""
        contrast = float((observation.inside - observation.ring) @ template.probabilities)
        share = contrast / template.contrast if template.contrast > 0.0 else 1.0
        log_likelihood = self.log_likelihood_of(np.array([contrast]), template)
        return Match(float(log_likelihood[0]), min(max(share, 0.0), 1.0))

    def blend(self, template: ContrastTemplate, observation: ContrastTemplate) -> ContrastTemplate:
        """See `Cue.blend`."""
        old, new = np.float32(self._keep), np.float32(1.0 - self._keep)
        return ContrastTemplate(
            old * template.inside + new * observation.inside,
            old * template.ring + new * observation.ring,
        )

    def _contrasts(self, region: Region, template: ContrastTemplate) -> NDArray[np.float32]:
        """(h, w) contrast, -1 to 1, of the box with each pixel of the region as its first one.

        Pixels outside the image have probability 0.
        """

        def compute() -> NDArray[np.float32]:
            probabilities = region.pad(template.probabilities.take(region.color_bins(_LEVELS)))
            (width, height), (across, down) = (
                sides.tolist() for sides in self._whole_sides(region, region.center_box)
            )
            outer_width, outer_height = width + 2 * across, height + 2 * down
            inside, both = (
                cv2.boxFilter(
                    probabilities, -1, size, anchor=anchor, borderType=cv2.BORDER_CONSTANT
                )
                for size, anchor in (
                    ((width, height), (0, 0)),
                    ((outer_width, outer_height), (across, down)),
                )
            )
            outer_area = outer_width * outer_height
            # The ring's mean is (outer_area both - area inside) / (outer_area - area).
            return (inside - both) * np.float32(outer_area / (outer_area - width * height))

        return region.cached((self, template), compute)

    def _whole_sides(
        self, region: Region, box: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """(2,) sides of a (4,) box, and (2,) widths of its ring, whole region pixels."""
        sides = region.region_boxes(box[None])[0, 2:]
        return np.maximum(nearest_pixel(sides), 1), np.maximum(nearest_pixel(self._ring * sides), 1)


def _shares(counts: NDArray[np.intp]) -> NDArray[np.float32]:
    return (counts / max(int(counts.sum()), 1)).astype(np.float32)
