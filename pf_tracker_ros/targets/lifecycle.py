"""Initiation, confirmation and deletion of tracks.

1. Initiate: a user's box, a detection of no track, or a distractor starts a tentative track.
2. Confirm: after enough hits, the track is reported.
3. Delete: a track ends once its existence log odds are low, or once it has left the image.

These are Deep SORT's tentative, confirmed and deleted tracks (Wojke, Bewley and Paulus 2017), with
log odds for its count of misses. Manual tracks are reported at once, and only a user ends them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance, Descriptor
from pf_tracker_ros.boxes import Box, as_box, is_on_any, is_truncated
from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.box_kalman_filter import BoxKalmanFilter
from pf_tracker_ros.targets.detections import Detection
from pf_tracker_ros.targets.tracks import Track, TrackKey, TrackSet, boxes_of
from pf_tracker_ros.tracking.target_filter import TargetFilter
from pf_tracker_ros.values import replace

# Existence log odds of a track whose first detection has the score 1; twice the difference less for
# a lower score.
_INITIAL_LOG_ODDS = 1.0
# Those of a distractor: one miss of a slow detector ends it.
_DISTRACTOR_LOG_ODDS = -0.45
# Seconds: a track is confirmed by as many hits as a detector has frames in them.
_CONFIRMED_WITHIN = 0.3
# Most people beside the last target that there may be that are told apart from it.
_BYSTANDERS = 6
# Child of the seed for the random numbers of tracks; others are of the image front end.
_SPAWN_KEY = 1


class Initiator:
    """Starts tracks: manual ones, ones on unassigned detections, and distractors."""

    def __init__(
        self, target_filter: TargetFilter, seed: int, max_targets: int, appearance: Appearance
    ) -> None:
        self._target_filter = target_filter
        self._seed = seed
        self._max_targets = max_targets
        self._appearance = appearance

    def initiate_manual(
        self,
        frame: Frame,
        box: Box,
        key: TrackKey,
        label: str,
        generator: np.random.Generator | None = None,
    ) -> Track:
        """A track that a user started, with random numbers of the generator, or else of its key."""
        track = self._new_track(frame, np.array(box), key, generator=generator)
        return track.add_label_vote(label, 1.0)

    def initiate_distractor(
        self, frame: Frame, box: NDArray[np.float64], key: TrackKey, distracted: Track
    ) -> Track:
        """A distractor of a track, in a (4,) box, without a detection."""
        track = self._new_track(frame, box, key).add_label_vote(distracted.label, 0.0)
        return replace(
            track,
            existence_log_odds=_DISTRACTOR_LOG_ODDS,
            hits=0,
            distracted_key=distracted.key,
        )

    def initiate(
        self, track_set: TrackSet, frame: Frame, unassigned: Sequence[tuple[int, Detection]]
    ) -> TrackSet:
        """The track set with new tracks on detections of no track, numbered among all."""
        tracks = list(track_set.tracks)
        # The detection may be a poor one of a track that has none in this frame. One of a missing
        # target is compared with it first (`ReIdentifier`, then `discard_doubtful`).
        undetected = boxes_of(
            track
            for track in tracks
            if track.unconfirmed_for > 0.0 and not (track.is_distractor or track.is_missing)
        )
        for number, one in unassigned:
            target = self._target_of_bystander(tracks)
            if target is None and self._room(tracks) <= 0:
                break
            if is_on_any(one.box, undetected):
                continue
            key = TrackKey(track_set.frame, number)
            track = self._new_track(frame, one.box, key, one.descriptor)
            track = track.add_label_vote(one.label, one.score)
            log_odds = _INITIAL_LOG_ODDS + 2.0 * (one.score - 1.0)
            tracks = [
                other
                for other in tracks
                if not (other.is_distractor and is_on_any(track.box, other.box[None]))
            ]
            distracted_key = target.key if target else None
            tracks.append(
                replace(track, existence_log_odds=log_odds, distracted_key=distracted_key)
            )
        return replace(track_set, tracks=tuple(tracks))

    def discard_doubtful(self, track_set: TrackSet) -> TrackSet:
        """The track set without new tracks on the boxes of targets that are still missing.

        Each may be a poor detection of that target, which the image may still show.
        """
        missing = boxes_of(track for track in track_set.tracks if track.is_missing)
        return track_set.with_tracks(
            track
            for track in track_set.tracks
            if track.key.frame < track_set.frame or not is_on_any(track.box, missing)
        )

    def _room(self, tracks: Sequence[Track]) -> int:
        """How many more targets there may be."""
        return self._max_targets - sum(not track.is_distractor for track in tracks)

    def _target_of_bystander(self, tracks: Sequence[Track]) -> Track | None:
        """The selected target from which a new track is only told apart; None if it is a target."""
        if self._room(tracks) > 0 or sum(track.is_distractor for track in tracks) >= _BYSTANDERS:
            return None
        return next((track for track in tracks if track.is_selected), None)

    def add_manual(self, track_set: TrackSet, started: Sequence[Track]) -> TrackSet:
        """The track set with manual tracks that begin in its frame.

        They replace detected tracks of the same objects, and have priority over other detected ones
        where there are too many.
        """
        if not started:
            return track_set
        tracks = [
            track
            for track in track_set.tracks
            if track.is_manual or not any(is_on_any(one.box, track.box[None]) for one in started)
        ]
        tracks += started
        surplus = self.surplus_keys(tracks)
        return track_set.with_tracks(track for track in tracks if track.key not in surplus)

    def surplus_keys(self, tracks: Sequence[Track]) -> set[TrackKey]:
        """Keys of the detected tracks beyond `max_targets`, those of the lowest log odds."""
        targets = [track for track in tracks if not track.is_distractor]
        detected = [track for track in targets if not track.is_manual]
        detected.sort(key=lambda track: (track.is_reported, track.existence_log_odds))
        return {track.key for track in detected[: max(len(targets) - self._max_targets, 0)]}

    def promote_distractors(
        self, track_set: TrackSet, assigned: Sequence[Detection | None]
    ) -> TrackSet:
        """The track set in which detected distractors are targets, up to `max_targets`."""
        tracks = []
        room = self._room(track_set.tracks)
        for track, detection in zip(track_set.tracks, assigned, strict=True):
            is_promoted = detection is not None and track.is_distractor and room > 0
            room -= is_promoted
            tracks.append(replace(track, distracted_key=None) if is_promoted else track)
        return replace(track_set, tracks=tuple(tracks))

    def confirm(self, track_set: TrackSet, image_size: tuple[int, int]) -> TrackSet:
        """The track set with the tracks confirmed that have enough hits, up to `max_targets`.

        A fast detector needs as many hits as it has frames in 0.3 s; a slow one needs one. A box
        that the image border cuts needs one more: detectors are wrong there more often.
        """
        hits = math.ceil(_CONFIRMED_WITHIN / max(track_set.detection_interval, 1e-3) - 1e-6)
        needed = max(hits, 1)
        tracks = []
        # Negative where `max_targets` was lowered meanwhile.
        room = self._max_targets - sum(
            track.is_manual or track.is_confirmed for track in track_set.tracks
        )
        for track in track_set.tracks:
            is_sure = track.hits >= needed + is_truncated(track.box, image_size)
            if is_sure and not (track.is_confirmed or track.is_manual):
                is_sure = room > 0
                room -= is_sure
            tracks.append(replace(track, is_confirmed=track.is_confirmed or is_sure))
        return replace(track_set, tracks=tuple(tracks))

    def _new_track(
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
            number = 2 * key.number if key.number >= 0 else -2 * key.number - 1
            spawn_key = (_SPAWN_KEY, key.frame, number)
            generator = np.random.default_rng(
                np.random.SeedSequence(self._seed, spawn_key=spawn_key)
            )
        generator_state = GeneratorState.of(generator)
        filter_state = self._target_filter.initialize(frame, as_box(box), generator_state)
        return Track(
            key,
            filter_state,
            descriptor,
            BoxKalmanFilter.initiate(box),
            _INITIAL_LOG_ODDS,
        )


# Existence log odds below which a track ends.
_ENDS_BELOW = -1.0
# A target whose center is this near to the image border, in its own sides, has left.
_LEFT_WITHIN = 0.03


class Deleter:
    """Ends tracks that the detector does not find any more, or that have left the image.

    An ended track can be re-identified for `reidentify_within` seconds, and the selected one ends
    `keep_selected` seconds after its last detection.
    """

    def __init__(self, reidentify_within: float, keep_selected: float) -> None:
        self._reidentify_within, self._keep_selected = reidentify_within, keep_selected

    def delete_tracks(
        self, track_set: TrackSet, image_size: tuple[int, int], interval: float
    ) -> TrackSet:
        """The track set without the tracks that end in this frame."""
        ended = [
            replace(track, time_since_end=(track.time_since_end or 0.0) + interval)
            for track in track_set.ended_tracks
        ]
        tracks = []
        for track in track_set.tracks:
            if self._stays(track) or not (
                track.existence_log_odds < _ENDS_BELOW or _has_left(track, image_size)
            ):
                tracks.append(track)
            elif track.is_confirmed:
                ended.append(replace(track, time_since_end=0.0))
        kept = [track for track in ended if (track.time_since_end or 0.0) < self._reidentify_within]
        return replace(track_set, tracks=tuple(tracks), ended_tracks=tuple(kept))

    def _stays(self, track: Track) -> bool:
        """Whether nothing but a user ends a track, or it may still come back."""
        may_return = track.unconfirmed_for <= self._keep_selected
        return track.is_manual or (track.is_selected and may_return)


def _has_left(track: Track, image_size: tuple[int, int]) -> bool:
    box = track.box
    center, margin = box[:2] + box[2:] / 2, _LEFT_WITHIN * box[2:]
    return bool((center <= margin).any() or (center >= np.array(image_size) - margin).any())
