"""Cross-validation of the confidence: fitted on some groups of sequences, tested on another.

1. Each group of sequences is left out in turn.
2. On the others, a logistic regression fits a factor of each term of the log odds and a constant.
   Sequences weigh as the square root of their number of frames, since neighboring ones are alike.
3. The group left out is tracked with the result.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros import Estimate, Tracker
from pf_tracker_ros.tracking.assessment import AssessedBox, Confidence
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.tracking.track_assessor import TrackAssessor

# Of the factors of standardized terms: two similar terms share their factor.
_NEWTON_STEPS, _REGULARIZATION = 30, 1e-3
_MIN_DEVIATION = 1e-9


Odds = Mapping[str, float]


class RecordedConfidence:
    """Records the log odds of a confidence in each frame.

    Args:
        confidence: The confidence.

    Attributes:
        odds: Term to log odds, for each frame; empty where the box was not assessed, since another
            object covers it.
    """

    def __init__(self, confidence: Confidence) -> None:
        self._confidence = confidence
        self.odds: list[Odds] = []

    def log_odds(self, state: FilterState, assessed: AssessedBox) -> Odds:
        """See `Confidence.log_odds`."""
        self.odds[-1] = self._confidence.log_odds(state, assessed)
        return self.odds[-1]

    def probability(self, state: FilterState, assessed: AssessedBox, odds: Odds) -> float:
        """See `Confidence.probability`."""
        return self._confidence.probability(state, assessed, odds)

    def update(self, before: float, now: float) -> float:
        """See `Confidence.update`."""
        return self._confidence.update(before, now)


class RecordingTracker:
    """A tracker whose confidence in its boxes is recorded, without that of redetection.

    Args:
        preset: Preset of the tracker.
        seed: Its seed.

    Attributes:
        recorded: The recorded confidence.
    """

    def __init__(self, preset: str, seed: int) -> None:
        made: list[RecordedConfidence] = []

        def make_assessor(confidence: Confidence, *others: object) -> TrackAssessor:
            made.append(RecordedConfidence(confidence))
            return TrackAssessor(made[-1], *others)

        with patch("pf_tracker_ros.tracking.target_filter.TrackAssessor", make_assessor):
            self._tracker = Tracker.from_preset(preset, seed)
        self.recorded = made[-1]

    def start(self, image: NDArray[np.generic], box: tuple[float, float, float, float]) -> None:
        """See `Tracker.start`."""
        self._tracker.start(image, box)

    def update(self, image: NDArray[np.generic], dt: float | None = None) -> Estimate:
        """See `Tracker.update`."""
        self.recorded.odds.append({})
        return self._tracker.update(image, dt)


def fitted_tracker(preset: str, weights: Weights, seed: int) -> Tracker:
    """A tracker whose confidence has other weights."""

    class Fitted(Confidence):
        def log_odds(self, state: FilterState, assessed: AssessedBox) -> dict[str, float]:
            return weights.weigh(super().log_odds(state, assessed))

    with patch("pf_tracker_ros.tracking.target_filter.Confidence", Fitted):
        return Tracker.from_preset(preset, seed)


@dataclass(frozen=True)
class Weights:
    """Weights of the questions.

    Attributes:
        factors: Question to the factor of its log odds.
        constant: Log odds to add.
    """

    factors: Mapping[str, float]
    constant: float

    def weigh(self, odds: Odds) -> dict[str, float]:
        """The weighted log odds of a frame."""
        weighed = {name: self.factors.get(name, 1.0) * one for name, one in odds.items()}
        return {**weighed, "constant": self.constant}


@dataclass(frozen=True)
class LabeledOdds:
    """Log odds and labels of F frames.

    Attributes:
        odds: Question to log odds, for each frame.
        is_right: (F,) whether the box was right.
    """

    odds: Sequence[Odds]
    is_right: NDArray[np.bool_]

    @property
    def assessed(self) -> LabeledOdds:
        """The frames with log odds."""
        has_odds = np.array([bool(one) for one in self.odds], dtype=np.bool_)
        return LabeledOdds([one for one in self.odds if one], self.is_right[has_odds])


def fit(runs: Sequence[LabeledOdds]) -> Weights:
    """Fit weights by logistic regression.

    Args:
        runs: Frames of each run.
    """
    runs = [run.assessed for run in runs]
    names = sorted({name for run in runs for odds in run.odds for name in odds})
    # A term that was not evaluated has log odds 0.
    odds = np.array([[one.get(name, 0.0) for name in names] for run in runs for one in run.odds])
    deviations = np.maximum(odds.std(axis=0), _MIN_DEVIATION)
    inputs = np.column_stack([odds / deviations, np.ones(len(odds))])
    is_right = np.concatenate([run.is_right for run in runs])
    counts = np.concatenate([np.full(len(run.odds), float(len(run.odds))) for run in runs])
    weights = counts**-0.5 / (counts**-0.5).sum()
    penalty = _REGULARIZATION * np.eye(len(names) + 1)
    penalty[-1, -1] = 0.0
    factors = np.zeros(len(names) + 1)
    for _ in range(_NEWTON_STEPS):
        probability = 0.5 * (1.0 + np.tanh(inputs @ factors / 2))
        gradient = inputs.T @ (weights * (probability - is_right)) + penalty @ factors
        curvature = (inputs * (weights * probability * (1.0 - probability))[:, None]).T @ inputs
        factors -= np.linalg.solve(curvature + penalty, gradient)
    *scaled, constant = factors.tolist()
    scales = [one / deviation for one, deviation in zip(scaled, deviations.tolist(), strict=True)]
    return Weights(dict(zip(names, scales, strict=True)), constant)
