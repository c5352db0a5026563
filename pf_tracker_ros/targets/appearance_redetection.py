"""Redetection of lost targets by their appearance, in the whole image.

1. A lost manual target is searched for every fifth frame, where there is no detector.
2. The appearance proposes the most similar boxes that are on no other target.
3. The particle filter searches around each. A box counts where both the appearance distance and the
   filter's confidence are good enough; the best one becomes the target's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance
from pf_tracker_ros.boxes import are_same_place, as_box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.box_kalman_filter import BoxKalmanFilter
from pf_tracker_ros.targets.tracks import NO_DETECTOR_AFTER, Track, TrackSet, boxes_of
from pf_tracker_ros.tracking.target_filter import TargetFilter
from pf_tracker_ros.values import replace

# Frames between two searches for a target, and the boxes that each compares.
_EVERY, _PLACES = 5, 6
# Largest appearance distance of a match, how much less than that of the present box it is, and its
# least confidence.
_MAX_DISTANCE, _MARGIN, _MIN_CONFIDENCE = 0.25, 0.1, 0.7


class AppearanceRedetector:
    """Moves lost manual targets to where they are seen again."""

    def __init__(self, target_filter: TargetFilter, appearance: Appearance) -> None:
        self._target_filter = target_filter
        self._appearance = appearance

    def find(self, track_set: TrackSet, frame: Frame) -> TrackSet:
        """The track set with the lost targets moved to where they are found."""
        lost = [track for track in track_set.tracks if _is_due(track)]
        if not lost or track_set.time_since_detection < NO_DETECTOR_AFTER:
            return track_set
        excluded = boxes_of(
            track for track in track_set.tracks if track.filter_state.estimate.state != "lost"
        )
        found: dict[Track, NDArray[np.float64]] = {}
        for track in lost:
            box = self._find_box(track, frame, excluded)
            if box is not None:
                found[track] = box
                excluded = np.vstack([excluded, box])
        return track_set.with_tracks(
            self._move_to(track, found[track]) if track in found else track
            for track in track_set.tracks
        )

    def _find_box(
        self, track: Track, frame: Frame, excluded: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """(4,) box of a lost target; None where it is not found."""
        box, size = track.box, np.array(track.filter_state.last_seen_box[2:])
        center = box[:2] + box[2:] / 2
        is_inside = bool(((center >= 0.0) & (center < frame.size)).all())
        present = self._distances(track, frame, [box])[0] if is_inside else 1.0
        best, least = None, min(_MAX_DISTANCE, present - _MARGIN)
        places = self._appearance.find(frame, track.descriptor, size, excluded, _PLACES)
        for place, distance in zip(places, self._distances(track, frame, places), strict=True):
            if distance < least:
                candidate = self._target_filter.search_around(track.filter_state, frame, place)
                if candidate is None or not are_same_place(candidate.box, as_box(place)):
                    continue
                if candidate.confidence > _MIN_CONFIDENCE:
                    best, least = candidate.box, distance
        return best

    def _distances(
        self, track: Track, frame: Frame, boxes: Sequence[NDArray[np.float64]]
    ) -> NDArray[np.float64]:
        """(N,) appearance distances of (4,) boxes from a target."""
        descriptors = self._appearance.extract(frame, np.array(boxes).reshape(-1, 4))
        return self._appearance.distance(track.descriptor, descriptors)

    def _move_to(self, track: Track, box: NDArray[np.float64]) -> Track:
        """A track moved to a (4,) box."""
        return replace(
            track,
            filter_state=self._target_filter.operations.move_to(track.filter_state, as_box(box)),
            box_filter=BoxKalmanFilter.initiate(box),
        )


def _is_due(track: Track) -> bool:
    """Whether a track is a lost manual one, and is searched for in this frame."""
    is_lost = track.is_manual and track.filter_state.estimate.state == "lost"
    return is_lost and track.filter_state.followed_frames % _EVERY == 0
