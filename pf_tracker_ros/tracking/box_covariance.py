"""Covariance of a box, given that it is on the target.

The particles show how narrow the peak of the likelihood is, not how far the peak is from the truth.
So the scale comes from the errors on annotated footage, and the variation from the frame:

1. The errors are those of the center along x and y, in box widths and heights, and of the
   logarithms of width and height.
2. The logarithm of each standard deviation is linear in four features: logit of the confidence,
   logarithms of the standard deviations of the particles near the box along x and y, and logarithm
   of the box size.
3. The errors of width and height correlate; the other correlations are below 0.12 and left out.
4. Out of sight, there is no peak and no confidence, and a random walk of the motion model adds to
   the center.

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
        [-1.264, -0.260, 0.334, -0.167, -0.006],
        [-2.043, -0.183, -0.302, 0.380, 0.059],
        [-1.036, -0.184, 0.231, -0.116, -0.150],
        [-2.057, -0.198, -0.437, 0.292, -0.342],
    ]
)
# Correlation of the errors of log width and log height.
SIZE_CORRELATION = 0.44
# Range of each feature on the footage; values beyond are clamped.
_CONFIDENCE_RANGE = 0.02, 0.98
_STD_RANGE = 0.01, 1.0
_SIZE_RANGE = 8.0, 200.0
# Box size, pixels, at which its feature is 0.
_NEUTRAL_SIZE = 40.0
# Standard deviation without a peak of the likelihood at the box.
NO_PEAK = np.ones(2)


def peak_std(
    box: NDArray[np.float64], boxes: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(2,) standard deviation of the particles near a box along x and y, box widths and heights.

    Args:
        box: (4,) x, y, width, height of the target, pixels.
        boxes: (N, 4) boxes of the particles, pixels.
        weights: (N,) weights of the particles.
    """
    offsets = (boxes[:, :2] + boxes[:, 2:] / 2 - box[:2] - box[2:] / 2) / box[2:]
    near = weights * (np.abs(offsets) < 0.5).all(axis=1)
    total = near.sum()
    if total == 0.0:
        return NO_PEAK
    near = near / total
    return np.sqrt(near @ np.square(offsets - near @ offsets))


def box_features(
    box: NDArray[np.float64], confidence: float, std: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(5,) a constant 1 and the features of a frame.

    Args:
        box: (4,) x, y, width, height of the target, pixels.
        confidence: Confidence in it, 0 to 1.
        std: (2,) from `peak_std`, or `NO_PEAK`.
    """
    probability = min(max(confidence, _CONFIDENCE_RANGE[0]), _CONFIDENCE_RANGE[1])
    size = min(max(math.sqrt(box[2] * box[3]), _SIZE_RANGE[0]), _SIZE_RANGE[1])
    return np.array(
        [
            1.0,
            math.log(probability / (1.0 - probability)),
            *np.log(np.minimum(np.maximum(std, _STD_RANGE[0]), _STD_RANGE[1])),
            math.log(size / _NEUTRAL_SIZE),
        ]
    )


def particle_covariance(particles: ParticleSet, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 4) weighted covariance of the particles' centers and sizes, px^2.

    Args:
        particles: Particles whose first two columns are the center.
        boxes: (N, 4) of the particles, pixels.
    """
    centered = boxes.copy()
    centered[:, :2] += boxes[:, 2:] / 2
    centered -= particles.weights @ centered
    covariance = (centered * particles.weights[:, None]).T @ centered
    covariance[:2, :2] = particles.covariance[:2, :2]
    return covariance


def box_covariance(
    box: NDArray[np.float64], features: NDArray[np.float64], random_walk_std: float = 0.0
) -> NDArray[np.float64]:
    """(4, 4) covariance of center x, center y, width and height, px^2.

    Args:
        box: (4,) x, y, width, height, pixels.
        features: (5,) from `box_features`.
        random_walk_std: Standard deviation of the random walk since the target was last seen, box
            sizes; 0 while it is tracked.
    """
    std = np.exp(COEFFICIENTS @ features) * box[[2, 3, 2, 3]]
    covariance = np.diag(np.square(std))
    covariance[2, 3] = covariance[3, 2] = SIZE_CORRELATION * std[2] * std[3]
    covariance[[0, 1], [0, 1]] += np.square(random_walk_std) * box[2] * box[3]
    return covariance
