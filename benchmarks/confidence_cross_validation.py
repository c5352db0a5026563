"""Does the confidence carry over to footage that nothing of it was fitted on?

Each group of sequences is left out in turn. On the others every question counts the same, in
standard deviations of what it says; how much their sum says, and where it is even, comes from a
logistic regression. Each group counts the same in it, and of each the right frames as much as the
wrong ones: how often a tracker is right says nothing about other footage. With that the group left
out is tracked.
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

# It only speaks against the target, and hardly ever does; it was set by hand.
_VETO = "correlation_response.level"
# What was learned says less where it was learned of something else, which footage seldom shows.
_SHARE_OF_LEARNED = {"correlation_response.response": 0.5}
# Odds that a box is right before anything is known of it.
_PRIOR_ODDS = 5.0
_NEWTON_STEPS, _REGULARIZATION = 30, 1e-6
_LEAST_DEVIATION = 1e-9


Odds = Mapping[str, float]


class RecordedConfidence:
    """A confidence, with what it was told of the box of each frame.

    Args:
        confidence: That judges.

    Attributes:
        odds: Question to log odds, of each frame.
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
    """A tracker and the confidence in its boxes; looks elsewhere are not heard."""
    heard: list[RecordedConfidence] = []

    def assess(confidence: Confidence, *others: object) -> TrackAssessor:
        heard.append(RecordedConfidence(confidence))
        return TrackAssessor(heard[-1], *others)

    with patch("pf_tracker_ros.tracking.target_filter.TrackAssessor", assess):
        tracker = Tracker.from_preset(preset, seed)
    return tracker, heard[-1]


def fitted_tracker(preset: str, weights: Weights, seed: int) -> Tracker:
    """A tracker whose confidence weighs the answers otherwise."""

    class Fitted(Confidence):
        def log_odds(
            self, state: FilterState, seen: Templates, particle_std: Callable[[], float]
        ) -> dict[str, float]:
            return weights.weigh(super().log_odds(state, seen, particle_std))

    with patch("pf_tracker_ros.tracking.target_filter.Confidence", Fitted):
        return Tracker.from_preset(preset, seed)


@dataclass(frozen=True)
class Weights:
    """How much each of Q questions says.

    Attributes:
        factors: Question to the factor of its log odds.
        constant: Log odds that are added.
    """

    factors: Mapping[str, float]
    constant: float

    def weigh(self, odds: Odds) -> dict[str, float]:
        """The log odds of one frame as these weights have them."""
        weighed = {name: self.factors.get(name, 1.0) * one for name, one in odds.items()}
        return {**weighed, "constant": self.constant}


@dataclass(frozen=True)
class LabeledOdds:
    """What was said of F frames.

    Attributes:
        odds: Question to log odds, of each frame.
        is_right: (F,) whether the box was right.
    """

    odds: Sequence[Odds]
    is_right: NDArray[np.bool_]


def fit(groups: Sequence[LabeledOdds]) -> Weights:
    """Equal weights for all questions, their sum as a logistic regression has it.

    Args:
        groups: Frames of sequences of a kind; each group counts the same.
    """
    said = [odds for group in groups for odds in group.odds]
    names = sorted({name for odds in said for name in odds} - {_VETO})
    # What is not asked says nothing.
    odds = np.array([[one.get(name, 0.0) for name in names] for one in said])
    shares = np.array([_SHARE_OF_LEARNED.get(name, 1.0) for name in names])
    deviations = np.maximum(odds.std(axis=0), _LEAST_DEVIATION) / shares
    inputs = np.column_stack([(odds / deviations).sum(axis=1), np.ones(len(said))])
    vetoes = np.array([one.get(_VETO, 0.0) for one in said])
    is_right = np.concatenate([group.is_right for group in groups])
    weights = np.concatenate([_balance(group.is_right) for group in groups]) / len(groups)
    factors = np.zeros(2)
    for _ in range(_NEWTON_STEPS):
        told = 0.5 * (1.0 + np.tanh((inputs @ factors + vetoes) / 2))
        gradient = inputs.T @ (weights * (told - is_right))
        curvature = (inputs * (weights * told * (1.0 - told))[:, None]).T @ inputs
        # Where right and wrong are apart, the best factors are infinite.
        factors -= np.linalg.solve(
            curvature + _REGULARIZATION * np.eye(2), gradient + _REGULARIZATION * factors
        )
    scale, constant = map(float, factors)
    scales = (scale / deviations).tolist()
    return Weights(dict(zip(names, scales, strict=True)), constant + math.log(_PRIOR_ODDS))


def _balance(is_right: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(F,) weights of frames: half of the sum is that of the right ones, if there are both."""
    right = max(int(is_right.sum()), 1)
    wrong = max(len(is_right) - int(is_right.sum()), 1)
    return np.where(is_right, 0.5 / right, 0.5 / wrong)
