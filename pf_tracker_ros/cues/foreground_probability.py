"""Foreground probability cue: colors of the target that its surroundings do not have.

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

from pf_tracker_ros.cues.cue import Match, SearchableCue, declared_power
from pf_tracker_ros.cues.maps import FrameMaps, nearest_pixel
from pf_tracker_ros.parameters import declared

# The share that inside and ring are granted of every color, so that unseen ones count as undecided.
_PRIOR_SHARE = 1e-4


@dataclass(frozen=True)
class ForegroundProbabilityParameters:
    """The foreground probability cue."""

    power: float = declared_power(0.0)
    levels: int = declared(
        16,
        "Steps that each of red, green and blue is divided into.",
        minimum=2,
        maximum=32,
        read_only=True,
    )
    ring: float = declared(
        0.4,
        "Width of the ring of surroundings on each side of the box.",
        unit="box sides",
        minimum=0.05,
        maximum=3.0,
        read_only=True,
    )
    own_size: bool = declared(
        True,
        "Measure each box as large as it is. Otherwise all are measured in the size that the "
        "target is expected in, so that their contrast tells its place and leaves its size to "
        "another cue.",
    )
    sharpness: float = declared(
        50.0,
        "How fast the likelihood falls as the contrast between box and ring does.",
        minimum=0.0,
        maximum=1000.0,
    )
    keep: float = declared(
        0.92,
        "Share of the old colors of target and surroundings that each tracked frame keeps.",
        minimum=0.0,
        maximum=1.0,
    )


@dataclass(frozen=True, eq=False)
class ForegroundTemplate:
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


Contrast = TypeVar("Contrast", np.float64, NDArray[np.float64])


class ForegroundProbability(SearchableCue):
    """Mean foreground probability of the box minus that of the ring around it.

    Args:
        parameters: Levels, ring and sharpness.
    """

    def __init__(self, parameters: ForegroundProbabilityParameters) -> None:
        self._levels = parameters.levels
        self._ring = parameters.ring
        self._sharpness = parameters.sharpness
        self._keep = parameters.keep
        self._own_size = parameters.own_size

    @property
    def reach(self) -> float:
        """See `Cue.reach`."""
        return self._ring

    @property
    def looks_in_one_size(self) -> bool:
        """See `Cue.looks_in_one_size`."""
        return not self._own_size

    @property
    def steady_keep(self) -> float:
        """See `Cue.steady_keep`: the surroundings change with every step of the target."""
        return self._keep

    @property
    def judges(self) -> bool:
        """See `Cue.judges`: whatever has the target's colors has the contrast."""
        return False

    def learn(self, maps: FrameMaps, box: NDArray[np.float64]) -> ForegroundTemplate:
        """See `Cue.learn`."""
        bins = maps.color_bins(self._levels)
        top, _, left, _ = maps.padding
        (x0, x1), (y0, y1), (outer_x0, outer_x1), (outer_y0, outer_y1) = (
            np.maximum(edges[:, 0] - offset, 0)
            for edges, offset in zip(
                self._edges(maps.region_boxes(box[None])), (left, top, left, top), strict=True
            )
        )
        inside = self._counts(bins[y0:y1, x0:x1])
        ring = self._counts(bins[outer_y0:outer_y1, outer_x0:outer_x1]) - inside
        return ForegroundTemplate(_shares(inside), _shares(ring))

    def strength(
        self, maps: FrameMaps, boxes: NDArray[np.float64], template: ForegroundTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.strength`: the contrast."""
        if not self._own_size:
            size = maps.place[2:]
            boxes = np.hstack(
                [boxes[:, :2] + (boxes[:, 2:] - size) / 2, np.broadcast_to(size, (len(boxes), 2))]
            )
        return self.contrast(maps, boxes, template)

    def log_likelihood_of(
        self, strength: NDArray[np.float64], template: ForegroundTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.log_likelihood_of`."""
        return self._log_likelihood(strength, template)

    def match(self, seen: ForegroundTemplate, template: ForegroundTemplate) -> Match:
        """See `Cue.match`; the similarity is the contrast's share of the target's own."""
        contrast = np.float64((seen.inside - seen.ring) @ template.probabilities)
        share = contrast / template.contrast if template.contrast > 0.0 else 1.0
        return Match(
            float(self._log_likelihood(contrast, template)), float(np.clip(share, 0.0, 1.0))
        )

    def contrast(
        self, maps: FrameMaps, boxes: NDArray[np.float64], template: ForegroundTemplate
    ) -> NDArray[np.float64]:
        """(N,) contrasts, -1 to 1, of (N, 4) boxes; pixels outside the image have probability 0."""

        def integrate() -> NDArray[np.float64]:
            probabilities = template.probabilities.take(maps.color_bins(self._levels))
            return cv2.integral(maps.padded(probabilities), sdepth=cv2.CV_64F)

        integral = maps.shared(template, integrate)
        x, y, outer_x, outer_y = self._edges(maps.region_boxes(boxes))
        inside, area = _sums(integral, x, y)
        outer, outer_area = _sums(integral, outer_x, outer_y)
        return inside / area - (outer - inside) / np.maximum(outer_area - area, 1)

    def blend(
        self, template: ForegroundTemplate, seen: ForegroundTemplate, keep: float
    ) -> ForegroundTemplate:
        """See `Cue.blend`."""
        old, new = np.float32(keep), np.float32(1.0 - keep)
        return ForegroundTemplate(
            old * template.inside + new * seen.inside, old * template.ring + new * seen.ring
        )

    def _log_likelihood(self, contrast: Contrast, template: ForegroundTemplate) -> Contrast:
        missing = np.maximum(template.contrast - contrast, 0.0)
        return -self._sharpness * missing

    def _counts(self, bins: NDArray[np.uint16]) -> NDArray[np.intp]:
        return np.bincount(bins.ravel(), minlength=self._levels**3)

    def _edges(self, region_boxes: NDArray[np.float64]) -> tuple[NDArray[np.intp], ...]:
        """Whole-pixel (2, N) left and right, top and bottom edges of boxes, then of their rings."""
        corners = np.stack([region_boxes[:, :2], region_boxes[:, :2] + region_boxes[:, 2:]])
        ring = self._ring * region_boxes[:, 2:]
        edges = nearest_pixel(corners)
        outer = nearest_pixel(corners + np.stack([-ring, ring]))
        edges[1] = np.maximum(edges[1], edges[0] + 1)
        return edges[..., 0], edges[..., 1], outer[..., 0], outer[..., 1]


def _shares(counts: NDArray[np.intp]) -> NDArray[np.float32]:
    return (counts / max(int(counts.sum()), 1)).astype(np.float32)


def _sums(
    integral: NDArray[np.float64], x: NDArray[np.intp], y: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Sums over N boxes given by their (2, N) edges, and their areas."""
    sums = integral[y[1], x[1]] - integral[y[0], x[1]] - integral[y[1], x[0]] + integral[y[0], x[0]]
    return sums, (x[1] - x[0]) * (y[1] - y[0])
