"""Looks for lost targets all over the image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance
from pf_tracker_ros.boxes import are_same_place, as_box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.association import CENTER_STD
from pf_tracker_ros.targets.center_kalman_filter import CenterKalmanFilter
from pf_tracker_ros.targets.tracks import Track, TrackSet
from pf_tracker_ros.tracking.target_filter import TargetFilter

# Every how many frames it is the turn of a target, and how many places are looked at then.
_EVERY, _PLACES = 5, 6
# Seconds without a detector after which there is none.
_ON_THEIR_OWN_AFTER = 10.0
# What is found differs from the target by less than this, by so much less than what is in its box
# now, and is it with more than this confidence.
_ALIKE_BELOW, _MARGIN, _CONFIDENT_ABOVE = 0.25, 0.1, 0.7


class AppearanceRedetector:
    """Brings lost targets to where they are seen again, if no detector will.

    What was started by hand, where there is no detector, has to be found by its appearance: where
    the image is most like it, and none of the other targets is, the filter is asked.

    Args:
        target_filter: Knows the targets.
        appearance: Describes them.
    """

    def __init__(self, target_filter: TargetFilter, appearance: Appearance) -> None:
        self._target_filter = target_filter
        self._appearance = appearance

    def find(self, track_set: TrackSet, frame: Frame) -> TrackSet:
        """The crowd with those brought there that are found.

        Args:
            track_set: In this frame.
            frame: At hand.
        """
        lost = [track for track in track_set.tracks if _is_looked_for(track)]
        if not lost or track_set.time_since_detection < _ON_THEIR_OWN_AFTER:
            return track_set
        others = [
            track.box for track in track_set.tracks if track.filter_state.estimate.state != "lost"
        ]
        known = np.array(others).reshape(-1, 4)
        found: dict[Track, NDArray[np.float64]] = {}
        for track in lost:
            box = self._place(track, frame, known)
            if box is not None:
                found[track] = box
                known = np.vstack([known, box])
        return replace(
            track_set,
            tracks=tuple(
                self._brought(track, found[track]) if track in found else track
                for track in track_set.tracks
            ),
        )

    def _place(
        self, track: Track, frame: Frame, known: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """(4,) box where a target is seen, None if nowhere."""
        box, size = track.box, np.array(track.filter_state.last_seen_box[2:])
        center = box[:2] + box[2:] / 2
        is_inside = bool(((center >= 0.0) & (center < frame.size)).all())
        here = self._distances(track, frame, [box])[0] if is_inside else 1.0
        best, least = None, min(_ALIKE_BELOW, here - _MARGIN)
        places = self._appearance.find(frame, track.descriptor, size, known, _PLACES)
        for place, differs in zip(places, self._distances(track, frame, places), strict=True):
            if differs < least:
                found = self._target_filter.search_around(track.filter_state, frame, place)
                is_there = found is not None and are_same_place(found.box, as_box(place))
                if found is not None and is_there and found.confidence > _CONFIDENT_ABOVE:
                    best, least = found.box, differs
        return best

    def _distances(
        self, track: Track, frame: Frame, boxes: Sequence[NDArray[np.float64]]
    ) -> NDArray[np.float64]:
        """(N,) how far what is in (4,) boxes is from a target."""
        seen = self._appearance.extract(frame, np.array(boxes).reshape(-1, 4))
        return self._appearance.distance(track.descriptor, seen)

    def _brought(self, track: Track, box: NDArray[np.float64]) -> Track:
        """A target that was found in a (4,) box."""
        return replace(
            track,
            filter_state=self._target_filter.operations.move_to(track.filter_state, as_box(box)),
            center_filter=CenterKalmanFilter.initiate(box, CENTER_STD * box[2:]),
        )


def _is_looked_for(track: Track) -> bool:
    """Whether a target is lost, nobody else will show it, and it is its turn."""
    is_lost = track.is_manual and track.filter_state.estimate.state == "lost"
    return is_lost and track.filter_state.followed_frames % _EVERY == 0
