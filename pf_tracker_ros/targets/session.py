"""A tracking session: stamped frames, detections, manual targets and changes of parameters.

For each frame:

1. Its stamp decides whether it is the next one, a duplicate, late, or the first after a jump. If
   its image has not changed for too long, it is frozen.
2. If the image size has changed, targets are scaled. Images of another camera reset the tracker.
3. The track manager advances by this frame, with the detections that are due.
4. Manual targets that were drawn on this frame or an earlier one start.

Independent of ROS. Stamps are in nanoseconds; 0 means unknown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.frames import Frame, check_image
from pf_tracker_ros.parameters import build
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.association import require_scipy
from pf_tracker_ros.targets.detections import Detections
from pf_tracker_ros.targets.frame_buffer import FrameBuffer
from pf_tracker_ros.targets.requests import (
    DetectionQueue,
    ImageFormatGuard,
    ManualTarget,
    ended_message,
)
from pf_tracker_ros.targets.track_manager import FrameNotBufferedError, StartedTarget, TrackManager
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tracking.frame_clock import FrameClock, FrozenImages, TimePolicy, is_due
from pf_tracker_ros.tracking.hints import Hint
from pf_tracker_ros.tracking.input_checks import check_box, check_hint
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap
from pf_tracker_ros.tracking.parameters import TrackerParameters

FrameOutcome = Literal["started", "tracked", "duplicate", "late", "frozen", "waiting"]
Arrival = Literal["next", "jump", "again", "duplicate", "late"]
DROPPED_ARRIVALS = ("duplicate", "late")
"""Arrivals of frames that are dropped without their image."""

# Largest age of a hint, nanoseconds: people who cross are in front for about so long.
_HINTED_WITHIN = NANOSECONDS // 2

_DRAWN_BEFORE_JUMP = (
    "target refused: it was drawn on a frame from before time went back; draw it again"
)


@dataclass(frozen=True)
class Outcome:
    """The result of one frame.

    Attributes:
        frame: "started" if a manual target has started, else "tracked", or "waiting" without
            targets; "duplicate", "late" or "frozen" if the frame was dropped.
        targets: The reported targets, sorted by id; of the last frame if this one was dropped.
        selected: Id of the selected target, see `Session.select`; 0 for none.
        started: Ids of the manual targets that have started.
        refused: Why other manual targets did not start.
        ended: Which targets ended because the image format changed.
        rejected_detections: Why detections were rejected.
        jumped_back: Seconds by which time went back with this frame, 0 if it did not.
        caught_up: Most frames that a manual target was tracked through to reach this one.
    """

    frame: FrameOutcome
    targets: tuple[TrackedTarget, ...] = ()
    selected: int = 0
    started: tuple[int, ...] = ()
    refused: tuple[str, ...] = ()
    ended: tuple[str, ...] = ()
    rejected_detections: tuple[str, ...] = ()
    jumped_back: float = 0.0
    caught_up: int = 0

    @property
    def estimate(self) -> Estimate | None:
        """Of the selected target; None without one."""
        return estimate_of(self.targets, self.selected)


def estimate_of(targets: Sequence[TrackedTarget], id: int) -> Estimate | None:
    """The estimate of a target; None if there is no such target."""
    return next((target.estimate for target in targets if target.id == id), None)


class Session:
    """Feeds stamped frames, manual targets and detections to a `TrackManager`.

    The parameters are by full name, the seed is that of `Tracker`. If the images change their size
    but not their aspect ratio, targets are relearned where they were last seen, scaled.

    Attributes:
        time_policy: What to do when time jumps back; "restart" restarts the manual targets only.
            May be replaced at any time.
        frozen_after: Seconds of images that are equal to the bit after which the next ones are
            dropped as frozen, 0 for never. May be changed at any time.
        detector_runs: Number of detector results received.

    Raises:
        ParameterError: A parameter is not allowed, or they contradict each other.
    """

    def __init__(self, parameters: Mapping[str, Any], seed: int) -> None:
        self.time_policy = TimePolicy()
        self.frozen_after = 0.0
        self.detector_runs = 0
        self._manager = TrackManager(build(TrackerParameters, parameters), seed)
        self._checked: tuple[Mapping[str, Any], int, TrackManager] | None = None
        self._clock = FrameClock()
        self._detection_queue = DetectionQueue()
        self._format_guard = ImageFormatGuard()
        self._frozen_images = FrozenImages()
        self._selected = 0
        # Stamp of a frame, and id to hint.
        self._hints: tuple[int, Mapping[int, Hint]] = (0, {})
        self._requested: list[ManualTarget] = []
        # Those that have started, by id.
        self._manual: dict[int, ManualTarget] = {}
        # Messages for the next outcome; a frame that raises has none.
        self._refused: list[str] = []
        self._ended: list[str] = []

    @property
    def targets(self) -> tuple[TrackedTarget, ...]:
        """The reported targets after the last processed frame, sorted by id."""
        return self._manager.targets

    @property
    def selected(self) -> int:
        """Id of the selected target, with `max_targets` 1 of the only one; 0 for none."""
        targets = self.targets
        if self._manager.max_targets == len(targets) == 1:
            return targets[0].id
        return self._selected

    @property
    def estimate(self) -> Estimate | None:
        """Of the selected target after the last processed frame; None without one."""
        return estimate_of(self.targets, self.selected)

    @property
    def frame_buffer(self) -> FrameBuffer:
        """The frames that manual targets and late detections may refer to."""
        return self._manager.frames

    @property
    def requested_stamp(self) -> int | None:
        """Earliest stamp of the manual targets that have not started, None without any."""
        return min((one.stamp for one in self._requested), default=None)

    # Parameters

    def check(self, parameters: Mapping[str, Any], seed: int) -> None:
        """Check whether `configure` would succeed; nothing visible changes.

        Raises:
            ValueError: As for `configure`.
        """
        other = TrackManager(build(TrackerParameters, parameters), seed)
        self._manager.check_parameters(other)
        self._checked = (parameters, seed, other)

    def configure(self, parameters: Mapping[str, Any], seed: int) -> None:
        """Change parameters, all or none, and keep the targets; a new seed affects new targets.

        Some changes, such as another motion model, relearn every target where it was last seen.
        An occluded or lost target stays so until a frame shows it. A single target stays selected
        when `max_targets` rises.

        Raises:
            ValueError: A parameter is not allowed, or they contradict each other.
        """
        checked, self._checked = self._checked, None
        if (dict(parameters), seed) == (self._manager.parameters, self._manager.seed):
            return
        if checked and checked[:2] == (parameters, seed):
            other = checked[2]
        else:
            other = TrackManager(build(TrackerParameters, parameters), seed)
        selected = self.selected
        self._manager.adopt_parameters(other)
        if self._manager.max_targets > 1:
            self._selected = selected

    # Manual targets, detections and selection

    def request(self, box: Box, stamp: int = 0, label: str = "") -> None:
        """Request a manual target on the frame of this stamp, or else on the first one after it.

        Stamp 0 is the next frame. With `max_targets` 1 the target replaces the present one and an
        earlier request. If the last images were rejected for their size or type, it resets the
        tracker to such images.

        Raises:
            ValueError: The stamp is of another clock than those of the frames; or there are
                `max_targets` targets, and the box is on none of them.
        """
        self._clock.check_ahead(stamp)
        is_mismatched = self._format_guard.is_mismatched
        if self._manager.max_targets == 1:
            self.cancel_requests()
        elif is_mismatched or not self._manager.is_on_target(box):
            others = 0 if is_mismatched else len(self.targets)
            waiting = sum(
                one.on_mismatch or not self._manager.is_on_target(one.box)
                for one in self._requested
            )
            self._manager.check_capacity(others + waiting)
        self._requested.append(ManualTarget(box, label, stamp, is_mismatched))

    def cancel_requests(self) -> None:
        """Discard the manual targets that have not started."""
        self._requested = []

    def add_detections(self, detections: Detections, stamp: int = 0) -> None:
        """Queue detections until a frame arrives that is not before their own.

        Their frame may be past or future; stamp 0 is the next one. Detections of a skipped frame
        are ignored. The stamp counts, not their age.

        Raises:
            ValueError: The stamp is of another clock than those of the frames, or SciPy, which
                detections need, is not installed.
        """
        require_scipy()
        self.detector_runs += 1
        self._clock.check_ahead(stamp)
        self._clock.check_behind(stamp)
        if not self._clock.was_skipped(stamp):
            self._detection_queue.add(detections, stamp)

    def set_hints(self, hints: Mapping[int, Hint], stamp: int) -> None:
        """Tell what is known of targets, by id, from outside of the image; other ids are ignored.

        The hints are of an earlier frame, and count in the next one, once: what is in front of a
        target stays there for a while. They are ignored half a second later, or if time has gone
        back. Later ones replace them.

        Raises:
            ValueError: A number is out of its range.
        """
        self._hints = stamp, {id: check_hint(hint) for id, hint in hints.items()}

    def _take_hints(self, stamp: int) -> Mapping[int, Hint]:
        """The hints that count in the frame of a stamp."""
        (seen_at, hints), self._hints = self._hints, (0, {})
        return hints if 0 < stamp - seen_at <= _HINTED_WITHIN else {}

    def select(self, id: int) -> None:
        """Select the target that a robot acts on, by its id; 0 for none.

        It stays selected while it is lost and after it has ended.

        Raises:
            ValueError: No target has this id; the message lists the ids.
        """
        if id:
            self._manager.get_track(id)
        self._selected = id

    def stop(self) -> None:
        """Remove all targets, requests and queued detections.

        If time goes back with the next frame, a recording was rewound: ids count from 1 again, so
        that the same targets get the same ids.
        """
        self.cancel_requests()
        self._clear_targets()
        self._clock.expect_jump()

    def _clear_targets(self) -> None:
        self._detection_queue.clear()
        self._manual, self._checked, self._selected = {}, None, 0
        self._manager.clear()

    def stop_target(self, id: int) -> None:
        """Remove a target; a detector that still finds it starts it with a new id.

        Raises:
            ValueError: No target has this id; the message lists the ids.
        """
        self._manager.stop(id)
        self._manual.pop(id, None)
        self._selected = 0 if self._selected == id else self._selected

    def map_likelihood(self) -> LikelihoodMap | None:
        """The likelihood around the selected target's box in the last processed frame."""
        return self._manager.map_likelihood(self.selected)

    # Frames

    def skip(self, stamp: int) -> None:
        """Skip a frame, as during a pause: only the clock advances.

        Detections of this frame or earlier ones are discarded.
        """
        self._clock.skip(stamp)
        self._detection_queue.discard_due(stamp)

    def classify(self, stamp: int) -> Arrival:
        """Classify a frame by its stamp; call it once, before `process` or `drop`.

        Returns:
            "next", or "jump" if time has gone back; "late" or "duplicate" if the frame is to be
            dropped; "again" for a duplicate that a manual target starts on.
        """
        requested = [one.stamp for one in self._requested]
        order = self._clock.classify(stamp, self.time_policy.late_within, requested)
        if order == "duplicate" and any(is_due(one, stamp) for one in requested):
            return "again"
        return order

    def drop(self, arrival: Arrival) -> Outcome:
        """The outcome of a dropped frame, "late" or "duplicate"."""
        self._checked = None
        frame: FrameOutcome = "late" if arrival == "late" else "duplicate"
        return Outcome(frame, self.targets, self.selected)

    def process(self, frame: Frame, arrival: Arrival | None = None) -> Outcome:
        """Process one frame, whose image the session keeps.

        `arrival` was returned by `classify`; None if that was not called.

        Raises:
            ValueError: The image is invalid or of another format; the targets are kept.
        """
        arrival = arrival or self.classify(frame.stamp)
        if arrival in DROPPED_ARRIVALS:
            return self.drop(arrival)
        # Before the jump or the reset that it may cause.
        check_image(frame.image)
        self._checked = None
        if arrival == "again":
            # The frame is in the buffer already, so that a target can start on it.
            return self._outcome("duplicate", self._start_requested(frame))
        if self._is_frozen(frame, jumped=arrival == "jump"):
            self.skip(frame.stamp)
            return Outcome("frozen", self.targets, self.selected)
        if arrival == "jump":
            return self._jump_back(frame)
        return self._process_next(frame, self._clock.since_last(frame.stamp))

    def _is_frozen(self, frame: Frame, *, jumped: bool) -> bool:
        """Whether the images stand still, and no manual target starts on this one."""
        if jumped or not self.frozen_after:
            self._frozen_images.forget()
        if not self.frozen_after:
            return False
        is_frozen = self._frozen_images.seconds_unchanged(frame) > self.frozen_after
        return is_frozen and not any(is_due(one.stamp, frame.stamp) for one in self._requested)

    def _jump_back(self, frame: Frame) -> Outcome:
        """Process the first frame after a jump; requests and detections of before are discarded."""
        policy, stamp = self.time_policy.on_jump, frame.stamp
        # After `stop`, requests refer to the time after the jump.
        are_requests_new = self._clock.expects_jump
        seconds = self._clock.jump_back(stamp)
        if are_requests_new:
            self._manager.restart_ids()
        waiting = [
            one
            for one in self._requested
            if are_requests_new or not self._clock.is_from_before_jump(one.stamp, stamp)
        ]
        if len(waiting) < len(self._requested):
            self._refused.append(_DRAWN_BEFORE_JUMP)
        if policy == "keep":
            self._detection_queue.clear()
            # Its frames accept no detections.
            self._manager.frames.clear()
        else:
            manual = self._manual if policy == "restart" else {}
            if self._manager.max_targets == 1:
                manual = self._single_of(manual)
                if any(is_due(one.stamp, stamp) for one in waiting):
                    manual = {}
            redrawn = [
                one.redraw(frame.image, is_selected=id == self._selected)
                for id, one in manual.items()
            ]
            self._clear_targets()
            waiting = [*redrawn, *waiting]
        self._requested = waiting
        return self._process_next(frame, None, seconds)

    def _single_of(self, manual: Mapping[int, ManualTarget]) -> dict[int, ManualTarget]:
        """The selected one of manual targets, or else the last."""
        last = list(manual)[-1:]
        return {id: manual[id] for id in ([self._selected] if self._selected in manual else last)}

    def _process_next(
        self, frame: Frame, interval: float | None, jumped_back: float = 0.0
    ) -> Outcome:
        """Advance the targets by a frame, and start the manual targets that are due.

        The interval is None if unknown.
        """
        if self._adapt_to_format(frame):
            interval = None
        self._format_guard.accept(frame)
        discarded = self._detection_queue.discard_where(self._format_guard.is_before_change)
        detections = self._detection_queue.due(frame.stamp)
        hints = self._take_hints(frame.stamp)
        self._manager.update(frame, interval, detections, hints, selected=self.selected)
        self._clock.take(frame.stamp, interval)
        self._detection_queue.discard_due(frame.stamp)
        started = self._start_requested(frame)
        kept = {target.id for target in self.targets}
        self._manual = {id: one for id, one in self._manual.items() if id in kept}
        rejected_detections = (
            *self._manager.rejected_detections,
            *discarded,
            *self._detection_queue.pop_dropped_message(),
        )
        outcome: FrameOutcome = "tracked" if self.targets else "waiting"
        return self._outcome(outcome, started, rejected_detections, jumped_back)

    def _outcome(
        self,
        frame: FrameOutcome,
        started: Sequence[StartedTarget],
        rejected_detections: tuple[str, ...] = (),
        jumped_back: float = 0.0,
    ) -> Outcome:
        """The outcome of a frame, with all pending messages."""
        refused, self._refused = self._refused, []
        ended, self._ended = self._ended, []
        return Outcome(
            frame="started" if started else frame,
            targets=self.targets,
            selected=self.selected,
            started=tuple(one.id for one in started),
            refused=tuple(refused),
            ended=tuple(ended),
            rejected_detections=rejected_detections,
            jumped_back=jumped_back,
            caught_up=max((one.caught_up for one in started), default=0),
        )

    def _start_requested(self, frame: Frame) -> list[StartedTarget]:
        """Start the manual targets of frames up to this one."""
        due = [one for one in self._requested if is_due(one.stamp, frame.stamp)]
        self._requested = [one for one in self._requested if one not in due]
        started: list[StartedTarget] = []
        for manual in due:
            try:
                self._format_guard.check_manual_target(manual)
                stamp = manual.stamp if frame.stamp else 0
                target = self._manager.start(manual.box, stamp, manual.label)
            except ValueError as error:
                is_old = frame.stamp - manual.stamp > self.time_policy.late_within
                if isinstance(error, FrameNotBufferedError) and is_old and not manual.has_waited:
                    # A looped recording may have sent it before its first frame.
                    self._requested.append(manual._replace(has_waited=True))
                else:
                    self._refused.append(f"target refused: {error}")
            else:
                started.append(target)
                self._manual[target.id] = manual._replace(image_size=frame.size)
                if manual.is_selected:
                    self._selected = target.id
                elif self._manager.max_targets == 1:
                    self._selected = 0
        remaining = {target.id for target in self.targets}
        return [one for one in started if one.id in remaining]

    def _starts_single(self, manual: ManualTarget, frame: Frame) -> bool:
        """Whether a manual target starts on a frame as the single one, whatever its format."""
        if self._manager.max_targets > 1 or manual.stamp:
            return False
        try:
            check_box(manual.box, frame.size)
        except ValueError:
            return False
        return True

    def _adapt_to_format(self, frame: Frame) -> bool:
        """Scale the targets to a new image size, or reset the tracker to another camera.

        While there are manual targets, only one that is drawn on images of the other camera resets.

        Returns:
            Whether the tracker was reset.

        Raises:
            ValueError: The image has another format; the targets are kept.
        """
        if self._manager.accepts_image(frame.image) or self._manager.resize(frame):
            self._format_guard.count_match()
            return False
        self._format_guard.count_mismatch(frame.stamp)
        is_drawn_on = any(
            self._format_guard.is_on_mismatched_image(one, frame.stamp)
            or self._starts_single(one, frame)
            for one in self._requested
        )
        has_changed = self._format_guard.is_new_format and not self._manual
        if self.targets and not (is_drawn_on or has_changed):
            raise ValueError(self._format_guard.mismatch_message(frame.image))
        if is_drawn_on:
            self._requested = self._format_guard.moved_to_current(self._requested, frame.stamp)
            if self.targets and self._manager.max_targets > 1:
                self._ended.append(ended_message(target.id for target in self.targets))
        self._manager.reset()
        self._detection_queue.clear()
        self._format_guard.count_match()
        return True
