"""Assessment of a frame's estimate, and the confidence that it is the target.

1. Each cue turns its observation of the box into log odds, target against anything else.
2. The standard deviation s of the particles adds -1.75 log(s / 0.023): a narrow mode counts for the
   target.
3. The sum x of all log odds becomes a probability, 1 / (1 + exp(-x)).
4. Over time, the confidence falls at once and rises by exponential smoothing.

Source: logistic regression; `benchmarks/uncertainty.py` fits the coefficients.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.cues import CueFusion, Match
from pf_tracker_ros.cues.fusion import CueWeights, Templates
from pf_tracker_ros.filter import ParticleSet
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.tracking.calibration import ConfidenceCalibration
from pf_tracker_ros.tracking.estimate import Estimate, FrozenCueWeights, TrackStatus
from pf_tracker_ros.tracking.filter_state import FilterState


@dataclass(frozen=True, eq=False)
class Assessment:
    """Box, confidence and status of the target in a frame.

    Attributes:
        box: (4,) of the target, pixels.
        confidence: Probability that it is the target, 0 to 1, before its calibration.
        status: Track state and its timers.
        particles: Particles that the estimate reports.
        boxes: (N, 4) of these particles, pixels.
        learns: Whether the templates may learn the box.
        known_distractor: See `FilterState.known_distractor`.
    """

    box: NDArray[np.float64]
    confidence: float
    status: TrackStatus
    particles: ParticleSet
    boxes: NDArray[np.float64]
    learns: bool = True
    known_distractor: Box | None = None

    def to_estimate(
        self,
        frame: Frame,
        cue_weights: CueWeights,
        covariance: NDArray[np.float64],
        calibration: ConfidenceCalibration,
    ) -> Estimate:
        """The estimate that is published; makes the arrays read-only.

        Args:
            frame: The frame.
            cue_weights: Weights of the cues in that frame.
            covariance: (4, 4) of the box, see `Estimate.box_covariance`.
            calibration: Calibration of the confidence.
        """
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


# Standard deviation of the particles' centers, box sizes, at which it adds no log odds; its least
# value; and the log odds' slope over its logarithm.
_NEUTRAL_STD, _LEAST_STD, _STD_ODDS_SLOPE = 0.023, 0.005, 1.75


class Confidence:
    """Probability that the box shows the target and not something similar.

    The log odds of the cues compare the box with its surroundings and with the first template,
    which contains nothing that was learned by mistake. All terms have the same weight per standard
    deviation of their values, the one of the current template half of it. A response far below the
    last learned one counts against the target. If no cue has log odds, the confidence is the
    similarity to the templates.

    Args:
        fusion: The cues.
        rate: Share of each frame in the confidence while it rises, above 0 up to 1.
    """

    def __init__(self, fusion: CueFusion, rate: float) -> None:
        self._fusion = fusion
        self._rate = rate

    def assess(
        self,
        state: FilterState,
        seen: Templates,
        match: Match,
        particle_std: Callable[[], float] = lambda: _NEUTRAL_STD,
    ) -> float:
        """Confidence of a single frame, 0 to 1.

        Args:
            state: State before the frame.
            seen: The cues' observation of the box.
            match: Its match with the templates.
            particle_std: Computes the standard deviation of the particles' centers, box sizes, if
                it is needed; neutral where there are no particles.
        """
        odds = self.log_odds(state, seen, particle_std)
        # tanh stays within 0 to 1 where exp(-odds) would overflow.
        return 0.5 * (1.0 + math.tanh(sum(odds.values()) / 2)) if odds else match.similarity

    def log_odds(
        self, state: FilterState, seen: Templates, particle_std: Callable[[], float]
    ) -> dict[str, float]:
        """Name of each term to its log odds; empty if no cue has any. Arguments as of `assess`."""
        odds = self._fusion.log_odds(seen, state.templates, state.first_templates)
        if odds:
            std = max(particle_std(), _LEAST_STD)
            odds["spread"] = -_STD_ODDS_SLOPE * math.log(std / _NEUTRAL_STD)
        return odds

    def update(self, before: float, now: float) -> float:
        """Confidence after a frame, 0 to 1.

        Args:
            before: Confidence after the last frame, 0 to 1.
            now: Confidence of this frame alone, 0 to 1.
        """
        if now <= before:
            return now
        return self._rate * now + (1.0 - self._rate) * before
