"""Covariance of a box, given that it is on the target.

The particles show how narrow the peak of the likelihood is, not how far the peak is from the truth.
So the scale comes from the errors on annotated footage, and the variation from the frame:

1. The errors are those of the center along x and y, in box widths and heights, and of the
   logarithms of width and height.
2. The logarithm of each standard deviation is linear in three features: logit of the confidence,
   which falls with the width of the peak, and logarithms of the box size and the aspect ratio.
3. The errors of width and height correlate; the other correlations are at most 0.2 and left out.
4. Out of sight, there is no confidence, and a random walk of the motion model adds to the center.

Errors of neighboring frames correlate: by 0.9 from one frame to the next, by 0.5 over fifteen.
A filter that takes each frame as independent becomes overconfident.

Source: Gaussian regression with a variance that depends on the features; maximum likelihood.
`benchmarks/box_covariance.py` fits the coefficients on any footage.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.filter import ParticleSet

# Constant, and slopes over the features of `box_features`, for x, y, log width and log height.
COEFFICIENTS = np.array(
    [
        [-1.350, -0.370, -0.036, 0.184],
        [-1.755, -0.344, 0.186, -0.688],
        [-1.094, -0.256, -0.139, 0.060],
        [-1.050, -0.296, -0.173, -0.668],
    ]
)
# Correlation of the errors of log width and log height.
SIZE_CORRELATION = 0.47
# Range of each feature; values beyond are clamped. The lowest confidence is that of targets out of
# sight: there it gives the errors of their centers.
_CONFIDENCE_RANGE = 0.1, 0.98
_SIZE_RANGE = 8.0, 200.0
_ASPECT_RANGE = 1.0 / 3.0, 3.0
# Box size, pixels, at which its feature is 0.
_NEUTRAL_SIZE = 40.0
# Variance of an error that is uniform within a pixel, px^2.
_ROUNDING_VARIANCE = 1.0 / 12.0


def box_features(box: NDArray[np.float64], confidence: float) -> NDArray[np.float64]:
    """(4,) a constant 1 and the features of a (4,) box, pixels, with a confidence, 0 to 1.

    The confidence is 0 out of sight.
    """
    width, height = box[2:]
    probability = _clamped(confidence, _CONFIDENCE_RANGE)
    size = _clamped(math.sqrt(width * height), _SIZE_RANGE)
    return np.array(
        [
            1.0,
            math.log(probability / (1.0 - probability)),
            math.log(size / _NEUTRAL_SIZE),
            math.log(_clamped(height / width, _ASPECT_RANGE)),
        ]
    )


def _clamped(value: float, limits: tuple[float, float]) -> float:
    return min(max(value, limits[0]), limits[1])


def particle_covariance(particles: ParticleSet, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 4) weighted covariance of centers and sizes of N particles' (N, 4) boxes, px^2.

    It has an inverse, also where all particles have one size or one aspect ratio.
    """
    centers_and_sizes = boxes.copy()
    centers_and_sizes[:, :2] += boxes[:, 2:] / 2
    weights = particles.weights
    offsets = centers_and_sizes - weights @ centers_and_sizes
    covariance: NDArray[np.float64] = (offsets * weights[:, None]).T @ offsets
    return covariance + _ROUNDING_VARIANCE * np.eye(4)


def box_covariance(
    box: NDArray[np.float64], features: NDArray[np.float64], random_walk_std: float = 0.0
) -> NDArray[np.float64]:
    """(4, 4) covariance of center x, center y, width and height of a (4,) box, px^2.

    The (4,) features are those of `box_features`. The standard deviation of the random walk since
    the target was last seen is in box sizes, 0 while it is tracked.
    """
    std = np.exp(COEFFICIENTS @ features) * box[[2, 3, 2, 3]]
    covariance = np.diag(np.square(std))
    covariance[2, 3] = covariance[3, 2] = SIZE_CORRELATION * std[2] * std[3]
    covariance[[0, 1], [0, 1]] += np.square(random_walk_std) * box[2] * box[3]
    return covariance
