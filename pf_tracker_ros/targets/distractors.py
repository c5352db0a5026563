"""What looks like a target beside it, and is none: followed too, so that both can be told apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import as_box, is_truncated, pairwise_iou
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.association import CENTER_STD
from pf_tracker_ros.targets.center_kalman_filter import CenterKalmanFilter
from pf_tracker_ros.targets.lifecycle import Initiator
from pf_tracker_ros.targets.tracks import DistractorCandidate, Track, TrackKey, TrackSet
from pf_tracker_ros.tracking.state_operations import StateOperations

# Seconds for which it is seen, so that it is no flicker, and how far it may be from where it was
# expected, in its sides.
_SHOWN_FOR, _NEAR = 0.1, 0.5
# What overlaps a target by more than this is part of it.
_APART_BELOW = 0.3
# What overlaps another target by more than this is that one.
_SAME_ABOVE = 0.5
# Two that will be within half a side of each other in so many seconds may be taken for each other.
_MEET, _SOON = 0.5, 1.0
# Farther from its target, in its own sides, it is not taken for it.
_FAR = 2.0
# Seconds for which one is carried on that is not seen because its target is in front of it or
# behind it, within so many sides; one that should be seen then ends so many times faster.
_UNSEEN_FOR, _BESIDE, _FASTER = 2.0, 0.7, 6.0
# At a time.
_MOST = 2
# Their places among what begins in a frame are above those of detections.
_FIRST_PLACE = 1_000_000


class DistractorManager:
    """Starts, moves and ends rivals: targets that nobody asked for and that are not told.

    A target that walks past its like could leave with it. So what looks like a target beside it is
    a target as well, as soon as the two are about to cross: it explains its own pixels, and a
    detection of it is not taken for that of the other one. It costs next to nothing: its course
    leads it, and what the other one, which it looks like, sees of it in its own search corrects
    that. The first detection makes it a target like others; until then it ends once it is far from
    the other one, or not seen.

    Args:
        initiator: Begins them.
        operations: Moves them.
    """

    def __init__(self, initiator: Initiator, operations: StateOperations) -> None:
        self._initiator = initiator
        self._operations = operations

    def initiate(
        self, track_set: TrackSet, frame: Frame, interval: float, *, is_seen: bool
    ) -> TrackSet:
        """The crowd with what was seen beside the targets for a moment.

        Args:
            track_set: In this frame.
            frame: At hand.
            interval: Seconds since the last one.
            is_seen: Whether a detector saw the frame: then it is that which tells what is there.
        """
        tracks = [_glimpsed(track, interval) for track in track_set.tracks]
        if is_seen:
            return replace(track_set, tracks=tuple(tracks))
        rivals = sum(track.is_distractor for track in tracks)
        for host in tuple(tracks):
            distractor_candidate = host.distractor_candidate
            if (
                distractor_candidate is None
                or distractor_candidate.seconds < _SHOWN_FOR
                or not host.is_reported
            ):
                continue
            if rivals >= _MOST:
                break
            others = np.array([track.box for track in tracks])
            is_part = pairwise_iou(distractor_candidate.box[None], others).max() > _APART_BELOW
            if (
                is_part
                or is_truncated(distractor_candidate.box, frame.size)
                or not _will_meet(host, distractor_candidate)
            ):
                continue
            key = TrackKey(track_set.frame, _FIRST_PLACE + rivals)
            track = self._initiator.initiate_distractor(frame, distractor_candidate.box, key, host)
            tracks.append(replace(track, center_filter=distractor_candidate.center_filter))
            rivals += 1
        return replace(track_set, tracks=tuple(tracks))

    def update(self, track_set: TrackSet, interval: float) -> TrackSet:
        """The crowd with the rivals where they are seen, without those of no use any more.

        Args:
            track_set: In this frame.
            interval: Seconds since the last one.
        """
        targets = {track.key: track for track in track_set.tracks if not track.is_distractor}
        if len(targets) == len(track_set.tracks):
            return track_set
        tracks: list[Track] = []
        for track in track_set.tracks:
            if not track.distracted_key:
                tracks.append(track)
            elif track.distracted_key in targets:
                host = targets[track.distracted_key]
                rival = self._moved(track, host, interval)
                if _is_of_use(rival, host, [one for one in targets.values() if one is not host]):
                    tracks.append(rival)
        return replace(track_set, tracks=tuple(tracks))

    def _moved(self, rival: Track, host: Track, interval: float) -> Track:
        """A rival where its course takes it, corrected by what its host sees of it."""
        center_filter, seen, unseen_for = rival.center_filter, host.filter_state.distractor_box, 0.0
        if seen is not None and _are_within(rival.expected, seen, _NEAR):
            center, deviation = seen[:2] + seen[2:] / 2, CENTER_STD * seen[2:]
            center_filter = center_filter.correct(center, deviation)
        else:
            is_visible = not host.is_occluded_by_other and not _are_within(
                rival.expected, host.box, _BESIDE
            )
            unseen_for = rival.unseen_for + interval * (_FASTER if is_visible else 1.0)
        rival = replace(
            rival,
            center_filter=center_filter,
            age=rival.age + interval,
            distractor_candidate=None,
            unseen_for=unseen_for,
        )
        target = self._operations.move_to(rival.filter_state, as_box(rival.expected))
        return replace(rival, filter_state=target)


def _glimpsed(track: Track, interval: float) -> Track:
    """A target with what was seen beside it lately, this frame included."""
    box, before = track.filter_state.distractor_box, track.distractor_candidate
    if box is None or track.is_distractor or track.is_occluded_by_other:
        return track if before is None else replace(track, distractor_candidate=None)
    center, deviation = box[:2] + box[2:] / 2, CENTER_STD * box[2:]
    if before is not None:
        center_filter = before.center_filter.predict(interval, box[3])
        if (np.abs(center_filter.center - center) < _NEAR * box[2:]).all():
            center_filter = center_filter.correct(center, deviation)
            return replace(
                track,
                distractor_candidate=DistractorCandidate(
                    box, center_filter, before.seconds + interval
                ),
            )
    return replace(
        track,
        distractor_candidate=DistractorCandidate(
            box, CenterKalmanFilter.initiate(box, deviation), 0.0
        ),
    )


def _will_meet(host: Track, distractor_candidate: DistractorCandidate) -> bool:
    """Whether a target and what was seen beside it are about to cross."""
    apart = distractor_candidate.center_filter.center - host.center_filter.center
    speed = distractor_candidate.center_filter.velocity - host.center_filter.velocity
    when = np.clip(-(apart @ speed) / np.maximum(speed @ speed, 1e-9), 0.0, _SOON)
    return bool((np.abs(apart + when * speed) < _MEET * distractor_candidate.box[2:]).all())


def _is_of_use(rival: Track, host: Track, others: Sequence[Track]) -> bool:
    """Whether a rival may be seen near its host, and is none of the other targets."""
    if rival.unseen_for > _UNSEEN_FOR or not _are_within(rival.box, host.box, _FAR):
        return False
    boxes = np.array([one.box for one in others]).reshape(-1, 4)
    return bool(pairwise_iou(rival.box[None], boxes).max(initial=0.0) <= _SAME_ABOVE)


def _are_within(one: NDArray[np.float64], other: NDArray[np.float64], sides: float) -> bool:
    """Whether the centers of two (4,) boxes are within so many sides of the first one."""
    apart = np.abs(other[:2] + other[2:] / 2 - one[:2] - one[2:] / 2)
    return bool((apart < sides * one[2:]).all())
