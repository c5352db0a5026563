"""Whether the target is seen; if not, what is told of it, or where it is found again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pf_tracker_ros.boxes import are_same_place, as_box, relative_center_distances
from pf_tracker_ros.tracking.assessment import Assessment, Confidence
from pf_tracker_ros.tracking.estimate import TrackStatus, TrackThresholds
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.tracking.measurement import Measurement
from pf_tracker_ros.tracking.occlusion import OcclusionPolicy
from pf_tracker_ros.tracking.redetection import Candidate, Redetector
from pf_tracker_ros.tracking.state_operations import FilterInitializer

# Confidence that a frame alone must give for anything to be learned of it, however the cues' own
# similarity is.
_LEARN_ABOVE = 0.01


class TrackAssessor:
    """Makes the judgment of a frame out of its measurement.

    Args:
        confidence: How sure it is that the target is in the box.
        occlusion_policy: What is done with a target that is not seen.
        redetector: Looks for it elsewhere; None where nobody does.
        initializer: Makes what a target begins anew with.
        thresholds: Between seen, hidden and lost.
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
        target: FilterState,
        measured: Measurement,
        interval: float,
        draw: np.random.Generator,
        *,
        searches_everywhere: bool = True,
    ) -> Assessment:
        """What is told of the target in a frame.

        Args:
            target: After the last frame.
            measured: In this one.
            interval: Seconds since the last one.
            draw: Source of randomness, for a target that begins anew.
            searches_everywhere: Whether it is looked for all over the image once it is lost.
        """
        thresholds = self._thresholds
        now = self._confidence.assess(
            target, measured.seen, measured.match, lambda: measured.particle_std
        )
        # While it looks as it did last, it is not lost, whatever it looked like first.
        glimpse = max(now, measured.match.similarity)
        known_distractor = target.known_distractor
        if now >= thresholds.occluded_below and _is_of_the_runner_up(target, measured):
            known_distractor = as_box(measured.box)
        if known_distractor is not None and are_same_place(measured.box, known_distractor):
            # Whatever it looks like.
            now = glimpse = 0.0
        confidence = self._confidence.update(target.estimate.confidence, now)
        track = target.status.advance(confidence, glimpse, interval, thresholds)
        if self._redetector is None and track.probation:
            # Nobody looks for another.
            track = replace(track, probation=0.0)
        # The best place around may be like the target, and the box beside it.
        learns = self._redetector is None or now >= _LEARN_ABOVE
        assessment = Assessment(
            measured.box, confidence, track, measured.particles, measured.boxes, learns
        )
        if track.is_settled:
            return assessment
        is_seen, box = track.state == "tracking", None
        goes_now = target.status.state == "tracking" and not is_seen
        if self._redetector and known_distractor is None and goes_now:
            known_distractor = self._redetector.known_distractor(target, measured)
        assessment = replace(assessment, known_distractor=known_distractor)
        if not is_seen:
            assessment = self._occlusion_policy.assess(target, measured, assessment)
            box = self._occlusion_policy.redraw_box(target, assessment)
        if track.state != "occluded" or track.probation:
            # What looks like it elsewhere may be the target, what is followed something else.
            assessment = replace(assessment, learns=False)
        if not is_seen and now > thresholds.recovered_above:
            return assessment
        found = None
        if self._redetector:
            everywhere = searches_everywhere and track.state != "occluded"
            tracked_confidence = now if is_seen else 0.0
            found = self._redetector.find(
                target, measured, assessment, everywhere, tracked_confidence
            )
        if found is not None:
            box, assessment = found.box, self._believe(found, assessment)
        if box is None:
            return assessment
        particles, boxes = self._initializer.redraw_particles(
            target, box, measured.frame.size, draw
        )
        return replace(assessment, box=box, particles=particles, boxes=boxes, learns=False)

    def _believe(self, found: Candidate, assessment: Assessment) -> Assessment:
        """What is told once the target is found elsewhere.

        Where it went out of sight a moment ago it is that. After a longer time it may be something
        like it: then it counts as lost until more frames agree.
        """
        track = assessment.status
        if track.state == "tracking":
            return replace(assessment, confidence=0.0, status=track.as_lost(self._thresholds))
        if track.state == "occluded" and not track.probation:
            return replace(assessment, confidence=found.confidence, status=TrackStatus())
        return assessment


def _is_of_the_runner_up(target: FilterState, measured: Measurement) -> bool:
    """Whether the estimate has jumped to what was seen beside the target a frame before.

    Where it is not clear of where the target was, that may have moved so far.
    """
    return (
        target.status.state == "tracking"
        and target.second_peak is not None
        and bool(are_same_place(measured.box, target.second_peak))
        and bool(relative_center_distances(measured.box, target.estimate.box) >= 1.0)
    )
