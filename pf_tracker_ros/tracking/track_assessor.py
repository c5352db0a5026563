"""Assessment step: whether the target is tracked, occluded or lost, and its redetection.

1. Compute the confidence of the frame. It is 0 at a known distractor, and where the estimate has
   jumped to the second peak of the last frame.
2. Smooth the confidence over time and advance the track state with it.
3. While the target is not tracked, let the occlusion policy choose the reported box.
4. Search for the target where it was last seen and, once it is lost, all over the image.
5. Redraw the particles around the box that the policy or the redetection returns.

The size of a lost target is free where the ground is known, as before a robot, and nothing but the
image tells where the target is: the search tries other sizes, and goes on in them.
"""

from __future__ import annotations

import numpy as np

from pf_tracker_ros.boxes import are_same_place, as_box, relative_center_distances
from pf_tracker_ros.tracking.assessment import Assessment, Confidence
from pf_tracker_ros.tracking.estimate import TrackStatus, TrackThresholds
from pf_tracker_ros.tracking.measurement import Measurement
from pf_tracker_ros.tracking.occlusion import OcclusionPolicy
from pf_tracker_ros.tracking.redetection import DOUBTFUL_BELOW, Redetector
from pf_tracker_ros.tracking.state_operations import FilterInitializer

# Least confidence of a single frame for learning, whatever the similarity to the templates.
_LEARN_ABOVE = 0.01
# Confidence above which a candidate of the redetection is the target.
_ACCEPT_ABOVE = 0.84
# Similarity to the current templates from which on a target is not lost.
_RECOGNIZED_ABOVE = 0.52


class TrackAssessor:
    """Turns the measurement of a frame into its assessment."""

    def __init__(
        self,
        confidence: Confidence,
        occlusion_policy: OcclusionPolicy,
        redetector: Redetector | None,
        initializer: FilterInitializer,
        thresholds: TrackThresholds,
    ) -> None:
        self._confidence = confidence
        self._occlusion_policy = occlusion_policy
        self._redetector = redetector
        self._initializer = initializer
        self._thresholds = thresholds

    def assess(
        self, measurement: Measurement, *, searches_everywhere: bool, is_challenged: bool
    ) -> Assessment:
        """Assessment of the target in a frame.

        If it is challenged, another box may take the place of the current one, and the size of a
        lost target may be free. It is not where a detector tells where targets are, nor beside
        other targets, whose boxes would challenge it.
        """
        state = measurement.state
        frame_confidence = self._confidence.assess(state, measurement.assessed)
        known_distractor = state.known_distractor
        if frame_confidence >= DOUBTFUL_BELOW and _jumped_to_second_peak(measurement):
            known_distractor = as_box(measurement.box)
        if known_distractor is not None and are_same_place(measurement.box, known_distractor):
            frame_confidence = 0.0
        confidence = self._confidence.update(state.confidence, frame_confidence)
        status = self._status(measurement, confidence, frame_confidence)
        assessment = Assessment(
            measurement.box,
            confidence,
            status,
            measurement.particles,
            measurement.boxes,
            # The similarity of a searching cue may be that of a place beside the box, and what is
            # there after a cut is something else.
            learns=measurement.frame.odds_factor == 1.0
            and (self._redetector is None or frame_confidence >= _LEARN_ABOVE),
        )
        if status.state == "tracking":
            return assessment
        assessment = assessment._replace(known_distractor=known_distractor)
        is_lost = status.state == "lost"
        is_size_free = is_challenged and state.standing is not None
        assessment = self._occlusion_policy.assess(measurement, assessment)
        # The policy keeps the last seen size of a lost target.
        box = None if is_size_free else self._occlusion_policy.redraw_box(state, assessment)
        if is_lost:
            # The box may be another object, and a similar object elsewhere may be the target.
            assessment = assessment._replace(learns=False)
        if frame_confidence > self._thresholds.tracked_above:
            # The target has reappeared in the box; the smoothed confidence follows.
            return assessment
        if self._redetector:
            # After seconds, looks alone lower the confidence in a lost target below 0.84.
            has_low_bar = is_size_free and is_lost
            least = self._thresholds.tracked_above if has_low_bar else _ACCEPT_ABOVE
            candidates = self._redetector.search(
                measurement, assessment, searches_everywhere=searches_everywhere and is_lost
            )
            best = max(candidates, key=lambda one: one.confidence, default=None)
            if best and best.confidence > least:
                box = best.box
                if not is_lost:
                    # A lost one may be a similar object, until frames confirm it.
                    assessment = assessment._replace(
                        confidence=best.confidence, status=status.as_found()
                    )
            elif is_challenged:
                challenger = self._redetector.challenger(
                    measurement, assessment, candidates, frame_confidence
                )
                if challenger and challenger.wins:
                    box, challenger = np.array(challenger.box), None
                assessment = assessment._replace(challenger=challenger)
        if box is None:
            return assessment
        particles, boxes = self._initializer.redraw_particles(
            state, box, measurement.frame.size, measurement.frame_prediction.generator
        )
        return assessment._replace(box=box, particles=particles, boxes=boxes, learns=False)

    def _status(
        self, measurement: Measurement, confidence: float, frame_confidence: float
    ) -> TrackStatus:
        """The status by the confidence over time and that of this frame alone.

        A target that matches its current templates is not lost, even if the exemplars differ.
        """
        state, interval = measurement.state, measurement.frame_prediction.interval
        if self._redetector is None:
            return state.status.advance(confidence, frame_confidence, interval, self._thresholds)
        is_recognized = measurement.match.similarity >= _RECOGNIZED_ABOVE
        similarity = 1.0 if is_recognized else frame_confidence
        if self._redetector.asks and state.status.state == "lost":
            # Only somebody's confirmation starts it again.
            confidence = similarity = 0.0
        status = state.status.advance(confidence, similarity, interval, self._thresholds)
        if state.occlusion_evidence.is_counted:
            # Hidden by other evidence than the image's, it was looked for nowhere else.
            status = status._replace(hidden_for=state.status.hidden_for)
        return status


def _jumped_to_second_peak(measurement: Measurement) -> bool:
    """Whether the estimate is at the second peak of the last frame, and clear of the last box."""
    state = measurement.state
    return (
        state.status.state == "tracking"
        and state.second_peak is not None
        and bool(are_same_place(measurement.box, state.second_peak))
        and bool(relative_center_distances(measurement.box, state.estimate.box) >= 1.0)
    )
