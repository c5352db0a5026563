"""Calibration of the confidence on sequences with ground truth: `tune --confidence`.

1. Each sequence is tracked with each seed. A frame is right if its box overlaps the target by more
   than half; without a target in the frame, it is wrong.
2. Scale and offset of the log odds are fitted by logistic regression, each sequence with the same
   weight.
3. The same is repeated with each group of sequences left out, and tested there: by the Brier score,
   the mean squared error of the probability, which is proper, so that only the truth gives the
   least.

Source: Platt 1999; see `pf_tracker_ros/tracking/assessment.py`. Expected calibration error: Naeini
et al. 2015, "Obtaining well calibrated probabilities using Bayesian binning".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.tracking.assessment import (
    LARGEST,
    LEAST_SCALE,
    ConfidenceCalibration,
    log_odds,
)
from pf_tracker_ros.tuning.comparison import Comparison

# Ranges of confidence in a reliability table.
_RANGES = 10


@dataclass(frozen=True, eq=False)
class LabeledConfidences:
    """Confidences in a sequence.

    Attributes:
        name: Name of the sequence.
        confidence: (seeds, frames) before or after a calibration, 0 to 1.
        is_right: (seeds, frames) whether the box is on the target.
    """

    name: str
    confidence: NDArray[np.float64]
    is_right: NDArray[np.bool_]

    def calibrated(self, calibration: ConfidenceCalibration) -> LabeledConfidences:
        """The same frames with calibrated confidences."""
        return replace(self, confidence=calibration.apply(self.confidence))

    @property
    def brier_scores(self) -> NDArray[np.float64]:
        """(seeds,) mean squared error of the probability."""
        scores: NDArray[np.float64] = ((self.confidence - self.is_right) ** 2).mean(axis=1)
        return scores


class ReliabilityRow(NamedTuple):
    """Frames with a similar confidence.

    Attributes:
        low: Least confidence.
        high: Confidence of the next range.
        share: Share of all frames.
        confidence: Mean confidence; NaN without frames.
        right: Share of these frames that are right; NaN without frames.
    """

    low: float
    high: float
    share: float
    confidence: float
    right: float


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """A fitted calibration, and what it brings.

    Attributes:
        calibration: Fitted on all sequences.
        before: Confidences before a calibration.
        left_out: The same after the calibrations fitted without each sequence.
    """

    calibration: ConfidenceCalibration
    before: Sequence[LabeledConfidences]
    left_out: Sequence[LabeledConfidences]

    @property
    def comparison(self) -> Comparison:
        """Brier scores before and after, with a negative sign, so that more is better."""
        before, after = (
            np.array([-one.brier_scores for one in side]) for side in (self.before, self.left_out)
        )
        return Comparison([one.name for one in self.before], before, after)

    @property
    def is_better(self) -> bool:
        """Whether the Brier score falls by more than chance on sequences left out.

        Without both right and wrong frames there is nothing to fit a scale to.
        """
        return math.isfinite(roc_area(self.before)) and self.comparison.is_significant


def calibrate(sequences: Sequence[LabeledConfidences], folds: int) -> CalibrationResult:
    """Fit a calibration, and test it on each group of sequences left out.

    Args:
        sequences: At least two, before a calibration.
        folds: Number of groups, in the order given; at most one for each sequence is made.
    """
    left_out: list[LabeledConfidences] = []
    for fold in np.array_split(np.arange(len(sequences)), min(folds, len(sequences))):
        found = fit([one for number, one in enumerate(sequences) if number not in fold])
        left_out += [sequences[number].calibrated(found) for number in fold]
    return CalibrationResult(fit(sequences), sequences, left_out)


def fit(sequences: Sequence[LabeledConfidences]) -> ConfidenceCalibration:
    """The calibration with the largest likelihood, to three digits after the point.

    Args:
        sequences: At least one, before a calibration.
    """
    from scipy.optimize import minimize
    from scipy.special import expit

    odds, is_right, weights = _pooled(sequences)
    odds = log_odds(odds)
    # Platt's targets keep the likelihood finite where all frames are right, or none.
    right, wrong = np.count_nonzero(is_right), np.count_nonzero(~is_right)
    targets = np.where(is_right, (right + 1) / (right + 2), 1 / (wrong + 2))

    def loss(values: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Mean negative log likelihood and its gradient."""
        scaled = values[0] * odds + values[1]
        errors = weights * (expit(scaled) - targets)
        likelihood = weights @ (np.logaddexp(0.0, scaled) - targets * scaled)
        return float(likelihood), np.array([errors @ odds, errors.sum()])

    bounds = [(LEAST_SCALE, LARGEST), (-LARGEST, LARGEST)]
    found = minimize(loss, [1.0, 0.0], jac=True, method="L-BFGS-B", bounds=bounds)
    scale, offset = (round(float(value), 3) for value in found.x)
    return ConfidenceCalibration(scale, offset)


def reliability(sequences: Sequence[LabeledConfidences]) -> list[ReliabilityRow]:
    """The reliability table: how often frames of a confidence are right."""
    confidence, is_right, weights = _pooled(sequences)
    number = np.minimum((confidence * _RANGES).astype(np.intp), _RANGES - 1)
    rows = []
    for one in range(_RANGES):
        share = weights[number == one].sum()
        mean, right = (
            (weights * values)[number == one].sum() / share if share else np.nan
            for values in (confidence, is_right)
        )
        rows.append(ReliabilityRow(one / _RANGES, (one + 1) / _RANGES, share, mean, right))
    return rows


def calibration_error(sequences: Sequence[LabeledConfidences]) -> float:
    """Expected calibration error: mean distance of confidence and share of right frames, 0 to 1."""
    known = [row for row in reliability(sequences) if row.share]
    return float(sum(row.share * abs(row.confidence - row.right) for row in known))


def roc_area(sequences: Sequence[LabeledConfidences]) -> float:
    """Probability that a right frame has more confidence than a wrong one, equal ones by half.

    Returns:
        0 to 1; NaN if all frames are right, or none.
    """
    confidence, is_right, weights = _pooled(sequences)
    values, number = np.unique(confidence, return_inverse=True)
    right, wrong = (
        np.bincount(number, weights * is_it, len(values)) for is_it in (is_right, ~is_right)
    )
    if not right.any() or not wrong.any():
        return float("nan")
    above = right.sum() - np.cumsum(right)
    return float(wrong @ (above + right / 2) / right.sum() / wrong.sum())


def _pooled(
    sequences: Sequence[LabeledConfidences],
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """(F,) confidence, rightness and weight of all frames; those of a sequence weigh the same."""
    return (
        np.concatenate([one.confidence.ravel() for one in sequences]),
        np.concatenate([one.is_right.ravel() for one in sequences]),
        np.concatenate(
            [
                np.full(one.is_right.size, 1.0 / one.is_right.size / len(sequences))
                for one in sequences
            ]
        ),
    )
