"""How large targets are where they stand: what all on one ground have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxesByAxis
from pf_tracker_ros.targets.tracks import Track

# Fewer targets of a kind say nothing of the ground.
_LEAST_TARGETS = 3
# How much such targets usually differ in height, and how many of them that is worth.
_USUALLY_DIFFER, _PRIOR_TARGETS = 0.1, 2.0
# How much the box of a single one changes where it stands, relative to that.
_OWN_SHARE = 0.5
# Degrees of freedom of a height: people crouch, and some targets are on no ground.
_TAIL = 3.0
# Least height that the line may tell, relative to the mean one: it ends short of the horizon.
_LEAST_HEIGHT = 0.25


@dataclass(frozen=True)
class Ground:
    """Where on one ground, things of a kind are as high in the image as they stand low in it.

    For a level ground before a level camera the height of a box is a line over its lower edge, zero
    at the horizon. The line is that of least squares; how far targets are from it tells how much it
    is worth, so that those on no common ground say little.

    Source: the height of an object over a horizon, of Hoiem, Efros and Hebert 2008, "Putting
    Objects in Perspective".

    Attributes:
        lower_edge: Mean of the targets, pixels.
        height: Likewise.
        slope: Of the height over the lower edge.
        deviation: Standard deviation of a height from the line, pixels.
        squares: Sum of the squared distances of the lower edges from their mean, px^2.
    """

    lower_edge: float
    height: float
    slope: float
    deviation: float
    squares: float

    @classmethod
    def fit(cls, boxes: NDArray[np.float64]) -> Ground | None:
        """The ground that (N, 4) boxes stand on; None where they are too few to tell."""
        if len(boxes) < _LEAST_TARGETS:
            return None
        heights = boxes[:, 3]
        lower_edges = boxes[:, 1] + heights
        lower_edge, height = float(lower_edges.mean()), float(heights.mean())
        offsets = lower_edges - lower_edge
        # One pixel more, for those that all stand on one height of the image.
        squares = float(offsets @ offsets) + 1.0
        slope = float(offsets @ heights) / squares
        rest = heights - height - slope * offsets
        usual = _PRIOR_TARGETS * (_USUALLY_DIFFER * height) ** 2
        # The line has taken two of them.
        variance = (usual + float(rest @ rest)) / (_PRIOR_TARGETS + len(boxes) - 2.0)
        return cls(lower_edge, height, slope, variance**0.5, squares)

    def log_likelihood(
        self, ground_box: NDArray[np.float64], boxes: BoxesByAxis
    ) -> NDArray[np.float64]:
        """Of the heights of boxes, where their lower edges are.

        A target keeps its own height relative to the line. The farther it has gone, the less the
        line tells, as with any prediction of a regression.

        Args:
            ground_box: (4,) box of the target when that was known, pixels.
            boxes: In any shape.

        Returns:
            Log likelihoods, up to a constant, in a shape that NumPy brings to that of the boxes:
            where they are across the image does not matter.
        """
        stood_at = ground_box[1] + ground_box[3]
        lower_edges = boxes.y + boxes.height
        there = self._height(lower_edges)
        expected = ground_box[3] * there / self._height(stood_at)
        gone = np.square(lower_edges - stood_at) / self.squares
        variance = np.square(_OWN_SHARE * self.deviation / there) * (1.0 + gone)
        squared = np.square(np.log(np.maximum(boxes.height, 1e-3) / expected)) / variance
        log_likelihoods: NDArray[np.float64] = -(_TAIL + 1.0) / 2.0 * np.log1p(squared / _TAIL)
        return log_likelihoods

    def _height(self, lower_edges: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Of the line."""
        line = self.height + self.slope * (np.asarray(lower_edges) - self.lower_edge)
        return np.maximum(line, _LEAST_HEIGHT * self.height)


def fit_grounds(tracks: Sequence[Track]) -> Mapping[str, Ground]:
    """Label to the ground that its targets stand on, of those of which enough is known."""
    ground_box: dict[str, list[NDArray[np.float64]]] = {}
    for track in tracks:
        if track.ground_box is not None:
            ground_box.setdefault(track.label, []).append(track.ground_box)
    grounds = {label: Ground.fit(np.array(boxes)) for label, boxes in ground_box.items()}
    return {label: ground for label, ground in grounds.items() if ground}
