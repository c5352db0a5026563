"""Size of targets from the ground that they share.

The ground is that of `world/`, without a calibration: the heights of boxes are on a line over their
lower edges.

1. Fit a `HeightLine` to the targets with one label.
2. A target keeps the ratio of its own height to the line. Student's t distribution around that is
   the likelihood of a box, with the variance of a regression's prediction.
3. The residuals set the variance, so that targets on no common ground have little effect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxesByAxis
from pf_tracker_ros.targets.tracks import Track
from pf_tracker_ros.world.height_line import HeightLine

# Minimum number of targets of a ground.
_MIN_TARGETS = 3
# Prior of the relative standard deviation of their heights, and the number of targets that it
# counts as.
_PRIOR_STD, _PRIOR_TARGETS = 0.1, 2.0
# Standard deviation of one target's height over time, relative to that among targets.
_OWN_SHARE = 0.5
# Degrees of freedom of a height: people crouch, and some targets are on no ground.
_DEGREES_OF_FREEDOM = 3.0
# Minimum height of the line, relative to the mean: it ends short of the horizon.
_MIN_HEIGHT = 0.25


@dataclass(frozen=True)
class Ground:
    """Heights of the boxes of targets with one label.

    Attributes:
        line: Over their lower edges.
        std: Standard deviation of a height from the line, pixels.
    """

    line: HeightLine
    std: float

    @classmethod
    def fit(cls, boxes: NDArray[np.float64]) -> Ground | None:
        """The ground of (N, 4) boxes; None for fewer than three."""
        if len(boxes) < _MIN_TARGETS:
            return None
        line = HeightLine.fit(boxes[:, 1] + boxes[:, 3], boxes[:, 3])
        prior = _PRIOR_TARGETS * (_PRIOR_STD * line.height) ** 2
        # The line has two degrees of freedom.
        variance = (prior + line.residual_squares) / (_PRIOR_TARGETS + len(boxes) - 2.0)
        return cls(line, variance**0.5)

    def log_likelihood(
        self, ground_box: NDArray[np.float64], boxes: BoxesByAxis
    ) -> NDArray[np.float64]:
        """Log likelihoods of the heights of boxes, given their lower edges.

        Args:
            ground_box: (4,) last known box of the target on the ground, pixels.
            boxes: In any shape.

        Returns:
            Up to a constant, in a shape that broadcasts to that of the boxes: x does not matter.
        """
        last_edge = ground_box[1] + ground_box[3]
        lower_edges = boxes.y + boxes.height
        line = self._height(lower_edges)
        expected = ground_box[3] * line / self._height(last_edge)
        distance = np.square(lower_edges - last_edge) / self.line.squares
        variance = np.square(_OWN_SHARE * self.std / line) * (1.0 + distance)
        squared = np.square(np.log(np.maximum(boxes.height, 1e-3) / expected)) / variance
        log_likelihoods: NDArray[np.float64] = (
            -(_DEGREES_OF_FREEDOM + 1.0) / 2.0 * np.log1p(squared / _DEGREES_OF_FREEDOM)
        )
        return log_likelihoods

    def _height(self, lower_edges: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Height of the line at lower edges, pixels."""
        return np.maximum(self.line.at(lower_edges), _MIN_HEIGHT * self.line.height)


def fit_grounds(tracks: Sequence[Track]) -> Mapping[str, Ground]:
    """Label to ground, for labels with enough targets."""
    boxes: dict[str, list[NDArray[np.float64]]] = {}
    for track in tracks:
        if track.ground_box is not None:
            boxes.setdefault(track.label, []).append(track.ground_box)
    grounds = {label: Ground.fit(np.array(ground_boxes)) for label, ground_boxes in boxes.items()}
    return {label: ground for label, ground in grounds.items() if ground}
