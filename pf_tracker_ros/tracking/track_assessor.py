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

from pf_tracker_ros.boxes import Box, are_same_place, as_box, relative_center_distances
from pf_tracker_ros.tracking.assessment import Assessment, Confidence
from pf_tracker_ros.tracking.estimate import TrackStatus, TrackThresholds
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.tracking.measurement import Measurement
from pf_tracker_ros.tracking.occlusion import OcclusionPolicy
from pf_tracker_ros.tracking.redetection import DOUBTFUL_BELOW, Candidate, Redetector
from pf_tracker_ros.tracking.state_operations import FilterInitializer

# Least confidence of a single frame for learning, whatever the similarity to the templates.
_LEARN_ABOVE = 0.01
# Confidence above which a candidate of the redetection is the target.
_ACCEPT_ABOVE = 0.84
# Similarity to the current templates from which on a target is not lost.
_RECOGNIZED_ABOVE = 0.52


class TrackAssessor:
    """Turns the measurement of a frame into its assessment.

    Args:
        confidence: Confidence in a box.
        occlusion_policy: Handles a target that is not tracked.
        redetector: Searches elsewhere; None without redetection.
        initializer: Redraws particles.
        thresholds: Thresholds of the track states.
    """

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
        self,
        state: FilterState,
        measurement: Measurement,
        interval: float,
        generator: np.random.Generator,
        *,
        searches_everywhere: bool = True,
        is_challenged: bool = True,
    ) -> Assessment:
        """Assessment of the target in a frame.

        Args:
            state: State after the last frame.
            measurement: Measurement of this frame.
            interval: Seconds since the last frame.
            generator: Source of random numbers, for redrawn particles.
            searches_everywhere: Whether a lost target is searched all over the image.
            is_challenged: Whether another box may challenge the current one, and the size of a lost
                target may be free; not where a detector tells where targets are, nor beside other
                targets, whose boxes would challenge it.
        """
        frame_confidence, similarity, known_distractor = self._evidence(state, measurement)
        confidence = self._confidence.update(state.confidence, frame_confidence)
        assessment = Assessment(
            measurement.box,
            confidence,
            state.status,
            measurement.particles,
            measurement.boxes,
            # The similarity of a searching cue may be that of a place beside the box.
            learns=self._redetector is None or frame_confidence >= _LEARN_ABOVE,
        )
        status = self._status(state, confidence, similarity, interval)
        assessment = assessment._replace(status=status)
        if status.is_settled:
            return assessment
        is_seen, box = status.state == "tracking", None
        is_size_free = is_challenged and state.standing is not None
        disappears = state.status.state == "tracking" and not is_seen
        if self._redetector and known_distractor is None and disappears:
            known_distractor = self._redetector.known_distractor(state, measurement)
        assessment = assessment._replace(known_distractor=known_distractor)
        if not is_seen:
            assessment = self._occlusion_policy.assess(state, measurement, assessment)
            # The policy keeps the last seen size of a lost target.
            box = None if is_size_free else self._occlusion_policy.redraw_box(state, assessment)
        if status.state != "occluded" or status.probation:
            # The box may be another object, and a similar object elsewhere may be the target.
            assessment = assessment._replace(learns=False)
        if not is_seen and frame_confidence > self._thresholds.tracked_above:
            # The target has reappeared in the box; the smoothed confidence follows.
            return assessment
        if self._redetector:
            candidates = self._redetector.search(
                state,
                measurement,
                assessment,
                searches_everywhere=searches_everywhere and status.state != "occluded",
            )
            tracked_confidence = frame_confidence if is_seen else 0.0
            # After seconds, looks alone lower the confidence in a lost target below 0.84.
            is_lost = is_size_free and status.state == "lost"
            least = self._thresholds.tracked_above if is_lost else _ACCEPT_ABOVE
            found = self._redetector.find(candidates, assessment.box, least, tracked_confidence)
            if found:
                box = found.box
                assessment = self._redetected(found, assessment)
            elif not is_seen and is_challenged:
                challenger = self._redetector.challenger(
                    state,
                    measurement,
                    assessment,
                    candidates,
                    confidence=frame_confidence,
                    interval=interval,
                )
                if challenger and challenger.wins:
                    box, challenger = np.array(challenger.box), None
                assessment = assessment._replace(challenger=challenger)
        if box is None:
            return assessment
        particles, boxes = self._initializer.redraw_particles(
            state, box, measurement.frame.size, generator
        )
        return assessment._replace(box=box, particles=particles, boxes=boxes, learns=False)

    def _evidence(
        self, state: FilterState, measurement: Measurement
    ) -> tuple[float, float, Box | None]:
        """Confidence and similarity of this frame alone, and the known distractor.

        A target that matches its current templates is not lost, even if the exemplars differ.
        """
        confidence = similarity = self._confidence.assess(state, measurement.assessed)
        if self._redetector and measurement.match.similarity >= _RECOGNIZED_ABOVE:
            similarity = 1.0
        known_distractor = state.known_distractor
        if confidence >= DOUBTFUL_BELOW and _jumped_to_second_peak(state, measurement):
            known_distractor = as_box(measurement.box)
        if known_distractor is not None and are_same_place(measurement.box, known_distractor):
            confidence = similarity = 0.0
        return confidence, similarity, known_distractor

    def _status(
        self, state: FilterState, confidence: float, similarity: float, interval: float
    ) -> TrackStatus:
        if self._redetector is None:
            status = state.status.advance(confidence, similarity, interval, self._thresholds)
            # No other candidate is searched for.
            return status._replace(probation=0.0) if status.probation else status
        if self._redetector.asks and state.status.state == "lost":
            # Only somebody's confirmation starts it again.
            confidence = similarity = 0.0
        status = state.status.advance(confidence, similarity, interval, self._thresholds)
        if state.occlusion_evidence.is_counted:
            # Hidden by other evidence than the image's, it was looked for nowhere else.
            status = status._replace(hidden_for=state.status.hidden_for)
        return status

    def _redetected(self, candidate: Candidate, assessment: Assessment) -> Assessment:
        """The assessment with the confidence and status after a redetection.

        If the target was occluded only, the candidate is the target. Otherwise it may be a similar
        object, until more frames confirm it.
        """
        status = assessment.status
        if status.state == "tracking":
            return assessment._replace(confidence=0.0, status=status.as_lost(self._thresholds))
        if status.state == "occluded" and not status.probation:
            return assessment._replace(
                confidence=candidate.confidence,
                status=status.as_found(),
            )
        return assessment


def _jumped_to_second_peak(state: FilterState, measurement: Measurement) -> bool:
    """Whether the estimate is at the second peak of the last frame, and clear of the last box."""
    return (
        state.status.state == "tracking"
        and state.second_peak is not None
        and bool(are_same_place(measurement.box, state.second_peak))
        and bool(relative_center_distances(measurement.box, state.estimate.box) >= 1.0)
    )
