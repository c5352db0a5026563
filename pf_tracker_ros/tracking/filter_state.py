"""The state of one target between two frames.

It holds the particles and everything else that a step of the filter reads and writes: motion model,
Kalman filter, templates, track status, and the target's own random numbers. It is an immutable
value, so that a step can be repeated from any frame, as out-of-sequence measurements require.

A part of it is evidence from outside of the image that something is in front of the target. A
depth camera sees which share of the box is nearer than the target. The odds that the box shows
the target are multiplied by the uncovered share, in one frame:

    odds' = odds max(1 - share, 0.15),    if share > 0.25

It is evidence and no command. A wrong source must not silence a target that the image shows: the
evidence counts for at most 2 s, and again only after 1 s in which nothing is in front.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.cues.fusion import DistractorRatios, Templates
from pf_tracker_ros.filter import KalmanFilter, MotionModel, ParticleSet
from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.tracking.estimate import Estimate, TrackStatus
from pf_tracker_ros.tracking.exemplars import Exemplars
from pf_tracker_ros.tracking.hints import Standing

# Share from which on it counts, and least factor of the odds.
_COUNTS_ABOVE, _LEAST_FACTOR = 0.25, 0.15
# Seconds for which it counts, and seconds without anything in front after which it counts again.
_COUNTS_FOR, _CLEAR_FOR = 2.0, 1.0


class OcclusionEvidence(NamedTuple):
    """What is known of the next frame.

    Attributes:
        share: Share of the box that something in front covers, 0 to 1.
        used_for: Seconds for which it has counted.
        clear_for: Seconds since then without anything in front.
        is_known: Whether somebody says what is in front, so that a share of 0 is one.
    """

    share: float = 0.0
    used_for: float = 0.0
    clear_for: float = 0.0
    is_known: bool = False

    @property
    def is_clear(self) -> bool:
        """Whether nothing is in front, for certain."""
        return self.is_known and self.share <= _COUNTS_ABOVE

    @property
    def factor(self) -> float:
        """Factor of the odds of the target; 1 where the evidence does not count."""
        if self.share <= _COUNTS_ABOVE or self.used_for >= _COUNTS_FOR:
            return 1.0
        return max(1.0 - self.share, _LEAST_FACTOR)

    @property
    def is_counted(self) -> bool:
        """Whether it counts, or has counted in this occlusion for less than its time."""
        return self.factor < 1.0 or 0.0 < self.used_for < _COUNTS_FOR

    def advance(self, interval: float) -> OcclusionEvidence:
        """After the frame: nothing is known of the next one."""
        if self.factor < 1.0:
            return OcclusionEvidence(used_for=self.used_for + interval)
        if self.used_for == 0.0:
            return NO_EVIDENCE
        clear_for = 0.0 if self.share > _COUNTS_ABOVE else self.clear_for + interval
        return (
            NO_EVIDENCE
            if clear_for >= _CLEAR_FOR
            else OcclusionEvidence(used_for=self.used_for, clear_for=clear_for)
        )


NO_EVIDENCE = OcclusionEvidence()
"""Nothing is in front, as without a source."""


# Confidence from which on there is no doubt about an estimate, and below which there is most.
_CERTAIN_ABOVE, _DOUBTFUL_BELOW = 0.85, 0.45


@dataclass(frozen=True, eq=False)
class SavedTemplates:
    """Templates from before a jump of the illumination, to be restored if it was a flash.

    The change is the brightness after the jump over that before, the age the seconds since.
    """

    templates: Templates
    change: float
    age: float = 0.0


class Challenger(NamedTuple):
    """The likeliest box elsewhere while the target is out of sight.

    Attributes:
        box: Its box, pixels.
        lead: Log odds by which it is likelier to be the target than the current box, smoothed.
        wins: Whether the filter goes on from this box, without a claim that it is the target.
    """

    box: Box
    lead: float
    wins: bool = False


@dataclass(frozen=True, eq=False)
class FilterState:
    """Immutable state of one target's filter; a frame makes a new one.

    A step that is repeated from the same state draws the same random numbers.

    Attributes:
        first_box: Reference box of the motion model, pixels: where the target started or was moved.
        kalman_filter: Kalman filter of the proposal; None with another proposal.
        particles: Resampled particles, to be predicted into the next frame.
        exemplars: What the target looked like when it was surely seen.
        distractor_ratios: Smoothed ratio of each cue.
        last_seen_box: Last box with the state "tracking", pixels.
        second_peak: Likeliest box beside the target in the last frame, pixels; None without a
            search.
        known_distractor: Box of a distractor that was seen beside the target, pixels; kept while
            the target is out of sight.
        frames_since_seen: Consecutive frames without the state "tracking".
        followed_frames: Frames since the first one.
        generator_state: The target's own source of random numbers.
        confidence: Confidence of the last frame, 0 to 1; `estimate` has it calibrated.
        saved_templates: Templates from before a recent jump of the illumination; None without one.
        distractor_box: (4,) box of the distractor in the last frame, pixels; None if there was none
            or no search.
        occlusion_evidence: Whether something is in front of it in the next frame.
        challenger: See `Challenger`; None while the target is in sight.
        standing: Heights of boxes in the next image; None where nobody says.
        place_factor: Factor, up to 1, of the odds that the box shows the target in the next frame,
            since it was in another place than predicted in meters.
        growth: Logarithm of the target's size over the predicted one, as far as the cues tell.
        detector_factor: Factor of the odds that the box shows the target, by what a detector has
            seen or missed.
    """

    first_box: Box
    motion: MotionModel
    kalman_filter: KalmanFilter | None
    particles: ParticleSet
    templates: Templates
    exemplars: Exemplars
    distractor_ratios: DistractorRatios
    status: TrackStatus
    last_seen_box: Box
    generator_state: GeneratorState
    confidence: float
    estimate: Estimate
    second_peak: Box | None = None
    known_distractor: Box | None = None
    frames_since_seen: int = 0
    followed_frames: int = 0
    saved_templates: SavedTemplates | None = None
    distractor_box: NDArray[np.float64] | None = None
    occlusion_evidence: OcclusionEvidence = NO_EVIDENCE
    challenger: Challenger | None = None
    standing: Standing | None = None
    place_factor: float = 1.0
    growth: float = 0.0
    detector_factor: float = 1.0

    @property
    def outside_factor(self) -> float:
        """Factor of the odds that the next box shows the target, from outside of the image."""
        return self.occlusion_evidence.factor * self.place_factor * self.detector_factor

    @property
    def doubt(self) -> float:
        """Doubt that the last estimate is the target, 0 to 1."""
        doubt = (_CERTAIN_ABOVE - self.confidence) / (_CERTAIN_ABOVE - _DOUBTFUL_BELOW)
        return min(max(doubt, 0.0), 1.0)
