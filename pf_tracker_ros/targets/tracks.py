"""Tracks: what is known of each target beside the filter, all of them after a frame, their ids.

A track (`Track`) is a value: where it came from, what speaks for it, what it has been called. All of
a frame are one value, too (`TrackSet`), so that the past can be processed again. Ids count from 1 in
the order in which targets are reported, and are never used again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance, Descriptor
from pf_tracker_ros.boxes import Box, pairwise_iou
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.center_kalman_filter import CenterKalmanFilter
from pf_tracker_ros.tracking.filter_state import FilterState

# How far a target usually is from its own descriptor, before it is known, and how many detections
# that is worth.
PRIOR_APPEARANCE_DISTANCE, _PRIOR_VIEWS = 0.12, 10
# Detections that a descriptor, and how much it varies, are averages of; the least that it varies.
_VIEWS, _LEAST_VARIES = 30, 0.02
# Labels of a target that are counted.
_MOST_LABELS = 10
# Least share of a detection's descriptor in that of its target.
_RATE = 0.05


class TrackKey(NamedTuple):
    """Names a target for good, even where what happened since is worked out again.

    Attributes:
        frame: Number of the frame that it began in.
        place: Among those that began there: from 0 up by a detection, from -1 down by hand; for
            rivals from 1,000,000 up.
    """

    frame: int
    place: int


class DistractorCandidate(NamedTuple):
    """What looks like a target beside it.

    Attributes:
        box: (4,) in the last frame, pixels.
        center_filter: Where it goes.
        seconds: From the first to the last of the frames in a row that showed it.
    """

    box: NDArray[np.float64]
    center_filter: CenterKalmanFilter
    seconds: float


@dataclass(frozen=True, eq=False)
class Track:
    """A target, and what is known of it beside its place and its templates; a value.

    Attributes:
        key: Its name for good.
        filter_state: As the filter follows it.
        descriptor: Of its appearance, as far as confirmed.
        mean_appearance_distance: How far its detections usually are from that, 0 to 1.
        appearance_samples: Detections that both were made of.
        center_filter: Where it goes.
        log_size: (2,) logarithms of its width and height, smoothed over the detections.
        existence_log_odds: Logarithm of the odds that there is such a target.
        votes: Label to the sum of the scores with which it was given.
        age: Seconds since it began.
        hits: Detections that were taken for it, the first one too.
        unconfirmed_for: Seconds since the last of them.
        time_since_template_update: Seconds since it was learned anew.
        is_confirmed: Whether it was confirmed often enough to be told.
        is_occluded_by_other: Whether another target is in front of it.
        is_duplicate: Whether its box, then, is as good as that of the other one.
        may_have_switched: Whether it may be another one by now, which it was seen beside.
        distracted_key: The target that it looks like and is beside of, where only that is known of it: a
            rival, which is followed to be told apart, and not told. None for all others.
        unseen_for: Seconds for which a rival was not seen; more where it should have been.
        distractor_candidate: What looks like it beside it; None where nothing does.
        time_since_end: Seconds since it ended; None while it is followed.
        ground_box: (4,) box that somebody or the detector last told of it whole, pixels; None where
            nobody did, or the camera has moved since.
    """

    key: TrackKey
    filter_state: FilterState
    descriptor: Descriptor
    center_filter: CenterKalmanFilter
    log_size: NDArray[np.float64]
    existence_log_odds: float
    mean_appearance_distance: float = PRIOR_APPEARANCE_DISTANCE
    appearance_samples: int = 1
    votes: Mapping[str, float] = field(default_factory=dict)
    age: float = 0.0
    hits: int = 1
    unconfirmed_for: float = 0.0
    time_since_template_update: float = 0.0
    is_confirmed: bool = False
    is_occluded_by_other: bool = False
    is_duplicate: bool = False
    may_have_switched: bool = False
    distracted_key: TrackKey | None = None
    unseen_for: float = 0.0
    distractor_candidate: DistractorCandidate | None = None
    time_since_end: float | None = None
    ground_box: NDArray[np.float64] | None = None

    @property
    def is_manual(self) -> bool:
        """Whether somebody asked for it, so that only they end it."""
        return self.key.place < 0

    @property
    def is_undetected(self) -> bool:
        """Whether nobody has told of it since somebody asked for it: no detector knows it."""
        return self.is_manual and self.hits == 1

    @property
    def is_distractor(self) -> bool:
        """Whether it is only known to look like another."""
        return self.distracted_key is not None

    @property
    def label(self) -> str:
        """What it was called most."""
        return max(self.votes, key=lambda label: self.votes[label], default="")

    @property
    def box(self) -> NDArray[np.float64]:
        """(4,) as the last frame left it, pixels."""
        return np.array(self.filter_state.estimate.box)

    @property
    def expected(self) -> NDArray[np.float64]:
        """(4,) box where its course is, pixels."""
        size = self.box[2:]
        return np.concatenate([self.center_filter.center - size / 2, size])

    def compensate_camera_motion(self, camera_motion: NDArray[np.float64]) -> Track:
        """The same after the camera has moved: courses are those through the scene.

        Its particles stay: they look for it in the image, near where its course leads, and
        its box has a size of its own, since the scene is not as far away as it is.

        Args:
            camera_motion: (3, 3), see `EgoMotion.follow`.
        """
        distractor_candidate = self.distractor_candidate
        if distractor_candidate:
            distractor_candidate = distractor_candidate._replace(
                center_filter=distractor_candidate.center_filter.compensate_camera_motion(
                    camera_motion
                )
            )
        center_filter = self.center_filter.compensate_camera_motion(camera_motion)
        return replace(
            self,
            center_filter=center_filter,
            distractor_candidate=distractor_candidate,
            ground_box=None,
        )

    def predict(self, interval: float) -> Track:
        """The same, with its course so many seconds later."""
        return replace(self, center_filter=self.center_filter.predict(interval, self.box[3]))

    @property
    def is_reported(self) -> bool:
        """Whether it is sure enough, and seen well enough, to be told."""
        is_seen = self.existence_log_odds > 0.0 and self.filter_state.estimate.state != "lost"
        is_seen = is_seen and not (self.is_duplicate or self.is_distractor)
        return self.is_manual or (self.is_confirmed and is_seen)

    def add_label_vote(self, label: str, score: float) -> Track:
        """The same, called by a label once more; without one, nothing is said."""
        if not label:
            return self
        votes = {**self.votes, label: self.votes.get(label, 0.0) + score}
        if len(votes) > _MOST_LABELS:
            # The newest one stays, or no other could ever win.
            least = min((one for one in votes if one != label), key=lambda one: votes[one])
            del votes[least]
        return replace(self, votes=votes)

    def reset_descriptor(self, frame: Frame, box: Box, appearance: Appearance) -> Track:
        """The same, described anew by what is in its box."""
        (descriptor,) = appearance.extract(frame, np.array([box]))
        return replace(
            self,
            descriptor=descriptor,
            mean_appearance_distance=PRIOR_APPEARANCE_DISTANCE,
            appearance_samples=1,
        )

    def update_descriptor(self, seen: Descriptor, appearance: Appearance) -> Track:
        """The same, seen once more alone."""
        views = self.appearance_samples + 1
        rate = 1.0 / min(views + _PRIOR_VIEWS, _VIEWS)
        differs = max(float(appearance.distance(self.descriptor, seen[None])[0]), _LEAST_VARIES)
        return replace(
            self,
            descriptor=appearance.blend(self.descriptor, seen, max(1.0 / views, _RATE)),
            mean_appearance_distance=self.mean_appearance_distance
            + rate * (differs - self.mean_appearance_distance),
            appearance_samples=views,
        )


SAME_ABOVE = 0.5
"""A target that a late detection has started is the one that was there before if they overlap by
more than this."""


@dataclass(frozen=True, eq=False)
class TrackSet:
    """All targets after a frame, a value.

    Attributes:
        frame: Number of that frame.
        tracks: The targets that are followed, told or not.
        ended_tracks: Those that have ended and are remembered.
        time_since_detection: Seconds since the detector saw a frame.
        detection_interval: Seconds between the last two frames that it saw; infinite before the second.
    """

    frame: int = 0
    tracks: tuple[Track, ...] = ()
    ended_tracks: tuple[Track, ...] = ()
    time_since_detection: float = math.inf
    detection_interval: float = math.inf

    @property
    def has_detector(self) -> bool:
        """Whether a detector has ever said something."""
        return self.time_since_detection < math.inf

    @property
    def boxes(self) -> list[Box]:
        """Where the targets are, pixels."""
        return [track.filter_state.estimate.box for track in self.tracks]

    def compensate_camera_motion(self, camera_motion: NDArray[np.float64]) -> TrackSet:
        """The same after the camera has moved, see `Track.compensate_camera_motion`."""
        return replace(
            self,
            tracks=tuple(track.compensate_camera_motion(camera_motion) for track in self.tracks),
            ended_tracks=tuple(
                track.compensate_camera_motion(camera_motion) for track in self.ended_tracks
            ),
        )

    def without(self, stopped: Track) -> TrackSet:
        """The same, without one of them, followed or gone.

        Where a late detection has started another one in its place, without that.

        Args:
            stopped: As it was when it was to be forgotten.
        """
        everybody = (*self.tracks, *self.ended_tracks)
        key = stopped.key
        if all(one.key != key for one in everybody):
            key = _in_place_of(stopped, everybody)
        return replace(
            self,
            tracks=tuple(one for one in self.tracks if one.key != key),
            ended_tracks=tuple(one for one in self.ended_tracks if one.key != key),
        )


def _in_place_of(stopped: Track, others: Sequence[Track]) -> TrackKey:
    """The key of the target that a detector started where another one was; else that one's own."""
    started = [one for one in others if not one.is_manual]
    if not started:
        return stopped.key
    same = pairwise_iou(stopped.box[None], np.array([one.box for one in started]))[0]
    best = int(same.argmax())
    return started[best].key if same[best] > SAME_ABOVE else stopped.key


