"""The multi-target tracker of one camera.

1. The image front end prepares the frame: gain control, illumination, camera motion, background.
2. Late detections are inserted at their own frames, and the frames since are reprocessed.
3. The tracking pipeline advances all tracks by this frame, with its detections.
4. Tracks with enough evidence are reported, under ids that are not reused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, is_on_any
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import ParameterError, flatten
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.detections import (
    Detection,
    Detections,
    StampedDetections,
    describe_detections,
    usable,
)
from pf_tracker_ros.targets.frame_buffer import FrameBuffer, HistoryEntry, thinned
from pf_tracker_ros.targets.out_of_sequence import (
    insert_late,
    is_current,
    replay_track,
    reprocess,
)
from pf_tracker_ros.targets.pipeline import TrackingPipeline
from pf_tracker_ros.targets.relearning import (
    needs_relearning,
    reconfigured,
    reconfigured_entry,
    relearned,
    resized,
)
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.targets.tracks import (
    LastSeen,
    Track,
    TrackIds,
    TrackKey,
    TrackSet,
    last_seen_after,
)
from pf_tracker_ros.tracking.frame_clock import NOMINAL_INTERVAL
from pf_tracker_ros.tracking.hints import Hint
from pf_tracker_ros.tracking.image_front_end import ImageFrontEnd
from pf_tracker_ros.tracking.input_checks import check_box, check_seed
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.scaling import scaled_box, scaled_to
from pf_tracker_ros.tracking.target_filter import TargetFilter, default_numpy_errors
from pf_tracker_ros.values import replace

# The frame of a manual target may have been lost; one at most this much later replaces it.
_SUBSTITUTE_WITHIN = NANOSECONDS
# Most frames that a manual target is replayed through, since no image is processed meanwhile.
_MAX_CAUGHT_UP = 30


class FrameNotBufferedError(ValueError):
    """The frame of a manual target has left the frame buffer."""


class StartedTarget(NamedTuple):
    """A manual target that has started: its id, and the number of frames since its own."""

    id: int
    caught_up: int = 0


class TrackManager:
    """Tracks up to `max_targets` targets of one camera and assigns their ids.

    With `max_targets` 1 a new target replaces the former one. It also resets gain control,
    illumination, background and random generator, so its estimates depend on no earlier frame.

    A copy or pickle has the targets but no buffered frames.

    Attributes:
        frames: The frames that manual targets and late detections may refer to.
        rejected_detections: Why detections of the last update were rejected.

    Raises:
        ParameterError: The parameters contradict each other.
        ValueError: The seed is no integer from 0.
    """

    def __init__(self, parameters: TrackerParameters, seed: int = 0) -> None:
        self._parameters = parameters
        self.seed = check_seed(seed)
        with default_numpy_errors():
            self._target_filter = TargetFilter(parameters)
        self._pipeline = TrackingPipeline(self._target_filter, parameters, self.seed)
        self._front_end = self._new_front_end()
        self._track_set = TrackSet()
        self.frames = FrameBuffer()
        self._track_ids = TrackIds()
        self._last_seen: dict[TrackKey, LastSeen] = {}
        # A track set and the targets that are reported of it.
        self._reported: tuple[TrackSet | None, tuple[TrackedTarget, ...]] = None, ()
        self.rejected_detections: tuple[str, ...] = ()

    def __getstate__(self) -> dict[str, Any]:
        # Images would only make a copy large.
        return self.__dict__ | {
            "frames": self.frames.empty_copy(),
            "_last_seen": {},
            "_reported": (None, ()),
        }

    @property
    def parameters(self) -> dict[str, Any]:
        """Full parameter name to the value in force."""
        return flatten(self._parameters)

    @property
    def max_targets(self) -> int:
        """The parameter of this name."""
        return self._parameters.max_targets

    @property
    def last_frame(self) -> Frame | None:
        """None before the first frame, and in a new copy."""
        return self._front_end.frame

    @property
    def targets(self) -> tuple[TrackedTarget, ...]:
        """The reported targets after the last frame, sorted by id."""
        track_set, targets = self._reported
        if track_set is not self._track_set:
            tracks = self._track_ids.reported(self._track_set.tracks)
            targets = tuple(
                TrackedTarget(
                    id,
                    track.label,
                    track.filter_state.estimate,
                    track.age,
                    track.unconfirmed_for,
                )
                for id, track in sorted(tracks.items())
            )
            self._reported = self._track_set, targets
        return targets

    def map_likelihood(self, id: int) -> LikelihoodMap | None:
        """The likelihood around a target's box in the last frame; tracking is unaffected.

        None if there is no such target, or no frame, as in a new copy.
        """
        track = self._track_ids.reported(self._track_set.tracks).get(id)
        frame = self._front_end.frame
        if track is None or frame is None:
            return None
        with default_numpy_errors():
            return self._target_filter.map_likelihood(track.filter_state, frame)

    # Parameters

    def check_parameters(self, other: TrackManager) -> None:
        """Check whether `adopt_parameters` would succeed; nothing changes.

        Raises:
            ParameterError: As for `adopt_parameters`.
        """
        with default_numpy_errors():
            self._adapted(other)

    def adopt_parameters(self, other: TrackManager) -> None:
        """Adopt the parameters and the seed of another manager, and keep the targets.

        Some changes, such as another motion model, relearn every target where it was last seen.
        They also clear the frame buffer, so late detections of earlier frames are rejected.

        Raises:
            ParameterError: A target has to be relearned, and no stored frame shows it.
        """
        with default_numpy_errors():
            track_set, entries = self._adapted(other)
        self.frames.replace_all(entries)
        self._track_set, self.seed = track_set, other.seed
        self._parameters, self._target_filter = other._parameters, other._target_filter
        self._pipeline = other._pipeline
        self._front_end.configure(
            multi_target=self.max_targets > 1,
            needs_foreground=self._target_filter.needs_foreground,
            follow_light=self._parameters.follow_light,
        )

    def _adapted(self, other: TrackManager) -> tuple[TrackSet, Sequence[HistoryEntry]]:
        """The tracks, and the history to keep, for the parameters of another manager."""
        entries, target_filter = self.frames.entries, other._target_filter
        if not needs_relearning(self._track_set, entries, self.parameters, other.parameters):
            return reconfigured(self._track_set, target_filter), [
                reconfigured_entry(entry, target_filter) for entry in entries
            ]
        is_same = other._parameters.appearance == self._parameters.appearance
        appearance = None if is_same else other._pipeline.appearance
        track_set, unseen = relearned(self._track_set, self._last_seen, target_filter, appearance)
        for track in unseen:
            if track.is_reported and track.key in self._track_ids:
                raise ParameterError(
                    f"target {self._track_ids[track.key]} must be relearned, but no stored frame "
                    "shows it; stop it first, or wait until it is seen"
                )
        return track_set, []

    # Frames

    def accepts_image(self, image: NDArray[np.generic]) -> bool:
        """Whether an image has the size and type of the earlier ones; true before the first."""
        return self._is_waiting or self._front_end.accepts_image(image)

    def image_mismatch(self, image: NDArray[np.generic]) -> str:
        """The error message for an image of another size or type."""
        return (
            f"image is {image.shape} {image.dtype}, but the others were "
            f"{self._front_end.image_format}; start again to change their type or aspect ratio"
        )

    def update(
        self,
        frame: Frame,
        interval: float | None = None,
        detections: Sequence[StampedDetections] = (),
        hints: Mapping[int, Hint] | None = None,
        *,
        selected: int = 0,
    ) -> None:
        """Advance all targets by one frame.

        Args:
            frame: Of the type and aspect ratio of the earlier ones, with a checked image; the
                manager keeps it. Of another size, it rescales the targets, see `resize`.
            interval: Seconds since the last frame, from 0; None if unknown.
            detections: Received since the last frame; of this frame or of earlier ones.
            hints: Id of a target to what is known of it in the last frame. A covered share lowers
                the confidence of this one; a target out of sight is looked for where it is
                expected.
            selected: Id of the target that stays for `track.keep_selected` while nothing shows
                it, 0 for none.

        Raises:
            ValueError: The image has another type or aspect ratio; the state is unchanged.
        """
        if not (self.accepts_image(frame.image) or self.resize(frame)):
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
            before = self._track_set
            self._front_end.prepare(frame, interval, before.boxes, is_tracked=before.is_tracked)
            current = [
                one
                for one in detections
                if is_current(one.stamp, frame.stamp, interval, self.frames)
            ]
            late = [one for one in detections if one not in current]
            entries, rejected = insert_late(self.frames, late, frame.stamp, self._describe)
            kept = reported[selected].key if selected in reported else None
            track_set, revised = before.with_selected(kept), entries
            if entries:
                before = entries[0].tracks_before.with_selected(kept)
                entries[0] = replace(entries[0], tracks_before=before)
                track_set, revised = reprocess(self._pipeline, entries)
            if hints:
                keys = {id: track.key for id, track in reported.items()}
                known = {keys[id]: hint for id, hint in hints.items() if id in keys}
                track_set = self._pipeline.take_hints(track_set, known, frame.size)
            entry = HistoryEntry(frame, interval, track_set)
            for batch in current:
                described, reasons = self._describe(batch.detections, frame)
                is_stamped = 0 not in (batch.stamp, frame.stamp)
                offset = abs(frame.stamp - batch.stamp) if is_stamped else 0
                entry = entry.with_detections(described, offset)
                rejected += reasons
            track_set = self._pipeline.advance(track_set, frame, interval, entry.detections)
        self._front_end.commit(frame)
        self.frames.replace_from(revised)
        self.frames.add(entry)
        self.rejected_detections = tuple(dict.fromkeys(rejected))
        if revised:
            self._track_ids.inherit_ids(reported, track_set)
        self._track_set = track_set
        self._last_seen = last_seen_after(frame, track_set, self._last_seen)
        for track in track_set.tracks:
            if track.is_reported:
                self._track_ids.assign_id(track)
        oldest = self.frames.first.tracks_before if len(self.frames) else track_set
        self._track_ids.prune(track_set, oldest.frame)

    @property
    def _is_waiting(self) -> bool:
        """Whether frames have no effect: single target, not started, and no detector."""
        return (
            self.max_targets == 1
            and not self._track_set.tracks
            and not self._track_set.has_detector
        )

    def _describe(
        self, detections: Detections, frame: Frame
    ) -> tuple[tuple[Detection, ...] | None, list[str]]:
        """The valid detections with their descriptors, and why others are rejected."""
        detector = self._parameters.detector
        wanted = detections.with_labels(detector.labels)
        described, reasons = describe_detections(
            wanted, frame, detector.score_above, self._pipeline.appearance
        )
        if described or not len(wanted) or len(usable(wanted, frame.size, -np.inf)[0]):
            return tuple(described), reasons
        # Without any valid box, nothing is known; the image may well show targets.
        return None, reasons

    def _new_front_end(self, frame: Frame | None = None) -> ImageFrontEnd:
        several = self.max_targets > 1
        return ImageFrontEnd(
            self.seed,
            frame,
            needs_foreground=self._target_filter.needs_foreground,
            follow_light=self._parameters.follow_light,
            removes_ghosts=several,
            estimates_motion=several,
        )

    def resize(self, frame: Frame) -> bool:
        """Continue with images of another size, before its first frame is passed to `update`.

        Targets keep their ids and are relearned where they were last seen, scaled; those never seen
        are dropped. The frame buffer is cleared.

        Returns:
            Whether it was possible: same type and aspect ratio, and no target becomes smaller than
            a pixel. Otherwise nothing changes.
        """
        last = self._front_end.frame
        image = scaled_to(last.image, frame.image) if last else None
        if last is None or image is None:
            return False
        front_end, scaled = self._new_front_end(), Frame(image, last.stamp)
        boxes = [scaled_box(box, last.size, scaled.size) for box in self._track_set.boxes]
        if any(min(box[2:]) < 1.0 for box in boxes):
            return False
        with default_numpy_errors():
            front_end.prepare(scaled, 0.0, boxes)
            track_set, last_seen = resized(
                self._track_set, self._last_seen, self._target_filter, last, scaled
            )
        front_end.commit(scaled)
        self._front_end, self._track_set, self._last_seen = front_end, track_set, last_seen
        self.frames.clear()
        return True

    # Targets

    def check_capacity(self, count: int) -> None:
        """Check that a target may start beside so many; a single target is replaced instead.

        Raises:
            ValueError: There are `max_targets` or more.
        """
        most = self.max_targets
        if most == 1:
            return
        if count == most:
            raise ValueError(
                f"there are {counted(most, 'target')}, the maximum (parameter 'max_targets'); stop "
                "one first, or raise the maximum"
            )
        if count > most:
            raise ValueError(
                f"there are {count} targets, but 'max_targets' is {most}; stop {count - most + 1} "
                "first"
            )

    def is_on_target(self, box: Box) -> bool:
        """Whether a box, pixels, is on a reported target of the last frame."""
        reported = self._track_ids.reported(self._track_set.tracks).values()
        return any(_is_on(track, box) for track in reported)

    def start_on(self, frame: Frame, box: Box, label: str = "") -> StartedTarget:
        """Start a target on a frame that has not been passed to `update`; the manager keeps it.

        With several targets it is the first frame. Frame and box are checked.
        """
        with default_numpy_errors():
            if self.max_targets == 1:
                return self._start_single(frame, box, label, ())
            self._front_end.prepare(frame, 0.0, [box])
            self._front_end.commit(frame)
            self.frames.add(HistoryEntry(frame, 0.0, self._track_set))
            self._track_set = self._pipeline.advance(self._track_set, frame, 0.0, None)
            return self._start_additional(frame, box, label, self.frames.entries)

    def start(self, box: Box, stamp: int = 0, label: str = "") -> StartedTarget:
        """Start a manual target on the frame of a stamp, 0 for the last one; no detector ends it.

        A box on an existing target that is not lost replaces that target and keeps its id.

        Raises:
            ValueError: The box is invalid, or there are `max_targets` targets; nothing changes.
            FrameNotBufferedError: The frame has left the buffer.
        """
        entries = self._entries_from(stamp)
        frame = entries[0].frame if entries else self._front_end.frame
        if frame is None:
            raise ValueError("there is no frame yet, as in a new copy; pass one to update first")
        first_box = check_box(box, frame.size)
        with default_numpy_errors():
            if self.max_targets == 1:
                return self._start_single(frame, first_box, label, entries)
            return self._start_additional(frame, first_box, label, entries)

    def _entries_from(self, stamp: int) -> list[HistoryEntry]:
        """The history from the frame of a manual target on; empty if no frame is buffered.

        Thinned out evenly to at most `_MAX_CAUGHT_UP` frames after the first.

        Raises:
            FrameNotBufferedError: The frame has left the buffer, or has another size.
        """
        last = self._front_end.frame
        if last is None or stamp in (0, last.stamp) or last.stamp == 0:
            return self.frames.entries[-1:]
        entries = self.frames.since(stamp)
        first = entries[0].stamp if entries else last.stamp
        behind = first - stamp
        # After a jump back, `dropped_until` belongs to the former time.
        is_dropped = stamp <= self.frames.dropped_until <= last.stamp
        if behind > _SUBSTITUTE_WITHIN or is_dropped:
            raise FrameNotBufferedError(
                f"its frame is {behind / NANOSECONDS:.3f} s older than the oldest one in the "
                f"buffer; allowed: the last {counted(max(len(entries), 1), 'frame')}, back to "
                f"{(last.stamp - first) / NANOSECONDS:.3f} s ago (parameters "
                "'frame_buffer_length' and 'frame_buffer_megabytes'), or stamp 0 for the next frame"
            )
        return thinned(entries, _MAX_CAUGHT_UP)

    def _start_single(
        self, frame: Frame, box: Box, label: str, entries: Sequence[HistoryEntry]
    ) -> StartedTarget:
        """Start the single target; front end and random generator restart with its frame."""
        front_end, pipeline = self._new_front_end(), self._pipeline
        front_end.prepare(frame, 0.0, [box])
        at_start = entries[1].tracks_before if len(entries) > 1 else self._track_set
        key = self._track_ids.next_manual_key(at_start.frame)
        generator = np.random.default_rng(np.random.SeedSequence(self.seed))
        track = pipeline.initiator.initiate_manual(frame, box, key, label, generator)
        track_set = replace(at_start, tracks=(track,), ended_tracks=())
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
            front_end.prepare(
                frame, entry.interval, track_set.boxes, is_tracked=track_set.is_tracked
            )
            revised.append(HistoryEntry(frame, entry.interval, track_set, entry.detections))
            track_set = pipeline.advance(track_set, frame, entry.interval, entry.detections)
            last_seen = last_seen_after(frame, track_set, last_seen)
        front_end.commit(frame)
        self._front_end, self._track_set, self._last_seen = front_end, track_set, last_seen
        self.frames.replace_all([*earlier, *revised] if frame.stamp else ())
        return StartedTarget(self._track_ids.assign_id(track), len(revised) - 1)

    def _start_additional(
        self, frame: Frame, box: Box, label: str, entries: Sequence[HistoryEntry]
    ) -> StartedTarget:
        """Start a target beside the others, or in place of those that its box is on."""
        at_start = entries[1].tracks_before if len(entries) > 1 else self._track_set
        replaced = [one for one in at_start.tracks if _is_on(one, box)]
        if not any(one.key in self._track_ids for one in replaced):
            self.check_capacity(len(self.targets))
        key = self._track_ids.next_manual_key(at_start.frame)
        track = self._pipeline.initiator.initiate_manual(frame, box, key, label)
        if replaced and not label:
            track = replace(track, votes=replaced[0].votes)
        revised: list[HistoryEntry] = []
        if entries:
            track, revised = replay_track(self._pipeline, track, entries, replaced)
        keys = [one.key for one in replaced]
        others = [one for one in self._track_set.tracks if one.key not in keys]
        # A track that a detector has since started on this target is replaced too.
        keys += [one.key for one in others if not one.is_manual and _are_same(one, track)]
        others = [one for one in others if one.key not in keys]
        surplus = self._pipeline.initiator.surplus_keys([*others, track])
        others = [one for one in others if one.key not in surplus]
        self.frames.replace_from([one.without([*keys, *surplus]) for one in revised])
        self._track_set = replace(self._track_set, tracks=(*others, track))
        last_seen = {**self._last_seen, key: LastSeen(frame, box)}
        self._last_seen = last_seen_after(
            self._front_end.frame or frame, self._track_set, last_seen
        )
        self._track_ids.transfer_id(keys, track.key)
        return StartedTarget(self._track_ids.assign_id(track), max(len(entries) - 1, 0))

    def stop(self, id: int) -> None:
        """Remove a target; a detector that still finds it starts it with a new id.

        Raises:
            ValueError: No target has this id; the message lists the ids.
        """
        track = self.get_track(id)
        self._track_set = self._track_set.without(track)
        if len(self.frames):
            last = self.frames.last
            self.frames.replace_from([replace(last, stopped=(*last.stopped, track))])

    def get_track(self, id: int) -> Track:
        """The track of an id; also an ended one that is kept for re-identification.

        Raises:
            ValueError: No target has this id; the message lists the ids.
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
        """Remove all targets, ended ones too; their ids are not reused, see `restart_ids`.

        The frames stay in the buffer, so that a target drawn on one of them can still start.
        """
        self._track_set = replace(self._track_set, tracks=(), ended_tracks=())
        self._last_seen = {}
        self.frames.replace_all([one.without_targets() for one in self.frames.entries])

    def restart_ids(self) -> None:
        """Count ids from 1 again, as for a recording that was rewound after `clear`."""
        self._track_ids = TrackIds()

    def reset(self) -> None:
        """Remove all targets and frames, and accept images of any size and type."""
        self.clear()
        self.frames.clear()
        self._front_end = self._new_front_end()


def _is_on(track: Track, box: Box) -> bool:
    """Whether a box is on a target; false for a lost target, whose place is unknown."""
    return track.filter_state.estimate.state != "lost" and is_on_any(np.array(box), track.box[None])


def _are_same(one: Track, other: Track) -> bool:
    estimate = other.filter_state.estimate
    return estimate.state != "lost" and _is_on(one, estimate.box)
