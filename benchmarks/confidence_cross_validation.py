"""Cross-validation of the confidence: fitted on some groups of sequences, tested on another.

1. Each group of sequences is left out in turn.
2. On the others, each question of the confidence is divided by its standard deviation.
3. A logistic regression fits a factor and a constant of their sum. Groups have equal weight, and
   in each group right and wrong frames do, as their ratio does not carry over to other footage.
4. The group left out is tracked with the result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros import Tracker
from pf_tracker_ros.cues import Match
from pf_tracker_ros.cues.fusion import Templates
from pf_tracker_ros.tracking.assessment import Confidence
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.tracking.track_assessor import TrackAssessor

# Rarely negative and never positive; set by hand.
_VETO = "correlation_response.level"
# Footage seldom shows a template that learned another object, so its weight is reduced.
_SHARE_OF_LEARNED = {"correlation_response.response": 0.5}
# Prior odds that a box is right.
_PRIOR_ODDS = 5.0
_NEWTON_STEPS, _REGULARIZATION = 30, 1e-6
_MIN_DEVIATION = 1e-9


Odds = Mapping[str, float]


class RecordedConfidence:
    """Records the log odds of a confidence in each frame.

    Args:
        confidence: The confidence.

    Attributes:
        odds: Question to log odds, for each frame.
    """

    def __init__(self, confidence: Confidence) -> None:
        self._confidence = confidence
        self.odds: list[Odds] = []

    def assess(
        self, state: FilterState, seen: Templates, match: Match, particle_std: Callable[[], float]
    ) -> float:
        """See `Confidence.assess`."""
        self.odds.append(self._confidence.log_odds(state, seen, particle_std))
        return self._confidence.assess(state, seen, match, particle_std)

    def update(self, before: float, now: float) -> float:
        """See `Confidence.update`."""
        return self._confidence.update(before, now)


def recording_tracker(preset: str, seed: int) -> tuple[Tracker, RecordedConfidence]:
    """A tracker and the recorded confidence in its boxes, without that of redetection."""
    recorded: list[RecordedConfidence] = []

    def make_assessor(confidence: Confidence, *others: object, **options: bool) -> TrackAssessor:
        recorded.append(RecordedConfidence(confidence))
        return TrackAssessor(recorded[-1], *others, **options)

    with patch("pf_tracker_ros.tracking.target_filter.TrackAssessor", make_assessor):
        tracker = Tracker.from_preset(preset, seed)
    return tracker, recorded[-1]


def fitted_tracker(preset: str, weights: Weights, seed: int) -> Tracker:
    """A tracker whose confidence has other weights."""

    class Fitted(Confidence):
        def log_odds(
            self, state: FilterState, seen: Templates, particle_std: Callable[[], float]
        ) -> dict[str, float]:
            return weights.weigh(super().log_odds(state, seen, particle_std))

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


def fit(groups: Sequence[LabeledOdds]) -> Weights:
    """Fit weights: equal for all standardized questions, scaled by logistic regression.

    Args:
        groups: Frames of groups of sequences, with equal weight.
    """
    all_odds = [odds for group in groups for odds in group.odds]
    names = sorted({name for odds in all_odds for name in odds} - {_VETO})
    # A question that was not evaluated has log odds 0.
    odds = np.array([[one.get(name, 0.0) for name in names] for one in all_odds])
    shares = np.array([_SHARE_OF_LEARNED.get(name, 1.0) for name in names])
    deviations = np.maximum(odds.std(axis=0), _MIN_DEVIATION) / shares
    inputs = np.column_stack([(odds / deviations).sum(axis=1), np.ones(len(all_odds))])
    vetoes = np.array([one.get(_VETO, 0.0) for one in all_odds])
    is_right = np.concatenate([group.is_right for group in groups])
    weights = np.concatenate([_balance(group.is_right) for group in groups]) / len(groups)
    factors = np.zeros(2)
    for _ in range(_NEWTON_STEPS):
        probability = 0.5 * (1.0 + np.tanh((inputs @ factors + vetoes) / 2))
        gradient = inputs.T @ (weights * (probability - is_right))
        curvature = (inputs * (weights * probability * (1.0 - probability))[:, None]).T @ inputs
        # Regularized, as separable data would give infinite factors.
        factors -= np.linalg.solve(
            curvature + _REGULARIZATION * np.eye(2), gradient + _REGULARIZATION * factors
        )
    scale, constant = map(float, factors)
    scales = (scale / deviations).tolist()
    return Weights(dict(zip(names, scales, strict=True)), constant + math.log(_PRIOR_ODDS))


def _balance(is_right: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(F,) weights of frames that give right and wrong ones the same sum."""
    right = max(int(is_right.sum()), 1)
    wrong = max(len(is_right) - int(is_right.sum()), 1)
    return np.where(is_right, 0.5 / right, 0.5 / wrong)
