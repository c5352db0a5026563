"""Calibration of the reported confidence for one's own footage.

A confidence c with the log odds x = log(c / (1 - c)) is reported as 1 / (1 + exp(-(a x + b))), with
a scale a > 0 and an offset b. The map keeps the order, so it does not tell right boxes from wrong
ones any better. It changes nothing inside of the filter: all thresholds apply to the confidence
before it, so boxes and states stay the same.

Source: Platt 1999, "Probabilistic outputs for support vector machines and comparisons to
regularized likelihood methods"; `tune --confidence` fits a and b.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.parameters import ParameterError

LEAST_SCALE, LARGEST = 0.01, 20.0
"""Least scale, and largest scale and magnitude of the offset."""

# Confidences closer to 0 or 1 count as this, since those of 0 and 1 are infinite.
_LEAST = 1e-3


def log_odds(confidence: ArrayLike) -> NDArray[np.float64]:
    """Log odds of confidences of any shape, -6.9 to 6.9."""
    limited = np.clip(np.asarray(confidence, dtype=np.float64), _LEAST, 1.0 - _LEAST)
    odds: NDArray[np.float64] = np.log(limited) - np.log1p(-limited)
    return odds


@dataclass(frozen=True)
class ConfidenceCalibration:
    """Scale and offset of the log odds.

    Attributes:
        scale: Scale, 0.01 to 20.
        offset: Offset, -20 to 20.
    """

    scale: float = 1.0
    offset: float = 0.0

    @classmethod
    def of(cls, values: Sequence[float]) -> ConfidenceCalibration:
        """The calibration of the parameter `track.confidence_calibration`.

        Raises:
            ParameterError: The scale is too small.
        """
        scale, offset = values
        if scale < LEAST_SCALE:
            raise ParameterError(
                f"parameter 'track.confidence_calibration' has the scale {scale:g}; allowed: "
                f"{LEAST_SCALE:g} to {LARGEST:g}, as the order of confidences stays"
            )
        return cls(scale, offset)

    def apply(self, confidence: ArrayLike) -> NDArray[np.float64]:
        """Calibrated confidences of any shape, 0 to 1; the same if scale and offset are 1 and 0."""
        if self == ConfidenceCalibration():
            return np.asarray(confidence, dtype=np.float64)
        odds = self.scale * log_odds(confidence) + self.offset
        # tanh stays within 0 to 1 where exp(-odds) would overflow.
        calibrated: NDArray[np.float64] = 0.5 * (1.0 + np.tanh(odds / 2))
        return calibrated
