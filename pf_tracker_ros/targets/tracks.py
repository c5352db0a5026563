"""Tracks: the record of each target beside its particle filter, and the ids of all.

1. A `Track` is Deep SORT's: hits, age and time since the last detection, with an appearance
   descriptor and a Kalman filter of its box. The log odds of its existence replace Deep SORT's
   count of misses; the probability of existence is that of integrated probabilistic data
   association.
2. A `TrackSet` holds all tracks after one frame. Both are values, so that the frame buffer can
   keep earlier ones and reprocess from there.
3. `TrackIds` maps track keys to ids. Ids count from 1 in the order of the first report and are
   not reused, until a recording is rewound.

Sources: Wojke, Bewley and Paulus 2017, "Simple Online and Realtime Tracking with a Deep Association
Metric"; Musicki, Evans and Stankovic 1994, "Integrated Probabilistic Data Association".
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance, Descriptor
from pf_tracker_ros.boxes import SAME_OBJECT_ABOVE, Box, pairwise_iou
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.box_kalman_filter import GROWTH_VARIANCE, BoxKalmanFilter
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.values import replace

# Prior of the mean appearance distance, and the number of detections that it counts as.
_PRIOR_APPEARANCE_DISTANCE, _PRIOR_SAMPLES = 0.12, 10
# Detections that the mean appearance distance averages over; its minimum.
_AVERAGED_SAMPLES, _MIN_APPEARANCE_DISTANCE = 30, 0.02
# Largest appearance distance of the same target, in its mean appearance distances; that of a held
# one, which is looked for longer and comes back in other views.
_MAX_RELATIVE_DISTANCE, _MAX_HELD_DISTANCE = 1.5, 2.0
# Prior of the distance of the most similar other, and the share of each frame in it.
_PRIOR_OTHERS_DISTANCE, _OTHERS_RATE = 0.3, 0.1
# Existence log odds below which a held target is missing, if the image does not show it.
_MISSING_BELOW = 0.0
# Least log odds of existence that count with the image.
_LEAST_COUNTED = -6.0
# Labels with votes per track.
_MAX_LABELS = 10
# Minimum weight of a new detection in the descriptor.
_MIN_BLEND_RATE = 0.05
# Existence log odds above which a track is reported. Boxes of a target that the detector has just
# missed are wrong at least as often as right; one that a robot follows is held nevertheless.
_REPORTED_ABOVE = 0.5
# Seconds times targets over which the variance of growth is learned.
_GROWTH_LEARNED_OVER = 30.0
NO_DETECTOR_AFTER = 10.0
"""Seconds without detections after which there is no detector."""


class TrackKey(NamedTuple):
    """Identifies a track permanently, also when its frames are reprocessed.

    Attributes:
        frame: Number of the frame that it began in.
        number: Among the tracks that began there: from 0 up for detections, from -1 down for
            manual targets, from 1,000,000 up for distractors.
    """

    frame: int
    number: int


class DistractorCandidate(NamedTuple):
    """An object beside a target that looks like it, before it gets a track of its own.

    The (4,) box is in the last frame, pixels. The seconds are those from the first to the last of
    the consecutive frames that showed it.
    """

    box: NDArray[np.float64]
    box_filter: BoxKalmanFilter
    seconds: float


@dataclass(frozen=True, eq=False)
class Track:
    """A target; a value.

    Attributes:
        descriptor: Of its appearance, averaged over detections.
        mean_appearance_distance: Mean distance of its detections from the descriptor, 0 to 1.
        appearance_samples: Detections in these two averages.
        others_distance: Mean distance from it of the most similar other seen with a held one.
        existence_log_odds: Log odds that the target exists.
        votes: Label to the sum of its scores.
        age: Seconds since it began.
        hits: Detections assigned to it; the start counts as one.
        unconfirmed_for: Seconds since the last of them.
        time_since_template_update: Seconds since the templates were learned from a detection.
        is_confirmed: Whether it had enough hits to be reported.
        is_selected: Whether a robot acts on it; then it stays while it may come back.
        is_occluded_by_other: Whether another target is in front of it.
        is_duplicate: Whether, meanwhile, its box is on the same object as that of the other one.
        distracted_key: Key of the target that this distractor is told apart from; None for targets.
        unseen_for: Seconds for which a distractor was not seen; they count more where it should
            have been visible.
        distractor_candidate: None where nothing beside it looks like it.
        time_since_end: Seconds since it ended; None for active tracks.
    """

    key: TrackKey
    filter_state: FilterState
    descriptor: Descriptor
    box_filter: BoxKalmanFilter
    existence_log_odds: float
    mean_appearance_distance: float = _PRIOR_APPEARANCE_DISTANCE
    appearance_samples: int = 1
    others_distance: float = _PRIOR_OTHERS_DISTANCE
    votes: Mapping[str, float] = field(default_factory=dict)
    age: float = 0.0
    hits: int = 1
    unconfirmed_for: float = 0.0
    time_since_template_update: float = 0.0
    is_confirmed: bool = False
    is_selected: bool = False
    is_occluded_by_other: bool = False
    is_duplicate: bool = False
    distracted_key: TrackKey | None = None
    unseen_for: float = 0.0
    distractor_candidate: DistractorCandidate | None = None
    time_since_end: float | None = None

    @property
    def is_manual(self) -> bool:
        """Whether a user started it; then only a user ends it."""
        return self.key.number < 0

    @property
    def is_undetected(self) -> bool:
        """Whether it is manual, and no detection was ever assigned to it."""
        return self.is_manual and self.hits == 1

    @property
    def is_distractor(self) -> bool:
        """Whether it only exists to be told apart from a target.

        It looks like that, or a detector found it beside the last target that there may be.
        """
        return self.distracted_key is not None

    @property
    def is_held(self) -> bool:
        """Whether it stays, and is reported, while nothing shows it."""
        return self.is_manual or self.is_selected

    @property
    def is_missing(self) -> bool:
        """Whether it is a held target that neither the detector nor the image shows."""
        is_seen = self.unconfirmed_for == 0.0 or self.filter_state.estimate.state == "tracking"
        return self.is_held and not is_seen and self.existence_log_odds < _MISSING_BELOW

    @property
    def largest_distance(self) -> float:
        """Largest appearance distance, 0 to 1, at which it is found again.

        Where others look different enough, that of a held one is the geometric mean of its own mean
        distance and that of the most similar other.
        """
        mean = self.mean_appearance_distance
        if not self.is_held:
            return _MAX_RELATIVE_DISTANCE * mean
        return max(_MAX_HELD_DISTANCE * mean, math.sqrt(mean * self.others_distance))

    @property
    def label(self) -> str:
        """The label with the most votes, or an empty text."""
        return max(self.votes, key=lambda label: self.votes[label], default="")

    @property
    def box(self) -> NDArray[np.float64]:
        """(4,) estimated box of the last frame, pixels."""
        return np.array(self.filter_state.estimate.box)

    @property
    def predicted_box(self) -> NDArray[np.float64]:
        """(4,) box of the Kalman filter, pixels; in its last size where only the image shows it."""
        is_sized_by_image = self.is_undetected or self.is_distractor
        size = self.box[2:] if is_sized_by_image else self.box_filter.size
        return np.concatenate([self.box_filter.center - size / 2, size])

    def compensate_camera_motion(self, camera_motion: NDArray[np.float64]) -> Track:
        """The track after the camera has moved by a (3, 3) similarity, see `EgoMotion.update`.

        The Kalman filters are in the new image. The particles stay: the filter searches around the
        predicted center. The box keeps its size, since the target is not at the distance of the
        background.
        """
        candidate = self.distractor_candidate
        if candidate:
            candidate = candidate._replace(
                box_filter=candidate.box_filter.compensate_camera_motion(camera_motion)
            )
        return replace(
            self,
            box_filter=self.box_filter.compensate_camera_motion(camera_motion),
            distractor_candidate=candidate,
        )

    def older(self, interval: float, **fields: Any) -> Track:
        """The track of the next frame, hidden by no other one unless the changed fields say so."""
        visible = {"is_occluded_by_other": False, "is_duplicate": False}
        return replace(
            self,
            age=self.age + interval,
            unconfirmed_for=self.unconfirmed_for + interval,
            time_since_template_update=self.time_since_template_update + interval,
            **(visible | fields),
        )

    def predict(self, interval: float, growth_variance: float) -> Track:
        """The track with its box predicted; see `TrackSet.growth_variance`."""
        box_filter = self.box_filter.predict(interval, self.box[3], growth_variance)
        return replace(self, box_filter=box_filter)

    @property
    def is_reported(self) -> bool:
        """Whether it is part of the output: all that are held, and confirmed ones that are seen."""
        is_seen = (
            self.existence_log_odds > _REPORTED_ABOVE and self.filter_state.estimate.state != "lost"
        )
        is_seen = is_seen and not (self.is_duplicate or self.is_distractor)
        return self.is_held or (self.is_confirmed and is_seen)

    def add_label_vote(self, label: str, score: float) -> Track:
        """The track with one more vote for a label; an empty label is no vote."""
        if not label:
            return self
        votes = {**self.votes, label: self.votes.get(label, 0.0) + score}
        if len(votes) > _MAX_LABELS:
            # The new label stays, or none could ever be added.
            least = min((one for one in votes if one != label), key=lambda one: votes[one])
            del votes[least]
        return replace(self, votes=votes)

    def with_existence(self, log_odds: float, *, is_found: bool = False) -> Track:
        """The track with other log odds of existence, after a detector has looked.

        Where the detector knows its kind, they count with the image until it looks again: against a
        target that it does not see, and for a missing one that it has found (`is_found`).
        """
        filter_state = self.filter_state
        if not self.is_undetected:
            most = log_odds if is_found else 0.0
            factor = math.exp(min(max(log_odds, _LEAST_COUNTED), most))
            if factor != filter_state.detector_factor:
                filter_state = replace(filter_state, detector_factor=factor)
        return replace(self, existence_log_odds=log_odds, filter_state=filter_state)

    def with_covered_share(self, share: float) -> Track:
        """The track with the share, 0 to 1, of its next box that something in front covers."""
        evidence = self.filter_state.occlusion_evidence._replace(share=share, is_known=True)
        return replace(self, filter_state=replace(self.filter_state, occlusion_evidence=evidence))

    def with_outside_evidence(self, other: FilterState) -> Track:
        """The track with what another state of it in this frame knows from outside of the image."""
        track = replace(self, filter_state=replace(self.filter_state, standing=other.standing))
        evidence = other.occlusion_evidence
        return track.with_covered_share(evidence.share) if evidence.is_known else track

    def reset_descriptor(self, frame: Frame, box: Box, appearance: Appearance) -> Track:
        """The track with a new descriptor, from a box of a frame."""
        (descriptor,) = appearance.extract(frame, np.array([box]))
        return replace(
            self,
            descriptor=descriptor,
            mean_appearance_distance=_PRIOR_APPEARANCE_DISTANCE,
            appearance_samples=1,
            others_distance=_PRIOR_OTHERS_DISTANCE,
        )

    def update_descriptor(self, detected: Descriptor, appearance: Appearance) -> Track:
        """The track with the descriptor of one more detection, which no other one overlaps."""
        samples = self.appearance_samples + 1
        rate = 1.0 / min(samples + _PRIOR_SAMPLES, _AVERAGED_SAMPLES)
        distance = max(
            float(appearance.distance(self.descriptor, detected[None])[0]), _MIN_APPEARANCE_DISTANCE
        )
        return replace(
            self,
            descriptor=appearance.blend(
                self.descriptor, detected, max(1.0 / samples, _MIN_BLEND_RATE)
            ),
            mean_appearance_distance=self.mean_appearance_distance
            + rate * (distance - self.mean_appearance_distance),
            appearance_samples=samples,
        )

    def learn_others(self, others: NDArray[np.float32], appearance: Appearance) -> Track:
        """The track with the (N, D) descriptors of others that were seen with it, at least one."""
        nearest = float(appearance.distance(self.descriptor, others).min())
        change = _OTHERS_RATE * (nearest - self.others_distance)
        return replace(self, others_distance=self.others_distance + change)


def boxes_of(tracks: Iterable[Track]) -> NDArray[np.float64]:
    """(N, 4) estimated boxes of N tracks, pixels."""
    return np.array([track.box for track in tracks]).reshape(-1, 4)


@dataclass(frozen=True, eq=False)
class TrackSet:
    """All tracks after a frame; a value.

    Attributes:
        frame: Number of that frame.
        tracks: The active tracks, reported or not.
        ended_tracks: Tracks that have ended and can still be re-identified.
        time_since_detection: Seconds since the last frame with detections.
        detection_interval: Seconds between the last two of these frames; infinite before the
            second.
        growth_variance: Of the rate at which targets grow in the image, 1/s^2.
    """

    frame: int = 0
    tracks: tuple[Track, ...] = ()
    ended_tracks: tuple[Track, ...] = ()
    time_since_detection: float = math.inf
    detection_interval: float = math.inf
    growth_variance: float = GROWTH_VARIANCE

    @property
    def has_detector(self) -> bool:
        """Whether detections were ever received."""
        return self.time_since_detection < math.inf

    def with_tracks(self, tracks: Iterable[Track]) -> TrackSet:
        """The track set with other active tracks."""
        return replace(self, tracks=tuple(tracks))

    def learn_growth(self) -> TrackSet:
        """The track set with the variance of growth learned from its detected tracks.

        An expectation-maximization step: the mean of squared rate plus its variance, over the last
        thirty seconds of a target.
        """
        filters = [track.box_filter for track in self.tracks if track.hits > 1]
        if not filters or not math.isfinite(self.detection_interval):
            return self
        squares = [one.velocity[2] ** 2 + one.velocity_variance[2] for one in filters]
        share = 1.0 - math.exp(-len(squares) * self.detection_interval / _GROWTH_LEARNED_OVER)
        change = share * (sum(squares) / len(squares) - self.growth_variance)
        return replace(self, growth_variance=self.growth_variance + float(change))

    def with_outside_evidence(self, other: TrackSet) -> TrackSet:
        """The track set with what another one of the same frame knows from outside of the image.

        That is the covered shares and the heights of boxes of the same tracks.
        """
        known = {one.key: one.filter_state for one in other.tracks}
        return self.with_tracks(
            track.with_outside_evidence(known[track.key]) if track.key in known else track
            for track in self.tracks
        )

    def with_selected(self, key: TrackKey | None) -> TrackSet:
        """The track set in which the track of a key is selected, and no other."""
        if all(track.is_selected == (track.key == key) for track in self.tracks):
            return self
        return self.with_tracks(
            replace(track, is_selected=track.key == key) for track in self.tracks
        )

    @property
    def boxes(self) -> list[Box]:
        """Of the active tracks, pixels."""
        return [track.filter_state.estimate.box for track in self.tracks]

    @property
    def is_tracked(self) -> bool:
        """Whether any target is in state tracking, so that its templates may learn."""
        return any(track.filter_state.status.state == "tracking" for track in self.tracks)

    def compensate_camera_motion(self, camera_motion: NDArray[np.float64]) -> TrackSet:
        """The track set after the camera has moved, see `Track.compensate_camera_motion`."""
        return replace(
            self,
            tracks=tuple(track.compensate_camera_motion(camera_motion) for track in self.tracks),
            ended_tracks=tuple(
                track.compensate_camera_motion(camera_motion) for track in self.ended_tracks
            ),
        )

    def without(self, stopped: Track) -> TrackSet:
        """The track set without one track, active or ended, as it was when it was stopped.

        Where a late detection has started another track in its place, that one is removed.
        """
        all_tracks = (*self.tracks, *self.ended_tracks)
        key = stopped.key
        if all(one.key != key for one in all_tracks):
            key = _replacement_key(stopped, all_tracks)
        return replace(
            self,
            tracks=tuple(one for one in self.tracks if one.key != key),
            ended_tracks=tuple(one for one in self.ended_tracks if one.key != key),
        )


def _replacement_key(stopped: Track, others: Sequence[Track]) -> TrackKey:
    """Key of the track that a detection started in place of a stopped one; else its own key."""
    started = [one for one in others if not one.is_manual]
    if not started:
        return stopped.key
    overlaps = pairwise_iou(stopped.box[None], np.array([one.box for one in started]))[0]
    best = int(overlaps.argmax())
    return started[best].key if overlaps[best] > SAME_OBJECT_ABOVE else stopped.key


# Ids from which on those of ended tracks are pruned.
_MAX_IDS = 10_000


class TrackIds(dict[TrackKey, int]):
    """Maps the keys of tracks to their ids."""

    def __init__(self) -> None:
        super().__init__()
        self._last = 0

    def assign_id(self, track: Track) -> int:
        """The id of a track, a new one where it has none."""
        if track.key not in self:
            self._last += 1
            self[track.key] = self._last
        return self[track.key]

    def reported(self, tracks: Sequence[Track]) -> dict[int, Track]:
        """Id to track, of the reported tracks."""
        return {
            self[track.key]: track for track in tracks if track.is_reported and track.key in self
        }

    def next_manual_key(self, frame: int) -> TrackKey:
        """An unused key for a manual target in a frame."""
        numbers = (key.number for key in self if key.frame == frame)
        # Not their count: `transfer_id` removes keys.
        return TrackKey(frame, min(0, min(numbers, default=0)) - 1)

    def transfer_id(self, before: Sequence[TrackKey], now: TrackKey) -> None:
        """Give a track the first id of the tracks that it replaces; the other ids end."""
        ids = [id for key in before if (id := self.pop(key, None)) is not None]
        if ids:
            self[now] = ids[0]

    def inherit_ids(self, reported: Mapping[int, Track], track_set: TrackSet) -> None:
        """After reprocessing, give tracks the ids of those reported before that they replace."""
        present = {track.key for track in (*track_set.tracks, *track_set.ended_tracks)}
        lost = [(id, track) for id, track in reported.items() if track.key not in present]
        for track in track_set.tracks:
            if not lost or not track.is_reported or track.key in self:
                continue
            overlaps = pairwise_iou(track.box[None], np.array([one.box for _, one in lost]))[0]
            best = int(overlaps.argmax())
            if overlaps[best] > SAME_OBJECT_ABOVE:
                id, before = lost.pop(best)
                # The next reprocessing may bring the old key back, as another target.
                del self[before.key]
                self[track.key] = id

    def prune(self, track_set: TrackSet, oldest: int) -> None:
        """Remove the ids of tracks that no reprocessing since frame number `oldest` brings back."""
        if len(self) > _MAX_IDS:
            present = {track.key for track in (*track_set.tracks, *track_set.ended_tracks)}
            gone = [key for key in self if key not in present and key.frame < oldest]
            for key in gone:
                del self[key]


class LastSeen(NamedTuple):
    """The last frame in which a target was tracked, neither occluded nor lost, and its box."""

    frame: Frame
    box: Box


def last_seen_after(
    frame: Frame, track_set: TrackSet, before: Mapping[TrackKey, LastSeen]
) -> dict[TrackKey, LastSeen]:
    """Where each target was last seen, after a frame."""
    last_seen: dict[TrackKey, LastSeen] = {}
    for track in track_set.tracks:
        estimate = track.filter_state.estimate
        if estimate.state == "tracking":
            last_seen[track.key] = LastSeen(frame, estimate.box)
        elif track.key in before:
            last_seen[track.key] = before[track.key]
    return last_seen
