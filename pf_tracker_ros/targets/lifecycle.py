"""When a target begins, by hand or by detections, and when it ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance, Descriptor
from pf_tracker_ros.boxes import Box, as_box, is_truncated, pairwise_iou
from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.association import CENTER_STD
from pf_tracker_ros.targets.center_kalman_filter import CenterKalmanFilter
from pf_tracker_ros.targets.detections import Detection
from pf_tracker_ros.targets.tracks import Track, TrackKey, TrackSet
from pf_tracker_ros.tracking.target_filter import TargetFilter

# A detection that overlaps a target without one by more than this is taken for a bad one of it.
_TAKEN_ABOVE = 0.45
# Belief in a target of a detection with a score of 1; with less, it is as much below that.
_FIRST_BELIEF = 1.0
# That in a rival: it ends once a slow detector sees the frame and does not find it.
_RIVAL_BELIEF = -0.45
# Seconds; what a detector says in as many of its answers as come within them is confirmed.
_CONFIRMED_WITHIN = 0.3
# Which child of the seed the targets' randomness comes from; others are the camera's.
_RANDOMNESS_KEY = 1


class Initiator:
    """Starts targets: by hand, or on detections of none that there is.

    Args:
        target_filter: Follows each target.
        seed: Seeds all randomness.
        most: Targets at a time.
        appearance: Describes them.
    """

    def __init__(
        self, target_filter: TargetFilter, seed: int, most: int, appearance: Appearance
    ) -> None:
        self._target_filter = target_filter
        self._seed = seed
        self._most = most
        self._appearance = appearance

    def initiate_manual(
        self,
        frame: Frame,
        box: Box,
        key: TrackKey,
        label: str,
        generator: np.random.Generator | None = None,
    ) -> Track:
        """A target that somebody asked for.

        Args:
            frame: That it was drawn on.
            box: Of the target, pixels.
            key: Names it.
            label: What it is.
            generator: Its source of randomness; None for one of its own among others.
        """
        track = self._life(frame, np.array(box), key, generator=generator)
        return track.add_label_vote(label, 1.0)

    def initiate_distractor(
        self, frame: Frame, box: NDArray[np.float64], key: TrackKey, host: Track
    ) -> Track:
        """What looks like a target beside it, in a (4,) box: no detector has found it so far."""
        track = self._life(frame, box, key).add_label_vote(host.label, 0.0)
        return replace(
            track,
            existence_log_odds=_RIVAL_BELIEF,
            hits=0,
            distracted_key=host.key,
            ground_box=None,
        )

    def initiate(
        self, track_set: TrackSet, frame: Frame, rest: Sequence[tuple[int, Detection]]
    ) -> TrackSet:
        """The crowd with new targets.

        Args:
            track_set: In this frame.
            frame: At hand.
            rest: The detections that are of none of the targets, with their places among all.
        """
        tracks = list(track_set.tracks)
        unconfirmed = [
            track.box for track in tracks if track.unconfirmed_for > 0.0 and not track.is_distractor
        ]
        boxes = np.array(unconfirmed).reshape(-1, 4)
        for place, one in rest:
            if sum(not track.is_distractor for track in tracks) >= self._most:
                break
            if pairwise_iou(one.box[None], boxes).max(initial=0.0) > _TAKEN_ABOVE:
                continue
            key = TrackKey(track_set.frame, place)
            track = self._life(frame, one.box, key, one.descriptor).add_label_vote(
                one.label, one.score
            )
            track = replace(track, existence_log_odds=_FIRST_BELIEF + 2.0 * (one.score - 1.0))
            tracks = [
                other
                for other in tracks
                if not (other.is_distractor and is_same_object(other, track.box))
            ]
            tracks.append(track)
        return replace(track_set, tracks=tuple(tracks))

    def add_manual(self, track_set: TrackSet, drawn: Sequence[Track]) -> TrackSet:
        """The crowd with targets that somebody drew on its frame.

        They take over those that a detector has started there, and have room before them.

        Args:
            track_set: In that frame.
            drawn: As they begin in it.
        """
        if not drawn:
            return track_set
        tracks = [
            track
            for track in track_set.tracks
            if track.is_manual or not any(is_same_object(track, one.box) for one in drawn)
        ]
        tracks += drawn
        surplus = self.surplus_keys(tracks)
        return replace(
            track_set, tracks=tuple(track for track in tracks if track.key not in surplus)
        )

    def surplus_keys(self, tracks: Sequence[Track]) -> set[TrackKey]:
        """Those that detectors have started beyond the number that there may be, the unsurest."""
        followed = [track for track in tracks if not track.is_distractor]
        started = [track for track in followed if not track.is_manual]
        started.sort(key=lambda track: (track.is_reported, track.existence_log_odds))
        return {track.key for track in started[: max(len(followed) - self._most, 0)]}

    def promote_distractors(self, track_set: TrackSet, own: Sequence[Detection | None]) -> TrackSet:
        """The crowd in which the rivals that detections show are targets, while there is room.

        Args:
            track_set: In this frame.
            own: The detection of each, None where there is none.
        """
        tracks = []
        room = self._most - sum(not track.is_distractor for track in track_set.tracks)
        for track, one in zip(track_set.tracks, own, strict=True):
            is_adopted = one is not None and track.is_distractor and room > 0
            room -= is_adopted
            tracks.append(replace(track, distracted_key=None) if is_adopted else track)
        return replace(track_set, tracks=tuple(tracks))

    def confirm(self, track_set: TrackSet, image_size: tuple[int, int]) -> TrackSet:
        """The crowd with those targets confirmed that were so often enough, while there is room.

        A fast detector has to say it in as many answers as a moment holds; a slow one is believed
        at once, since the next word would come too late. What the border cuts has to be said once
        more: half an object looks like others, and detectors are wrong there more often.

        Args:
            track_set: In this frame.
            image_size: (width, height), pixels.
        """
        answers = math.ceil(_CONFIRMED_WITHIN / max(track_set.detection_interval, 1e-3) - 1e-6)
        needed = max(answers, 1)
        tracks = []
        # Those that began before fewer targets were allowed may be too many.
        room = self._most - sum(track.is_manual or track.is_confirmed for track in track_set.tracks)
        for track in track_set.tracks:
            is_sure = track.hits >= needed + is_truncated(track.box, image_size)
            if is_sure and not (track.is_confirmed or track.is_manual):
                is_sure = room > 0
                room -= is_sure
            tracks.append(replace(track, is_confirmed=track.is_confirmed or is_sure))
        return replace(track_set, tracks=tuple(tracks))

    def _life(
        self,
        frame: Frame,
        box: NDArray[np.float64],
        key: TrackKey,
        descriptor: Descriptor | None = None,
        generator: np.random.Generator | None = None,
    ) -> Track:
        if descriptor is None:
            (descriptor,) = self._appearance.extract(frame, box[None])
        if generator is None:
            place = 2 * key.place if key.place >= 0 else -2 * key.place - 1
            spawn_key = (_RANDOMNESS_KEY, key.frame, place)
            generator = np.random.default_rng(
                np.random.SeedSequence(self._seed, spawn_key=spawn_key)
            )
        target = self._target_filter.initialize(frame, as_box(box), GeneratorState.of(generator))
        center_filter = CenterKalmanFilter.initiate(box, CENTER_STD * box[2:])
        ground_box = None if is_truncated(box, frame.size) else box
        return Track(
            key,
            target,
            descriptor,
            center_filter,
            np.log(box[2:]),
            _FIRST_BELIEF,
            ground_box=ground_box,
        )


def is_same_object(track: Track, box: NDArray[np.float64]) -> bool:
    """Whether a target and a (4,) box are on the same object."""
    return bool(pairwise_iou(track.box[None], box[None])[0, 0] > _TAKEN_ABOVE)


# Belief below which there is no such target.
_ENDS_BELOW = -1.0
# A target whose center is so near to the image's border, in its own sides, has left.
_LEFT_WITHIN = 0.03


class Deleter:
    """Ends targets that the detector does not find any more, or that have left the image.

    Args:
        reidentify_within: Seconds for which one that was told is remembered.
    """

    def __init__(self, reidentify_within: float) -> None:
        self._reidentify_within = reidentify_within

    def delete_tracks(
        self, track_set: TrackSet, image_size: tuple[int, int], interval: float
    ) -> TrackSet:
        """The crowd without those that end in this frame.

        Args:
            track_set: In this frame.
            image_size: (width, height), pixels.
            interval: Seconds since the last frame.
        """
        gone = [
            replace(track, time_since_end=(track.time_since_end or 0.0) + interval)
            for track in track_set.ended_tracks
        ]
        tracks = []
        for track in track_set.tracks:
            if track.is_manual or not (
                track.existence_log_odds < _ENDS_BELOW or _has_left(track, image_size)
            ):
                tracks.append(track)
            elif track.is_confirmed:
                gone.append(replace(track, time_since_end=0.0))
        kept = [track for track in gone if (track.time_since_end or 0.0) < self._reidentify_within]
        return replace(track_set, tracks=tuple(tracks), ended_tracks=tuple(kept))


def _has_left(track: Track, image_size: tuple[int, int]) -> bool:
    box = track.box
    center, margin = box[:2] + box[2:] / 2, _LEFT_WITHIN * box[2:]
    return bool((center <= margin).any() or (center >= np.array(image_size) - margin).any())
