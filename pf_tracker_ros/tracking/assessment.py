"""What a frame's measurement is worth: how sure it is that the target is in the box."""

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
from pf_tracker_ros.tracking.estimate import Estimate, FrozenCueWeights, TrackStatus
from pf_tracker_ros.tracking.filter_state import FilterState


@dataclass(frozen=True, eq=False)
class Assessment:
    """What is told of the target in a frame.

    Attributes:
        box: (4,) of the target, pixels.
        confidence: That it is the target, 0 to 1.
        status: Whether it is seen, and for how long it has not been.
        particles: Told with the box.
        boxes: (N, 4) of them, pixels.
        learns: Whether what is in the box may be learned.
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
        self, frame: Frame, cue_weights: CueWeights, covariance: NDArray[np.float64]
    ) -> Estimate:
        """As it is told to the outside; its arrays are read-only from then on.

        Args:
            frame: That it is of.
            cue_weights: Of the cues in that frame.
            covariance: (2, 2) of the target's center, px^2.
        """
        self.boxes.setflags(write=False)
        covariance.setflags(write=False)
        return Estimate(
            box=as_box(self.box),
            state=self.status.state,
            confidence=self.confidence,
            covariance=covariance,
            particles=self.particles.states,
            particle_boxes=self.boxes,
            weights=self.particles.weights,
            effective_sample_size=self.particles.effective_sample_size,
            cue_weights=FrozenCueWeights(cue_weights),
            background=frame.background,
        )


# Standard deviation of the particles' centers while a target is seen well, box sizes; where they
# agree less on a place, the log odds fall with its logarithm, so fast.
_USUAL_SPREAD, _LEAST_SPREAD, _SPREAD_ODDS = 0.023, 0.005, 1.75


class Confidence:
    """The probability that it is the target, and not something else that is much like it.

    The log odds of all cues add up. They ask of the box itself whether it stands out from what is
    around it, and whether it looks like the target did in the first frame: what was learned by
    mistake since then does not count there. A cloud that is spread out speaks against it. Each of
    the questions has the same weight, in standard deviations of its answers, but the one that is
    answered by what was learned last, which has half of it; a response that is by far too weak
    speaks against it, too. `benchmarks/uncertainty.py` fits that, and tells how it carries over to
    other footage. Where no cue can tell, the confidence is how well the box fits the templates.

    From frame to frame it falls at once, and rises as fast as is allowed.

    Args:
        fusion: The cues.
        rate: Share of each frame in it while it rises, above 0 up to 1. With less, good looks after
            a doubtful one must be several.
    """

    def __init__(self, fusion: CueFusion, rate: float) -> None:
        self._fusion = fusion
        self._rate = rate

    def assess(
        self,
        target: FilterState,
        seen: Templates,
        match: Match,
        spread: Callable[[], float] = lambda: _USUAL_SPREAD,
    ) -> float:
        """What a look alone says, 0 to 1.

        Args:
            target: As it was before.
            seen: What the cues observe in the box.
            match: How well that fits the templates.
            spread: Tells the standard deviation of the particles' centers, box sizes, where it
                is asked for; as usual where there are none.
        """
        odds = self.log_odds(target, seen, spread)
        # Above 0 and below 1 also where exp(-odds) is more than a number can be.
        return 0.5 * (1.0 + math.tanh(sum(odds.values()) / 2)) if odds else match.similarity

    def log_odds(
        self, target: FilterState, seen: Templates, spread: Callable[[], float]
    ) -> dict[str, float]:
        """Question to what its answer says for the target; empty where no cue can tell.

        Arguments as of `assess`.
        """
        odds = self._fusion.log_odds(seen, target.templates, target.first_templates)
        if odds:
            measured = max(spread(), _LEAST_SPREAD)
            odds["spread"] = -_SPREAD_ODDS * math.log(measured / _USUAL_SPREAD)
        return odds

    def update(self, before: float, now: float) -> float:
        """The confidence after a frame, 0 to 1.

        Args:
            before: After the last frame, 0 to 1.
            now: What this frame alone says, 0 to 1.
        """
        if now <= before:
            return now
        return self._rate * now + (1.0 - self._rate) * before
