"""Distractors: objects that look like a target beside it, tracked so that both are told apart.

A target that crosses a similar object could be lost to it. So the object gets a track of its own:

1. Candidate: the filter of a target reports the likeliest similar box beside it, in each frame.
2. Initiate: a candidate that was seen for 0.1 s and is about to cross the target becomes a track.
   It explains its own pixels, and its detections are not assigned to the target.
3. Update: the track moves with its Kalman filter, corrected by the candidates near it, without a
   particle filter.
4. Promote or end: a detection turns it into a target (`Initiator.promote_distractors`). Otherwise
   it ends far from the target, on another target, or unseen.

Compare Zhu et al. 2018, "Distractor-aware Siamese Networks for Visual Object Tracking", which keeps
similar objects as negative templates.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pf_tracker_ros.boxes import (
    as_box,
    is_on_any,
    is_truncated,
    pairwise_iou,
    relative_center_distances,
)
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.box_kalman_filter import BoxKalmanFilter
from pf_tracker_ros.targets.lifecycle import Initiator
from pf_tracker_ros.targets.tracks import DistractorCandidate, Track, TrackKey, TrackSet, boxes_of
from pf_tracker_ros.tracking.state_operations import StateOperations
from pf_tracker_ros.values import replace

# Seconds for which a candidate is seen before it becomes a track, and its largest distance from its
# prediction, in its sides.
_SEEN_FOR, _NEAR = 0.1, 0.5
# A candidate with a larger intersection over union with a track is a part of that.
_SEPARATE_BELOW = 0.3
# Distance in sides, and seconds: nearer than this within that time, two tracks are about to cross.
_CROSSING_DISTANCE, _CROSSING_WITHIN = 0.5, 1.0
# Distance from its target, in its own sides, beyond which a distractor ends.
_FAR = 2.0
# Seconds unseen after which it ends. They count six times where it should be visible: its target is
# not occluded, and farther away than 0.7 of its sides.
_UNSEEN_FOR, _BESIDE, _VISIBLE_RATE = 2.0, 0.7, 6.0
# Distractors at a time.
_MAX_DISTRACTORS = 2
# Numbers of their keys begin above those of detections.
_FIRST_NUMBER = 1_000_000


class DistractorManager:
    """Starts, updates and ends distractors; they are not reported."""

    def __init__(self, initiator: Initiator, operations: StateOperations) -> None:
        self._initiator = initiator
        self._operations = operations

    def initiate(
        self, track_set: TrackSet, frame: Frame, interval: float, *, has_detections: bool
    ) -> TrackSet:
        """The track set with updated candidates and new distractors.

        In a frame with detections no distractor begins, since they show what there is.
        """
        tracks = [_with_candidate(track, interval) for track in track_set.tracks]
        if has_detections:
            return replace(track_set, tracks=tuple(tracks))
        count = sum(track.is_distractor for track in tracks)
        for target in tuple(tracks):
            candidate = target.distractor_candidate
            if candidate is None or candidate.seconds < _SEEN_FOR or not target.is_reported:
                continue
            if count >= _MAX_DISTRACTORS:
                break
            is_part = pairwise_iou(candidate.box[None], boxes_of(tracks)).max() > _SEPARATE_BELOW
            is_cut = is_truncated(candidate.box, frame.size)
            if is_part or is_cut or not _will_cross(target, candidate):
                continue
            key = TrackKey(track_set.frame, _FIRST_NUMBER + count)
            track = self._initiator.initiate_distractor(frame, candidate.box, key, target)
            tracks.append(replace(track, box_filter=candidate.box_filter))
            count += 1
        return replace(track_set, tracks=tuple(tracks))

    def update(self, track_set: TrackSet, interval: float) -> TrackSet:
        """The track set with updated distractors, without those that end."""
        targets = {track.key: track for track in track_set.tracks if not track.is_distractor}
        if len(targets) == len(track_set.tracks):
            return track_set
        tracks: list[Track] = []
        for track in track_set.tracks:
            if not track.distracted_key:
                tracks.append(track)
            elif track.distracted_key in targets:
                target = targets[track.distracted_key]
                distractor = self._update_one(track, target, interval)
                others = [one for one in targets.values() if one is not target]
                if _continues(distractor, target, others):
                    tracks.append(distractor)
        return replace(track_set, tracks=tuple(tracks))

    def _update_one(self, distractor: Track, target: Track, interval: float) -> Track:
        """A distractor at its predicted center, corrected by the target's observation of it."""
        box_filter, unseen_for = distractor.box_filter, 0.0
        box, predicted = target.filter_state.distractor_box, distractor.predicted_box
        if box is not None and relative_center_distances(box, predicted) < _NEAR:
            box_filter = box_filter.correct(box)
        else:
            is_beside = relative_center_distances(target.box, predicted) < _BESIDE
            is_visible = not target.is_occluded_by_other and not is_beside
            unseen_for = distractor.unseen_for + interval * (_VISIBLE_RATE if is_visible else 1.0)
        distractor = replace(
            distractor,
            box_filter=box_filter,
            distractor_candidate=None,
            unseen_for=unseen_for,
        )
        filter_state = self._operations.move_to(
            distractor.filter_state, as_box(distractor.predicted_box)
        )
        return replace(distractor, filter_state=filter_state)


def _with_candidate(track: Track, interval: float) -> Track:
    """A track with its distractor candidate updated by this frame."""
    box, before = track.filter_state.distractor_box, track.distractor_candidate
    if box is None or track.is_distractor or track.is_occluded_by_other:
        return track if before is None else replace(track, distractor_candidate=None)
    candidate = DistractorCandidate(box, BoxKalmanFilter.initiate(box), 0.0)
    if before is not None:
        predicted = before.box_filter.predict(interval, box[3])
        if (np.abs(predicted.center - box[:2] - box[2:] / 2) < _NEAR * box[2:]).all():
            candidate = DistractorCandidate(box, predicted.correct(box), before.seconds + interval)
    return replace(track, distractor_candidate=candidate)


def _will_cross(target: Track, candidate: DistractorCandidate) -> bool:
    """Whether a target and its candidate are about to cross, at their present velocities."""
    offset = candidate.box_filter.center - target.box_filter.center
    velocity = (candidate.box_filter.velocity - target.box_filter.velocity)[:2]
    squared_speed = np.maximum(velocity @ velocity, 1e-9)
    closest_after = np.clip(-(offset @ velocity) / squared_speed, 0.0, _CROSSING_WITHIN)
    distances = np.abs(offset + closest_after * velocity)
    return bool((distances < _CROSSING_DISTANCE * candidate.box[2:]).all())


def _continues(distractor: Track, target: Track, others: Sequence[Track]) -> bool:
    """Whether a distractor is seen, near its target, and on no other target.

    One that a detector has found ends as targets do.
    """
    if distractor.hits:
        return True
    is_far = relative_center_distances(target.box, distractor.box) >= _FAR
    if distractor.unseen_for > _UNSEEN_FOR or is_far:
        return False
    return not is_on_any(distractor.box, boxes_of(others))
