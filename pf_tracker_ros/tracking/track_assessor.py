"""Assessment step: whether the target is tracked, occluded or lost, and its redetection.

1. Compute the confidence of the frame. It is 0 at a known distractor, and where the estimate has
   jumped to the second peak of the last frame.
2. Smooth the confidence over time and advance the track state with it.
3. While the target is not tracked, let the occlusion policy choose the reported box.
4. Search for the target where it was last seen and, once it is lost, all over the image.
5. Redraw the particles around the box that the policy or the redetection returns.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import are_same_place, as_box, is_truncated, relative_center_distances
from pf_tracker_ros.tracking.assessment import Assessment, Confidence
from pf_tracker_ros.tracking.estimate import TrackStatus, TrackThresholds
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.tracking.measurement import Measurement
from pf_tracker_ros.tracking.occlusion import OcclusionPolicy
from pf_tracker_ros.tracking.redetection import Candidate, Redetector, found_above
from pf_tracker_ros.tracking.state_operations import FilterInitializer

# Least confidence of a single frame for learning, whatever the similarity to the templates.
_LEARN_ABOVE = 0.01


class TrackAssessor:
    """Turns the measurement of a frame into its assessment.

    Args:
        confidence: Confidence in a box.
        occlusion_policy: Handles a target that is not tracked.
        redetector: Searches elsewhere; None without redetection.
        initializer: Redraws particles.
        thresholds: Thresholds of the track states.
        weighs_looks: Whether redetection is the only evidence for a finding, so that it needs more
            of it; detections and descriptors confirm several targets.
    """

    def __init__(
        self,
        confidence: Confidence,
        occlusion_policy: OcclusionPolicy,
        redetector: Redetector | None,
        initializer: FilterInitializer,
        thresholds: TrackThresholds,
        *,
        weighs_looks: bool = True,
    ) -> None:
        self._confidence = confidence
        self._occlusion_policy = occlusion_policy
        self._redetector = redetector
        self._initializer = initializer
        self._thresholds = thresholds
        self._weighs_looks = weighs_looks

    def assess(
        self,
        state: FilterState,
        measurement: Measurement,
        interval: float,
        generator: np.random.Generator,
        *,
        searches_everywhere: bool = True,
    ) -> Assessment:
        """Assessment of the target in a frame.

        Args:
            state: State after the last frame.
            measurement: Measurement of this frame.
            interval: Seconds since the last frame.
            generator: Source of random numbers, for redrawn particles.
            searches_everywhere: Whether a lost target is searched all over the image.
        """
        thresholds = self._thresholds
        frame_confidence = self._confidence.assess(
            state, measurement.seen, measurement.match, lambda: measurement.particle_std
        )
        # A target that matches its current templates is not lost, even if the first ones differ.
        similarity = max(frame_confidence, measurement.match.similarity, measurement.recognition)
        known_distractor = state.known_distractor
        has_jumped = _jumped_to_second_peak(state, measurement)
        if has_jumped and frame_confidence >= thresholds.occluded_below:
            known_distractor = as_box(measurement.box)
        if known_distractor is not None and are_same_place(measurement.box, known_distractor):
            frame_confidence = similarity = 0.0
        confidence = self._confidence.update(state.confidence, frame_confidence)
        status = self._advanced(state, measurement, confidence, similarity, interval)
        if self._redetector is None and status.probation:
            # No other candidate is searched for.
            status = replace(status, probation=0.0)
        # The similarity of a searching cue may be that of a place beside the box.
        learns = self._redetector is None or frame_confidence >= _LEARN_ABOVE
        assessment = Assessment(
            measurement.box, confidence, status, measurement.particles, measurement.boxes, learns
        )
        if status.is_settled:
            return assessment
        is_seen, box = status.state == "tracking", None
        disappears = state.status.state == "tracking" and not is_seen
        if self._redetector and known_distractor is None and disappears:
            known_distractor = self._redetector.known_distractor(state, measurement)
        assessment = replace(assessment, known_distractor=known_distractor)
        if not is_seen:
            assessment = self._occlusion_policy.assess(state, measurement, assessment)
            box = self._occlusion_policy.redraw_box(state, assessment)
        if status.state != "occluded" or status.probation:
            # The box may be another object, and a similar object elsewhere may be the target.
            assessment = replace(assessment, learns=False)
        if not is_seen and frame_confidence > thresholds.recovered_above:
            # The target has reappeared in the box; the smoothed confidence follows.
            return assessment
        if self._redetector:
            candidate = self._redetector.find(
                state,
                measurement,
                assessment,
                searches_everywhere and status.state != "occluded",
                frame_confidence if is_seen else 0.0,
            )
            if candidate is not None:
                box = candidate.box
                needed = self._found_above(state, box, measurement, self._redetector)
                assessment = self._redetected(candidate, assessment, needed)
        if box is None:
            return assessment
        particles, boxes = self._initializer.redraw_particles(
            state, box, measurement.frame.size, generator
        )
        return replace(assessment, box=box, particles=particles, boxes=boxes, learns=False)

    def _redetected(
        self, candidate: Candidate, assessment: Assessment, needed: float
    ) -> Assessment:
        """The assessment with the confidence and status after a redetection.

        If the target was occluded only, a candidate with the needed confidence is the target.
        Otherwise it may be a similar object, until more frames confirm it.
        """
        status = assessment.status
        if status.state == "tracking":
            return replace(assessment, confidence=0.0, status=status.as_lost(self._thresholds))
        is_sure = candidate.confidence >= needed
        if status.state == "occluded" and not status.probation and is_sure:
            return replace(assessment, confidence=candidate.confidence, status=status.as_found())
        return assessment

    def _advanced(
        self,
        state: FilterState,
        measurement: Measurement,
        confidence: float,
        similarity: float,
        interval: float,
    ) -> TrackStatus:
        """The status of this frame: with redetection, finding again needs more evidence."""
        thresholds, status = self._thresholds, state.status
        redetector = self._redetector
        if redetector is None:
            return status.advance(confidence, similarity, interval, thresholds)
        if redetector.asks and status.state == "lost":
            # Only somebody's confirmation starts it again.
            return status.advance(0.0, 0.0, interval, thresholds)
        needed = self._found_above(state, measurement.box, measurement, redetector)
        return status.advance(confidence, similarity, interval, thresholds, needed)

    def _found_above(
        self,
        state: FilterState,
        box: NDArray[np.float64],
        measurement: Measurement,
        redetector: Redetector,
    ) -> float:
        """See `found_above`; 0 where looks have no weight."""
        if not self._weighs_looks:
            return 0.0
        size = measurement.frame.size
        has_left = is_truncated(np.array(state.last_seen_box), size) and not is_truncated(box, size)
        threshold = self._thresholds.recovered_above
        hidden_for, places = state.status.hidden_for, redetector.places
        return found_above(threshold, hidden_for, places, has_left=has_left)


def _jumped_to_second_peak(state: FilterState, measurement: Measurement) -> bool:
    """Whether the estimate is at the second peak of the last frame, and clear of the last box."""
    return (
        state.status.state == "tracking"
        and state.second_peak is not None
        and bool(are_same_place(measurement.box, state.second_peak))
        and bool(relative_center_distances(measurement.box, state.estimate.box) >= 1.0)
    )