# TrackIds of targets that are remembered beyond those that there are.
_MOST_NAMES = 10_000


class TrackIds:
    """TrackKey of a target to its id."""

    def __init__(self) -> None:
        self._ids: dict[TrackKey, int] = {}
        self._last = 0

    def __contains__(self, key: TrackKey) -> bool:
        return key in self._ids

    def __getitem__(self, key: TrackKey) -> int:
        return self._ids[key]

    def get(self, key: TrackKey) -> int | None:
        """The id of a target, None while it has none."""
        return self._ids.get(key)

    def assign_id(self, track: Track) -> int:
        """The id of a target, which gets one if it has none."""
        if track.key not in self._ids:
            self._last += 1
            self._ids[track.key] = self._last
        return self._ids[track.key]

    def reported(self, tracks: Sequence[Track]) -> dict[int, Track]:
        """Id to target, of those that are told."""
        return {
            self._ids[track.key]: track
            for track in tracks
            if track.is_reported and track.key in self
        }

    def next_manual_key(self, frame: int) -> TrackKey:
        """A key for a target that is asked for in a frame."""
        places = (key.place for key in self._ids if key.frame == frame)
        # Not by their number: one that was taken over has left its place.
        return TrackKey(frame, min(0, min(places, default=0)) - 1)

    def transfer_id(self, before: Sequence[TrackKey], now: TrackKey) -> None:
        """Let a target be called as the first of some that it takes over, which are no more."""
        names = [name for key in before if (name := self._ids.pop(key, None)) is not None]
        if names:
            self._ids[now] = names[0]

    def inherit_ids(self, reported: Mapping[int, Track], track_set: TrackSet) -> None:
        """Let targets that took the places of others, when those were worked out again, be them.

        Args:
            reported: Id to target, as told before.
            track_set: As worked out again.
        """
        there = {track.key for track in (*track_set.tracks, *track_set.ended_tracks)}
        lost = [(name, track) for name, track in reported.items() if track.key not in there]
        for track in track_set.tracks:
            if not lost or not track.is_reported or track.key in self._ids:
                continue
            same = pairwise_iou(track.box[None], np.array([one.box for _, one in lost]))[0]
            best = int(same.argmax())
            if same[best] > SAME_ABOVE:
                name, before = lost.pop(best)
                # Worked out once more, that one may be back, as another one.
                del self._ids[before.key]
                self._ids[track.key] = name

    def prune(self, track_set: TrackSet, oldest: int) -> None:
        """Forget those that no frame can bring back.

        Args:
            track_set: All targets that there are.
            oldest: Number of the oldest frame that may be worked out again.
        """
        if len(self._ids) > _MOST_NAMES:
            there = {track.key for track in (*track_set.tracks, *track_set.ended_tracks)}
            self._ids = {
                key: name for key, name in self._ids.items() if key in there or key.frame >= oldest
            }
