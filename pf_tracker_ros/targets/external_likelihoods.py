"""Likelihoods of boxes beside that of the image, which they multiply.

- Detection: a Gaussian around its center, plus the probability that it is wrong. Breitenstein et
  al. 2011, "Online Multiperson Tracking-by-Detection from a Single, Uncalibrated Camera".
- Motion, without a detection: Student's t distribution around the predicted center.
- Occluders: a box on a target in front is less likely than predicted.

All are logarithms, up to a constant.
"""

from __future__ import annotations

from functools import reduce

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxesByAxis
from pf_tracker_ros.targets.box_kalman_filter import CENTER_STD, IMAGE_CENTER_STD
from pf_tracker_ros.targets.detections import Detection
from pf_tracker_ros.targets.tracks import Track
from pf_tracker_ros.tracking.measurement import ExternalLikelihood

# Probability that a detection is not of its target.
_WRONG = 0.02
# Degrees of freedom: targets turn and stop.
_DEGREES_OF_FREEDOM = 3.0
# Weight of the covered share beyond the predicted one, and the minimum of that one.
_OCCLUDER_WEIGHT, _FREE_COVERAGE = 30.0, 0.2


def external_likelihood(
    track: Track,
    detection: Detection | None,
    front: NDArray[np.float64],
    covered: NDArray[np.float64],
    *,
    is_alone: bool,
) -> ExternalLikelihood:
    """The product of the likelihoods of a track's boxes, at least one.

    The tracks in `front` have (K, 4) boxes; each covers a share `covered`, (K,), of the track's
    predicted box. If the track `is_alone`, its motion does not count; then there is a box in front.
    """
    factors: list[ExternalLikelihood] = []
    if detection:
        factors.append(_detection_likelihood(detection.box))
    elif not is_alone:
        factors.append(_motion_likelihood(track))
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
        # Student's t distribution in two dimensions.
        exponent = -(_DEGREES_OF_FREEDOM + 2) / 2.0
        return exponent * np.log1p((across + down) / _DEGREES_OF_FREEDOM)

    return log_likelihood


def _occluder_likelihood(
    front: NDArray[np.float64], covered: NDArray[np.float64]
) -> ExternalLikelihood:
    """Lower for boxes that (K, 4) boxes in front, K > 0, cover by more than predicted, (K,)."""
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
