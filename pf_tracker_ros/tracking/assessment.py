"""Assessment of a frame's estimate, and the confidence that it is the target.

The confidence is the probability of the target: a logistic regression of

1. each cue's log odds of the box, target against anything else (`Cue.log_odds`),
2. the logarithm of the standard deviation of the particles: a narrow mode counts for the target,
3. the similarity of the box to the exemplars of the target (`Exemplars`),
4. the logarithm of its share of the evidence beside a rival, the likeliest box that does not
   overlap it: 1 / (1 + exp(a (r - s))) for similarities s and r to the exemplars. Where both fit,
   either of them may be the target,
5. the logarithm of the number of looks at other places since the target went out of sight: the best
   of many is often wrong. They count until it has been seen for as long again.

Where something is in front of the target, see `filter_state.py`, or the images show another scene,
see `frames/continuity.py`, the odds are lower.

Over time, the confidence falls at once and rises by exponential smoothing.

`benchmarks/uncertainty.py` measures how true it is on any footage.

For one's own footage, a confidence c with the log odds x = log(c / (1 - c)) is reported as
1 / (1 + exp(-(a x + b))), with a scale a > 0 and an offset b. The map keeps the order, so it does
not tell right boxes from wrong ones any better. It changes nothing inside of the filter: all
thresholds apply to the confidence before it, so boxes and states stay the same. `tune --confidence`
fits a and b.

Source of the calibration: Platt 1999, "Probabilistic outputs for support vector machines and
comparisons to regularized likelihood methods".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.cues import CueFusion, Match
from pf_tracker_ros.cues.fusion import CueWeights, Templates
from pf_tracker_ros.filter import ParticleSet
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.tracking.estimate import Estimate, FrozenCueWeights, TrackStatus
from pf_tracker_ros.tracking.filter_state import Challenger, FilterState

LEAST_SCALE, LARGEST = 0.01, 20.0
"""Least scale, and largest scale and magnitude of the offset."""

# Confidences closer to 0 or 1 count as this, since those of 0 and 1 are infinite.
_LEAST_CONFIDENCE = 1e-3


def log_odds(confidence: ArrayLike) -> NDArray[np.float64]:
    """Log odds of confidences of any shape, -6.9 to 6.9."""
    limited = np.clip(
        np.asarray(confidence, dtype=np.float64), _LEAST_CONFIDENCE, 1.0 - _LEAST_CONFIDENCE
    )
    return np.log(limited) - np.log1p(-limited)


@dataclass(frozen=True)
class ConfidenceCalibration:
    """Scale, 0.01 to 20, and offset, -20 to 20, of the log odds."""

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
        return 0.5 * (1.0 + np.tanh(odds / 2))


class Assessment(NamedTuple):
    """Box, confidence and status of the target in a frame.

    Attributes:
        box: (4,) of the target, pixels.
        confidence: Probability that it is the target, 0 to 1, before its calibration.
        particles: Particles that the estimate reports.
        boxes: (N, 4) of these particles, pixels.
        learns: Whether the templates may learn the box.
    """

    box: NDArray[np.float64]
    confidence: float
    status: TrackStatus
    particles: ParticleSet
    boxes: NDArray[np.float64]
    learns: bool = True
    known_distractor: Box | None = None
    challenger: Challenger | None = None

    def to_estimate(
        self,
        frame: Frame,
        cue_weights: CueWeights,
        covariance: NDArray[np.float64],
        calibration: ConfidenceCalibration,
    ) -> Estimate:
        """The estimate that is published, with a (4, 4) covariance; makes the arrays read-only."""
        self.boxes.setflags(write=False)
        covariance.setflags(write=False)
        return Estimate(
            box=as_box(self.box),
            state=self.status.state,
            confidence=float(calibration.apply(self.confidence)),
            box_covariance=covariance,
            particles=self.particles.states,
            particle_boxes=self.boxes,
            weights=self.particles.weights,
            effective_sample_size=self.particles.effective_sample_size,
            cue_weights=FrozenCueWeights(cue_weights),
            background=frame.background,
            reacquired_for=self.status.reacquired_for,
        )


# Standard deviation of the particles' centers, box sizes, that adds no log odds; its least value;
# slope of the log odds over its logarithm.
_NEUTRAL_STD, _LEAST_STD, _STD_ODDS_SLOPE = 0.023, 0.005, 0.68
# Similarity to the exemplars that adds no log odds, and their slope over it.
_NEUTRAL_SIMILARITY, _SIMILARITY_ODDS_SLOPE = 0.553, 6.6
# The a of a rival, and the slope of the log odds over the logarithm of the share beside it.
_RIVAL_SLOPE, _SHARE_ODDS_SLOPE = 20.0, 1.3
# Slope of the log odds over the logarithm of the number of looks.
_LOOKS_ODDS_SLOPE = 0.65
# Seconds after which another look at the same place is a chance of its own to be wrong.
_INDEPENDENT_AFTER = 0.5


class AssessedBox(NamedTuple):
    """A box that may be the target.

    Attributes:
        box: (4,) in it, pixels.
        particle_std: Computes the standard deviation of the particles' centers, box sizes, if it is
            needed; neutral where there are no particles.
        rival: (4,) likeliest box that does not overlap it, pixels; None if there is none.
    """

    frame: Frame
    box: NDArray[np.float64]
    seen: Templates
    match: Match
    particle_std: Callable[[], float] = lambda: _NEUTRAL_STD
    rival: NDArray[np.float64] | None = None


class Confidence:
    """Probability that a box shows the target and not something similar.

    If no cue has log odds, the confidence is the similarity to the templates. Each frame has a
    share `rate` in the confidence while it rises.
    """

    def __init__(self, fusion: CueFusion, rate: float) -> None:
        self._fusion = fusion
        self._rate = rate

    def assess(self, state: FilterState, assessed: AssessedBox) -> float:
        """Confidence of a box in a single frame, 0 to 1, given the state before that frame."""
        odds = self.log_odds(state, assessed)
        # tanh stays within 0 to 1 where exp(-odds) would overflow.
        confidence = (
            0.5 * (1.0 + math.tanh(sum(odds.values()) / 2)) if odds else assessed.match.similarity
        )
        # A target behind something, or in another scene, is hidden wherever the box is.
        factor = state.outside_factor * assessed.frame.odds_factor
        return confidence if factor == 1.0 else _with_odds_times(confidence, factor)

    def log_odds(self, state: FilterState, assessed: AssessedBox) -> dict[str, float]:
        """Name of each term to its log odds; empty if no cue has any. Arguments as of `assess`."""
        odds = self._fusion.log_odds(assessed.seen, state.templates)
        if not odds:
            return odds
        std = max(assessed.particle_std(), _LEAST_STD)
        boxes = [assessed.box] if assessed.rival is None else [assessed.box, assessed.rival]
        similarity, *rivals = state.exemplars.similarities(assessed.frame, np.array(boxes)).tolist()
        share = 1.0 / (1.0 + sum(math.exp(_RIVAL_SLOPE * (one - similarity)) for one in rivals))
        return odds | {
            "spread": -_STD_ODDS_SLOPE * math.log(std / _NEUTRAL_STD),
            "exemplars": _SIMILARITY_ODDS_SLOPE * (similarity - _NEUTRAL_SIMILARITY),
            "rival": _SHARE_ODDS_SLOPE * math.log(share),
            "looks": -_LOOKS_ODDS_SLOPE * math.log1p(state.status.hidden_for / _INDEPENDENT_AFTER),
        }

    def update(self, before: float, now: float) -> float:
        """Confidence after a frame, 0 to 1, from that before it and that of the frame alone."""
        if now <= before:
            return now
        return self._rate * now + (1.0 - self._rate) * before


def _with_odds_times(probability: float, factor: float) -> float:
    return factor * probability / (1.0 - probability + factor * probability)
