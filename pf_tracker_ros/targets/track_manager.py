"""Tracks any number of targets through the frames of one camera.

1. The image front end prepares the frame: gain control, light, camera motion, background.
2. Late detections are put where they belong, and the frames since are processed again.
3. The targets are followed into the frame, with the detections of it.
4. Those that are sure enough are told, under ids that are never used again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import ParameterError, flatten
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.detections import Detection, Detections, describe_detections, usable
from pf_tracker_ros.targets.frame_buffer import FrameBuffer, HistoryEntry, thinned
from pf_tracker_ros.targets.lifecycle import is_same_object
from pf_tracker_ros.targets.out_of_sequence import (
    StampedDetections,
    insert_late,
    merge_detections,
    replay_track,
    reprocess,
)
from pf_tracker_ros.targets.pipeline import TrackingPipeline
from pf_tracker_ros.targets.relearning import (
    LastSeen,
    needs_relearning,
    reconfigured,
    relearned,
    resized,
)
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.targets.tracks import Track, TrackIds, TrackKey, TrackSet
from pf_tracker_ros.tracking.image_front_end import ImageFrontEnd
from pf_tracker_ros.tracking.input_checks import check_box, check_seed
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.scaling import scaled_box, scaled_to
from pf_tracker_ros.tracking.target_filter import TargetFilter

NOMINAL_INTERVAL = 0.04
"""Seconds from one frame to the next where nobody tells."""

# A target's frame may have been lost on the way; one so much later stands in for it.
_SUBSTITUTE_WITHIN = NANOSECONDS
# Through so many frames a target is followed to catch up: in the meantime no image is answered.
_MOST_CAUGHT_UP = 30


class FrameNotBufferedError(ValueError):
    """The frame that a target was drawn on is not kept any more."""


class StartedTarget(NamedTuple):
    """A target that somebody asked for.

    Attributes:
        id: Its own, never that of another object.
        caught_up: Frames since the one that it was drawn on, which it was followed through.
    """

    id: int
    caught_up: int = 0


class TrackManager:
    """Follows the targets of one camera, none to `max_targets`, and knows their ids.

    Where only one target may be, a new one takes the place of the one before, and everything begins
    with it: gain control, light, background and the source of randomness. It so depends on nothing
    that came before.

    It can be copied and pickled, with its targets but without the frames for late detections.

    Attributes:
        rejected_detections: Why detections of the last update were no use.

    Args:
        parameters: Every tunable.
        seed: Seeds all randomness.

    Raises:
        ParameterError: The parameters contradict each other.
        ValueError: The seed is no whole number from 0.
    """

    def __init__(self, parameters: TrackerParameters, seed: int = 0) -> None:
        self._parameters = parameters
        self._seed = check_seed(seed)
        with default_numpy_errors():
            self._target_filter = TargetFilter(parameters)
        self._pipeline = TrackingPipeline(self._target_filter, parameters, self._seed)
        self._front_end = self._new_front_end()
        self._track_set = TrackSet()
        self.frames = FrameBuffer()
        self._track_ids = TrackIds()
        self._last_seen: dict[TrackKey, LastSeen] = {}
        self.rejected_detections: tuple[str, ...] = ()

    def __getstate__(self) -> dict[str, Any]:
        # Images would only make a copy large.
        return self.__dict__ | {"frames": self.frames.empty_copy(), "_last_seen": {}}

    @property
    def parameters(self) -> dict[str, Any]:
        """Full parameter name to the value in force."""
        return flatten(self._parameters)

    @property
    def seed(self) -> int:
        """As given."""
        return self._seed

    @property
    def max_targets(self) -> int:
        """As the parameter says."""
        return self._parameters.max_targets

    @property
    def last_frame(self) -> Frame | None:
        """The one that was given last; None before the first, and in a fresh copy."""
        return self._front_end.frame

    @property
    def targets(self) -> tuple[TrackedTarget, ...]:
        """The targets as the last frame left them, in the order of their ids."""
        reported = [
            TrackedTarget(
                self._track_ids[track.key],
                track.label,
                track.filter_state.estimate,
                track.age,
                track.unconfirmed_for,
            )
            for track in self._track_ids.reported(self._track_set.tracks).values()
        ]
        return tuple(sorted(reported, key=lambda target: target.id))

    def map_likelihood(self, id: int) -> LikelihoodMap | None:
        """How likely a target is around its box, in the frame that was given last.

        Nothing is tracked by it. None where there is no such target, or no frame as in a copy.
        """
        track, frame = (
            self._track_ids.reported(self._track_set.tracks).get(id),
            self._front_end.frame,
        )
        if track is None or frame is None:
            return None
        with default_numpy_errors():
            return self._target_filter.map_likelihood(track.filter_state, frame)

    # Parameters

    def check_parameters(self, other: TrackManager) -> None:
        """Try what `adopt_parameters` would do, and change nothing.

        Raises:
            ParameterError: As `adopt_parameters`.
        """
        with default_numpy_errors():
            self._adapted(other)

    def adopt_parameters(self, other: TrackManager) -> None:
        """Go on with the parameters and the seed of another manager, keeping the targets.

        What decides on how a target is described, such as the motion model, learns every target
        again from where it was last seen; frames before the change are then gone for late
        detections.

        Args:
            other: Whose parameters to take, and nothing else; what both only read is shared.

        Raises:
            ParameterError: A target was never seen that would have to be learned again.
        """
        with default_numpy_errors():
            track_set, entries = self._adapted(other)
        self.frames.replace_all(entries)
        if other._target_filter.needs_foreground != self._target_filter.needs_foreground:
            self._front_end.reset_background()
        self._track_set, self._seed = track_set, other._seed
        self._parameters, self._target_filter = other._parameters, other._target_filter
        self._pipeline = other._pipeline
        self._front_end.configure(multi_target=self.max_targets > 1)

    def _adapted(self, other: TrackManager) -> tuple[TrackSet, Sequence[HistoryEntry]]:
        """The targets, and the moments to be kept, for the parameters of another manager."""
        entries, target_filter = self.frames.entries, other._target_filter
        before = (one for entry in entries for one in entry.tracks_before.tracks)
        tracks = [*self._track_set.tracks, *self._track_set.ended_tracks, *before]
        if not needs_relearning(tracks, self.parameters, other.parameters):
            return reconfigured(self._track_set, target_filter), [
                replace(
                    entry,
                    tracks_before=reconfigured(entry.tracks_before, target_filter),
                    started=reconfigured(TrackSet(tracks=entry.started), target_filter).tracks,
                )
                for entry in entries
            ]
        is_same = other._parameters.appearance == self._parameters.appearance
        appearance = None if is_same else other._pipeline.appearance
        track_set, unseen = relearned(self._track_set, self._last_seen, target_filter, appearance)
        for track in unseen:
            if track.is_reported and track.key in self._track_ids:
                raise ParameterError(
                    f"the target {self._track_ids[track.key]} would have to be learned again, and no "
                    "frame that is still kept shows it; stop it first, or wait until it is seen"
                )
        return track_set, []

    # Frames

    def accepts_image(self, image: NDArray[np.generic]) -> bool:
        """Whether an image has the size and kind of those before; any does before the first."""
        return self._is_waiting or self._front_end.accepts_image(image)

    def image_mismatch(self, image: NDArray[np.generic]) -> str:
        """Why an image that does not fit is refused."""
        return (
            f"image is {image.shape} {image.dtype}, but the others were {self._front_end.image_format}; "
            "start again to change the image's size or kind"
        )

    def update(
        self,
        frame: Frame,
        interval: float | None = None,
        detections: Sequence[StampedDetections] = (),
    ) -> None:
        """Follow all targets into the next frame.

        Args:
            frame: Its image of the size and kind of those before; checked, and the manager's from
                now on.
            interval: Seconds since the last frame, from 0; None where nobody knows.
            detections: What detectors have said since then, of this frame or of earlier ones.

        Raises:
            ValueError: The image does not fit; the last good state is kept.
        """
        if not self.accepts_image(frame.image):
            raise ValueError(self.image_mismatch(frame.image))
        interval = NOMINAL_INTERVAL if interval is None else interval
        self.rejected_detections = ()
        if not detections and self._is_waiting:
            self._front_end = self._new_front_end(frame)
            self.frames.add(HistoryEntry(frame, interval, self._track_set))
            return
        if not self._front_end.accepts_image(frame.image):
            self.reset()
        with default_numpy_errors():
            reported = self._track_ids.reported(self._track_set.tracks)
            self._open(self._front_end, frame, interval, self._track_set.boxes)
            of_now = [one for one in detections if _is_of_now(one.stamp, frame.stamp, interval)]
            late = [one for one in detections if one not in of_now]
            entries, rejected_detections = insert_late(
                self.frames, late, frame.stamp, self._sightings
            )
            track_set, revised = (
                reprocess(self._pipeline, entries) if entries else (self._track_set, [])
            )
            seen: tuple[Detection, ...] | None = None
            for answer in of_now:
                found, reasons = self._sightings(answer.detections, frame)
                seen = merge_detections(seen, found)
                rejected_detections += reasons
            entry = HistoryEntry(frame, interval, track_set, seen)
            track_set = self._pipeline.advance(track_set, frame, interval, seen)
        self._front_end.commit(frame)
        self.frames.replace_from(revised)
        self.frames.add(entry)
        self.rejected_detections = tuple(dict.fromkeys(rejected_detections))
        if revised:
            self._track_ids.inherit_ids(reported, track_set)
        self._track_set, self._last_seen = (
            track_set,
            _sights_after(frame, track_set, self._last_seen),
        )
        for track in track_set.tracks:
            if track.is_reported:
                self._track_ids.assign_id(track)
        oldest = self.frames.first.tracks_before if len(self.frames) else track_set
        self._track_ids.prune(track_set, oldest.frame)

    @property
    def _is_waiting(self) -> bool:
        """Whether nothing depends on a frame: a single target, which is not there yet, is all."""
        return (
            self.max_targets == 1
            and not self._track_set.tracks
            and not self._track_set.has_detector
        )

    def _open(
        self, front_end: ImageFrontEnd, frame: Frame, interval: float, boxes: Sequence[Box]
    ) -> None:
        target_filter, follow_light = self._target_filter, self._parameters.follow_light
        front_end.prepare(frame, interval, boxes, target_filter.needs_foreground, follow_light)

    def _sightings(
        self, detections: Detections, frame: Frame
    ) -> tuple[tuple[Detection, ...] | None, list[str]]:
        detector = self._parameters.detector
        wanted = detections.with_labels(detector.labels)
        seen, reasons = describe_detections(
            wanted, frame, detector.score_above, self._pipeline.appearance
        )
        if seen or not len(wanted) or len(usable(wanted, frame.size, -np.inf)[0]):
            return tuple(seen), reasons
        # None of the boxes makes sense: that does not say that nothing is there.
        return None, reasons

    def _new_front_end(self, frame: Frame | None = None) -> ImageFrontEnd:
        several = self.max_targets > 1
        return ImageFrontEnd(self._seed, frame, removes_ghosts=several, estimates_motion=several)

    def resize(self, frame: Frame) -> bool:
        """Go on with images of another size, keeping the targets with their ids.

        They are learned again from where they were last seen, scaled; those that were never seen
        are forgotten, and so are the frames before.

        Args:
            frame: One of that size, to be given to `update` next.

        Returns:
            Whether it could be done: the image is of the same kind and aspect ratio, and no target
            in it is smaller than a pixel. If not, all is as before.
        """
        known = self._front_end.frame
        last = scaled_to(known.image, frame.image) if known else None
        if known is None or last is None:
            return False
        front_end, opened = self._new_front_end(), Frame(last, known.stamp)
        boxes = [scaled_box(box, known.size, opened.size) for box in self._track_set.boxes]
        if any(min(box[2:]) < 1.0 for box in boxes):
            return False
        with default_numpy_errors():
            self._open(front_end, opened, 0.0, boxes)
            track_set, last_seen = resized(
                self._track_set, self._last_seen, self._target_filter, known, opened
            )
        front_end.commit(opened)
        self._front_end, self._track_set, self._last_seen = front_end, track_set, last_seen
        self.frames.clear()
        return True

    def clear_history(self) -> None:
        """Let no detection be of the frames so far, as where time begins anew."""
        self.frames.clear()

    # Targets

    def check_capacity(self, count: int) -> None:
        """Refuse one more target where there are as many as there may be, or more.

        A single target makes room for the next one.

        Args:
            count: Targets that there are, or that are to begin before it.

        Raises:
            ValueError: There is no room for it.
        """
        most = self.max_targets
        if most == 1:
            return
        if count == most:
            raise ValueError(
                f"there are {counted(most, 'target')}, as many as there may be; stop one first, or "
                "allow more"
            )
        if count > most:
            raise ValueError(
                f"there are {count} targets, and there may be {most}; stop {count - most + 1} first"
            )

    def is_on_target(self, box: Box) -> bool:
        """Whether a box, pixels, is on a target as the last frame left it."""
        reported = self._track_ids.reported(self._track_set.tracks).values()
        return any(_is_shown_in(track, box) for track in reported)

    def start_on(self, frame: Frame, box: Box, label: str = "") -> StartedTarget:
        """Take a target on a frame with which all begins.

        Args:
            frame: The first one, or, for the only target that there may be, any one; checked, and
                the manager's from now on.
            box: (x, y, width, height) of the target, pixels; checked.
            label: What it is.
        """
        if self.max_targets == 1:
            with default_numpy_errors():
                return self._start_alone(frame, box, label, ())
        with default_numpy_errors():
            self._open(self._front_end, frame, 0.0, [box])
            self._front_end.commit(frame)
            self.frames.add(HistoryEntry(frame, 0.0, self._track_set))
            self._track_set = self._pipeline.advance(self._track_set, frame, 0.0, None)
            return self._start_beside(frame, box, label, self.frames.entries)

    def start(self, box: Box, stamp: int = 0, label: str = "") -> StartedTarget:
        """Take a new target by hand; no detector ends it.

        A box on a target that there is, and that is not lost, takes that one over, with its id.

        Args:
            box: (x, y, width, height) of the target, pixels.
            stamp: Of the frame that it was drawn on, nanoseconds; 0 for the last one.
            label: What it is.

        Raises:
            ValueError: The box is not usable, or there are as many targets as there may be; all are
                kept.
            FrameNotBufferedError: The frame is not kept any more.
        """
        entries = self._moments_from(stamp)
        frame = entries[0].frame if entries else self._front_end.frame
        if frame is None:
            raise ValueError("there is no frame so far, as in a fresh copy; give one first")
        first_box = check_box(box, frame.size)
        with default_numpy_errors():
            if self.max_targets == 1:
                return self._start_alone(frame, first_box, label, entries)
            return self._start_beside(frame, first_box, label, entries)

    def _moments_from(self, stamp: int) -> list[HistoryEntry]:
        """The moments from the one on that a target was drawn on; none where no frame is kept.

        Where they are too many, those in between are thinned out evenly.

        Raises:
            ValueError: They are not kept any more, or are of another size.
        """
        last = self._front_end.frame
        if last is None or stamp in (0, last.stamp) or last.stamp == 0:
            return self.frames.entries[-1:]
        entries = self.frames.since(stamp)
        first = entries[0].stamp if entries else last.stamp
        behind = first - stamp
        # What was dropped before time went back says nothing of the frames since.
        is_dropped = stamp <= self.frames.dropped_until <= last.stamp
        if behind > _SUBSTITUTE_WITHIN or is_dropped:
            raise FrameNotBufferedError(
                f"it was drawn on a frame from {behind / NANOSECONDS:.3f} s before the oldest one "
                f"here; allowed: one of the last {counted(max(len(entries), 1), 'frame')}, back to "
                f"{(last.stamp - first) / NANOSECONDS:.3f} s ago (parameters 'frame_buffer_length' and "
                "'frame_buffer_megabytes'), or stamp 0 for the next one"
            )
        return thinned(entries, _MOST_CAUGHT_UP)

    def _start_alone(
        self, frame: Frame, box: Box, label: str, entries: Sequence[HistoryEntry]
    ) -> StartedTarget:
        """Take the only target there may be; all begins anew with its frame."""
        front_end, pipeline = self._new_front_end(), self._pipeline
        self._open(front_end, frame, 0.0, [box])
        then = entries[1].tracks_before if len(entries) > 1 else self._track_set
        key = self._track_ids.next_manual_key(then.frame)
        generator_state = np.random.default_rng(np.random.SeedSequence(self._seed))
        track = pipeline.initiator.initiate_manual(frame, box, key, label, generator_state)
        track_set = replace(then, tracks=(track,), ended_tracks=())
        last_seen = {key: LastSeen(frame, box)}
        earlier = [
            one.without_targets()
            for one in self.frames.entries
            if entries and one.stamp < entries[0].stamp
        ]
        revised = [HistoryEntry(frame, 0.0, replace(track_set, tracks=()), started=(track,))]
        for entry in entries[1:]:
            front_end.commit(frame)
            frame = entry.frame
            self._open(front_end, frame, entry.interval, track_set.boxes)
            revised.append(HistoryEntry(frame, entry.interval, track_set, entry.detections))
            track_set = pipeline.advance(track_set, frame, entry.interval, entry.detections)
            last_seen = _sights_after(frame, track_set, last_seen)
        front_end.commit(frame)
        self._front_end, self._track_set, self._last_seen = front_end, track_set, last_seen
        self.frames.replace_all([*earlier, *revised] if frame.stamp else ())
        return StartedTarget(self._track_ids.assign_id(track), len(revised) - 1)

    def _start_beside(
        self, frame: Frame, box: Box, label: str, entries: Sequence[HistoryEntry]
    ) -> StartedTarget:
        """Take one more target."""
        then = entries[1].tracks_before if len(entries) > 1 else self._track_set
        same = [one for one in then.tracks if _is_shown_in(one, box)]
        if not any(one.key in self._track_ids for one in same):
            self.check_capacity(len(self.targets))
        key = self._track_ids.next_manual_key(then.frame)
        track = self._pipeline.initiator.initiate_manual(frame, box, key, label)
        if same and not label:
            track = replace(track, votes=same[0].votes)
        revised: list[HistoryEntry] = []
        if entries:
            track, revised = replay_track(self._pipeline, track, entries, same)
        keys = [one.key for one in same]
        others = [one for one in self._track_set.tracks if one.key not in keys]
        # What a detector has started since, where the target is by now, is the target.
        keys += [one.key for one in others if not one.is_manual and _are_the_same(one, track)]
        others = [one for one in others if one.key not in keys]
        surplus = self._pipeline.initiator.surplus_keys([*others, track])
        others = [one for one in others if one.key not in surplus]
        self.frames.replace_from([one.without([*keys, *surplus]) for one in revised])
        self._track_set = replace(self._track_set, tracks=(*others, track))
        last_seen = {**self._last_seen, key: LastSeen(frame, box)}
        self._last_seen = _sights_after(self._front_end.frame or frame, self._track_set, last_seen)
        self._track_ids.transfer_id(keys, track.key)
        return StartedTarget(self._track_ids.assign_id(track), max(len(entries) - 1, 0))

    def stop(self, id: int) -> None:
        """Forget a target; a detector that still sees it will start it again, with another id.

        Raises:
            ValueError: There is no such target; the message lists those there are.
        """
        track = self.get_track(id)
        self._track_set = self._track_set.without(track)
        if len(self.frames):
            last = self.frames.last
            self.frames.replace_from([replace(last, stopped=(*last.stopped, track))])

    def get_track(self, id: int) -> Track:
        """The target of an id, be it that it has ended and is remembered.

        Raises:
            ValueError: There is no such target; the message lists those there are.
        """
        tracks = {
            self._track_ids.get(track.key): track
            for track in (*self._track_set.tracks, *self._track_set.ended_tracks)
        }
        is_number = isinstance(id, int | np.integer) and not isinstance(id, bool)
        track = tracks.get(id) if is_number else None
        if track is None:
            known = ", ".join(str(target.id) for target in self.targets) or "none"
            raise ValueError(f"no target has the id {id!r}; there are: {known}")
        return track

    def clear(self) -> None:
        """Forget all targets, those that have ended too; what the detector sees, it starts again.

        Their ids are not used again. The frames stay, for a target that was drawn on one of them.
        """
        self._track_set = replace(self._track_set, tracks=(), ended_tracks=())
        self._last_seen = {}
        self.frames.replace_all([one.without_targets() for one in self.frames.entries])

    def reset(self) -> None:
        """Forget all targets, and take images of any size and kind."""
        self.clear()
        self.frames.clear()
        self._front_end = self._new_front_end()


def default_numpy_errors() -> np.errstate:
    """NumPy's own error handling, whatever the program around it has set.

    Likelihoods far from the target vanish, which `numpy.seterr(all="raise")` would make an error.
    """
    return np.errstate(divide="warn", over="warn", under="ignore", invalid="warn")


def _sights_after(
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


def _is_of_now(stamp: int, now: int, interval: float) -> bool:
    """Whether a detection is of the frame at hand: up to half an interval before it."""
    return 0 in (stamp, now) or (now - stamp) / NANOSECONDS <= interval / 2


def _is_shown_in(track: Track, box: Box) -> bool:
    """Whether a box is on a target; where a lost one is, nobody knows."""
    return track.filter_state.estimate.state != "lost" and is_same_object(track, np.array(box))


def _are_the_same(one: Track, other: Track) -> bool:
    return other.filter_state.estimate.state != "lost" and _is_shown_in(
        one, other.filter_state.estimate.box
    )
