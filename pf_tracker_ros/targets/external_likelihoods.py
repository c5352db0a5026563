"""Likelihoods of boxes beside that of the image, which they multiply.

- Detection: a Gaussian around its center, plus the probability that it is wrong. Breitenstein et
  al. 2011, "Online Multiperson Tracking-by-Detection from a Single, Uncalibrated Camera".
- Motion, without a detection: Student's t distribution around the predicted center.
- Occluders: a box on a target in front is less likely than predicted.
- Ground: Student's t distribution around the height that the ground implies. The ground is that of
  `world/`, without a calibration, where heights of boxes are on a line over their lower edges:

  1. Fit a `HeightLine` to the targets with one label.
  2. A target keeps the ratio of its own height to the line. The variance is that of a regression's
     prediction.
  3. The residuals set the variance, so that targets on no common ground have little effect.

All are logarithms, up to a constant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxesByAxis
from pf_tracker_ros.targets.box_kalman_filter import CENTER_STD, IMAGE_CENTER_STD
from pf_tracker_ros.targets.detections import Detection
from pf_tracker_ros.targets.tracks import Track
from pf_tracker_ros.tracking.measurement import ExternalLikelihood
from pf_tracker_ros.world.height_line import HeightLine

# Probability that a detection is not of its target.
_WRONG = 0.02
# Degrees of freedom: targets turn, people crouch, and some are on no ground.
_DEGREES_OF_FREEDOM = 3.0
# Weight of the covered share beyond the predicted one, and the minimum of that one.
_OCCLUDER_WEIGHT, _FREE_COVERAGE = 30.0, 0.2
# Minimum number of targets of a ground.
_MIN_TARGETS = 3
# Prior of the relative standard deviation of their heights, and the number of targets that it
# counts as.
_PRIOR_STD, _PRIOR_TARGETS = 0.1, 2.0
# Standard deviation of one target's height over time, relative to that among targets.
_OWN_SHARE = 0.5
# Minimum height of the line, relative to the mean: it ends short of the horizon.
_MIN_HEIGHT = 0.25


def external_likelihood(
    track: Track,
    detection: Detection | None,
    front: NDArray[np.float64],
    covered: NDArray[np.float64],
    *,
    ground: Ground | None,
    is_alone: bool,
) -> ExternalLikelihood:
    """The product of the likelihoods of a track's boxes, at least one.

    Args:
        track: With its center predicted.
        detection: Its detection, or None.
        front: (K, 4) boxes in front of it.
        covered: (K,) share of its predicted box that each covers.
        ground: Of its label; None where the ground does not count.
        is_alone: Whether its motion does not count; then there is a box in front.
    """
    factors: list[ExternalLikelihood] = []
    if detection:
        factors.append(_detection_likelihood(detection.box))
    elif not is_alone:
        factors.append(_motion_likelihood(track))
    if ground and track.ground_box is not None:
        factors.append(partial(ground.log_likelihood, track.ground_box))
    if len(front):
        factors.append(_occluder_likelihood(front, covered))
    return lambda boxes: reduce(np.add, (factor(boxes) for factor in factors))


def _detection_likelihood(box: NDArray[np.float64]) -> ExternalLikelihood:
    """That of a detection's (4,) box."""
    center, std = box[:2] + box[2:] / 2, CENTER_STD * box[2:]

    def log_likelihood(boxes: BoxesByAxis) -> NDArray[np.float64]:
        x, y, width, height = boxes
        across = np.square((x + width / 2 - center[0]) / std[0])
        down = np.square((y + height / 2 - center[1]) / std[1])
        return np.log(_WRONG + (1.0 - _WRONG) * np.exp(-0.5 * (across + down)))

    return log_likelihood


def _motion_likelihood(track: Track) -> ExternalLikelihood:
    """That of the center that a track's Kalman filter predicts."""
    center, size = track.box_filter.center, track.box[2:]
    variance = track.box_filter.center_variance + np.square(IMAGE_CENTER_STD * size)

    def log_likelihood(boxes: BoxesByAxis) -> NDArray[np.float64]:
        x, y, width, height = boxes
        across = np.square(x + width / 2 - center[0]) / variance[0]
        down = np.square(y + height / 2 - center[1]) / variance[1]
        return _student_t(across + down, 2)

    return log_likelihood


def _occluder_likelihood(
    front: NDArray[np.float64], covered: NDArray[np.float64]
) -> ExternalLikelihood:
    """Lower for boxes that tracks in front cover by more than predicted.

    Args:
        front: (K, 4) boxes, at least one.
        covered: (K,) share of the predicted box that each covers.
    """
    free = np.maximum(covered, _FREE_COVERAGE)

    def log_likelihood(boxes: BoxesByAxis) -> NDArray[np.float64]:
        x, y, width, height = boxes
        area = np.maximum(width * height, 1e-9)
        excess = (
            np.maximum(
                _overlap(x, width, left, across) * _overlap(y, height, top, down) / area - allowed,
                0.0,
            )
            for (left, top, across, down), allowed in zip(front, free, strict=True)
        )
        return -_OCCLUDER_WEIGHT * reduce(np.add, excess)

    return log_likelihood


def _overlap(
    start: NDArray[np.float64], side: NDArray[np.float64], other_start: float, other_side: float
) -> NDArray[np.float64]:
    """Overlap of intervals with another one along one axis, pixels."""
    end = np.minimum(start + side, other_start + other_side)
    return np.maximum(end - np.maximum(start, other_start), 0.0)


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
        return _student_t(squared, 1)

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


def _student_t(squared: NDArray[np.float64], dimensions: int) -> NDArray[np.float64]:
    """Logarithms of Student's t distribution, up to a constant, at squared distances in std."""
    degrees = _DEGREES_OF_FREEDOM
    log_likelihoods: NDArray[np.float64] = (
        -(degrees + dimensions) / 2.0 * np.log1p(squared / degrees)
    )
    return log_likelihoods
