"""What happens to each frame, and to what is said of frames: targets, detections, parameters.

1. A frame is classified by its stamp: next, late, doubled, or the first after a jump of time.
2. Where images change their size the targets go on scaled; another camera begins anew.
3. The targets are followed into the frame, with the detections that are due.
4. Targets that somebody has drawn on it, or on a frame before it, are started.

Knows stamps and arrays, not messages. Stamps are in nanoseconds; 0 means unknown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import build
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
from pf_tracker_ros.tracking.frame_clock import FrameClock, TimePolicy, is_due
from pf_tracker_ros.tracking.input_checks import check_box, check_image
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap
from pf_tracker_ros.tracking.parameters import TrackerParameters

FrameOutcome = Literal["started", "tracked", "duplicate", "late", "waiting"]
Arrival = Literal["next", "jump", "again", "duplicate", "late"]
DROPPED_ARRIVALS = ("duplicate", "late")
"""Arrivals of frames whose images nobody needs."""

_DRAWN_BEFORE_JUMP = (
    "target refused: it was drawn on a frame from before time went back; draw it again"
)


@dataclass(frozen=True)
class Outcome:
    """What became of one frame.

    Attributes:
        frame: "started" where a target began that somebody asked for, or "tracked"; "duplicate" or
            "late" if it was dropped, which a duplicate that a target can start on is not; "waiting"
            while there is no target.
        targets: The targets after it, in the order of their ids; of the last frame if this one was
            dropped.
        selected: Id of the target that a robot acts on, see `Session.select`; 0 without.
        started: Ids of those that somebody asked for and that began with it.
        refused: Why others that were asked for did not begin.
        ended: Which targets ended because of the images, and why.
        rejected_detections: Why detections were no use.
        jumped_back: Seconds by which time went back with this frame, 0 if it did not.
        caught_up: Frames before this one that a target was followed through which began with it.
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
        """Of the selected target; None where there is none."""
        return estimate_of(self.targets, self.selected)


def estimate_of(targets: Sequence[TrackedTarget], id: int) -> Estimate | None:
    """What is known of a target; None where there is no such one."""
    return next((target.estimate for target in targets if target.id == id), None)


class Session:
    """Feeds frames, targets and detections with stamps to a `TrackManager`.

    Where the images change their size and keep their aspect ratio, the targets are learned again
    from where they were last seen, scaled to them.

    Attributes:
        time_policy: What to do when time jumps back; "restart" begins anew with the targets that
            somebody drew, and leaves the others to the detector. May be replaced at any time.
        detector_runs: Number of the answers of detectors so far.

    Args:
        parameters: Full name to value of the tracker's tunables.
        seed: As for `Tracker`.

    Raises:
        ParameterError: A parameter is not allowed, or they contradict each other.
    """

    def __init__(self, parameters: Mapping[str, Any], seed: int) -> None:
        self.time_policy = TimePolicy()
        self.detector_runs = 0
        self._manager = TrackManager(build(TrackerParameters, parameters), seed)
        self._checked: tuple[Mapping[str, Any], int, TrackManager] | None = None
        self._clock = FrameClock()
        self._answers = DetectionQueue()
        self._kind = ImageFormatGuard()
        self._selected = 0
        self._requested: list[ManualTarget] = []
        self._drawn: dict[int, ManualTarget] = {}
        # What the next outcome is to tell: the frame at hand may be refused, and tell nothing.
        self._refused: list[str] = []
        self._ended: list[str] = []

    @property
    def targets(self) -> tuple[TrackedTarget, ...]:
        """The targets after the last frame that was looked at, in the order of their ids."""
        return self._manager.targets

    @property
    def selected(self) -> int:
        """Id of the selected target; where only one may be and is, that one is; 0 without."""
        targets = self.targets
        if not self._selected and self._manager.max_targets == len(targets) == 1:
            return targets[0].id
        return self._selected

    @property
    def estimate(self) -> Estimate | None:
        """Of the selected target after the last frame that was looked at; None without it."""
        return estimate_of(self.targets, self.selected)

    @property
    def frame_buffer(self) -> FrameBuffer:
        """The frames that a target can still be started on, and that detections may be of."""
        return self._manager.frames

    @property
    def requested_stamp(self) -> int | None:
        """Stamp of the frame that a requested target waits for, None if there is no such target."""
        return min((one.stamp for one in self._requested), default=None)

    # Parameters

    def check(self, parameters: Mapping[str, Any], seed: int) -> None:
        """Try what `configure` would do, and change nothing that is told.

        Raises:
            ValueError: As `configure`.
        """
        other = TrackManager(build(TrackerParameters, parameters), seed)
        self._manager.check_parameters(other)
        self._checked = (parameters, seed, other)

    def configure(self, parameters: Mapping[str, Any], seed: int) -> None:
        """Change parameters, all or none, keeping the targets; the seed counts from the next one.

        The only target that might be stays selected where there may be more from then on.

        What decides on how a target is described, such as the motion model, learns it again from
        where it was last seen. A hidden or lost target stays so until a frame shows it.

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

    # What is said of frames

    def request(self, box: Box, stamp: int = 0, label: str = "") -> None:
        """Start a target with the frame of this stamp, or else the first one after it.

        Where only one target may be, it takes the place of the one before, and of one that was
        requested. Where the last images were refused because they are of another kind, all begins
        anew with these.

        Args:
            box: (x, y, width, height), pixels.
            stamp: Of the frame that the box was drawn on; 0 for the next frame.
            label: What it is.

        Raises:
            ValueError: The stamp is by another clock than those of the frames, or there are as many
                targets as there may be, and the box is on none of them.
        """
        self._clock.check_ahead(stamp)
        is_other_kind = self._kind.is_mismatched
        if self._manager.max_targets == 1:
            self.cancel_requests()
        elif is_other_kind or not self._manager.is_on_target(box):
            others = 0 if is_other_kind else len(self.targets)
            self._manager.check_capacity(others + len(self._requested))
        self._requested.append(ManualTarget(box, label, stamp, is_other_kind))

    def cancel_requests(self) -> None:
        """Forget requested targets that have not been started."""
        self._requested = []

    def add_detections(self, detections: Detections, stamp: int = 0) -> None:
        """Take what a detector found; it counts with the next frame that is not before it.

        Args:
            detections: Of one frame; their age is not looked at.
            stamp: Of that frame, of now or gone by or to come; 0 for the next one. Of one that was
                passed over, nothing counts.

        Raises:
            ValueError: The stamp is by another clock than those of the frames, or SciPy, which
                detections need, is not installed.
        """
        require_scipy()
        self.detector_runs += 1
        self._clock.check_ahead(stamp)
        self._clock.check_behind(stamp)
        if not self._clock.was_skipped(stamp):
            self._answers.add(detections, stamp)

    def select(self, id: int) -> None:
        """Say which of several targets a robot acts on.

        It stays selected while it is lost, and after it has ended: no other takes its place.

        Args:
            id: Of the target; 0 for none.

        Raises:
            ValueError: There is no such target; the message lists those there are.
        """
        if id:
            self._manager.get_track(id)
        self._selected = id

    def stop(self) -> None:
        """Forget all targets, requested ones, and what detectors have said so far."""
        self.cancel_requests()
        self._forget_targets()
        self._clock.expect_jump()

    def _forget_targets(self) -> None:
        self._answers.clear()
        self._drawn, self._checked, self._selected = {}, None, 0
        self._manager.clear()

    def stop_target(self, id: int) -> None:
        """Forget one target; a detector that still sees it will start it again, with another id.

        Raises:
            ValueError: There is no such target; the message lists those there are.
        """
        self._manager.stop(id)
        self._drawn.pop(id, None)
        self._selected = 0 if self._selected == id else self._selected

    def map_likelihood(self) -> LikelihoodMap | None:
        """How likely the selected target is around its box, in the frame looked at last."""
        return self._manager.map_likelihood(self.selected)

    # Frames

    def skip(self, stamp: int) -> None:
        """Let the clock go on with a frame that is not looked at, as while there is a pause.

        What detectors say of it, and have said of those before, counts nowhere.

        Args:
            stamp: Of the frame.
        """
        self._clock.skip(stamp)
        self._answers.discard_due(stamp)

    def classify(self, stamp: int) -> Arrival:
        """What a frame is by its stamp alone; to be asked once, before `process` or `drop`.

        Args:
            stamp: Of the frame.

        Returns:
            "next" or, after time has gone back, "jump"; "late" or "duplicate" where its image is
            not needed; "again" where it is a duplicate that a target starts on.
        """
        requested = [one.stamp for one in self._requested]
        place = self._clock.classify(stamp, self.time_policy.late_within, requested)
        if place == "duplicate" and any(is_due(one, stamp) for one in requested):
            return "again"
        return place

    def drop(self, arrival: Arrival) -> Outcome:
        """What became of a frame that is dropped, "late" or "duplicate"."""
        self._checked = None
        frame: FrameOutcome = "late" if arrival == "late" else "duplicate"
        return Outcome(frame, self.targets, self.selected)

    def process(self, frame: Frame, arrival: Arrival | None = None) -> Outcome:
        """Take one frame.

        Args:
            frame: Its image as for `Tracker.update`; the session's from now on.
            arrival: As by `classify`; None where that was not asked.

        Returns:
            What became of it.

        Raises:
            ValueError: The tracker refuses the image; the targets are kept.
        """
        arrival = arrival or self.classify(frame.stamp)
        if arrival in DROPPED_ARRIVALS:
            return self.drop(arrival)
        # Before anything is given up for it.
        check_image(frame.image)
        self._checked = None
        if arrival == "again":
            # It has been looked at, so that a target can start on it as on any that is kept.
            return self._outcome("duplicate", self._start_requested(frame))
        if arrival == "jump":
            return self._jump_back(frame)
        return self._track(frame, self._clock.since_last(frame.stamp))

    def _jump_back(self, frame: Frame) -> Outcome:
        """Go on in a time that began anew, without what waits for frames of the old one."""
        policy, stamp = self.time_policy.on_jump, frame.stamp
        are_of_since = self._clock.expects_jump
        seconds = self._clock.jump_back(stamp)
        waiting = [
            one
            for one in self._requested
            if are_of_since or not self._clock.is_from_before_jump(one.stamp, stamp)
        ]
        if len(waiting) < len(self._requested):
            self._refused.append(_DRAWN_BEFORE_JUMP)
        if policy == "keep":
            self._answers.clear()
            self._manager.clear_history()
        else:
            drawn = self._drawn if policy == "restart" else {}
            if self._manager.max_targets == 1:
                drawn = self._only_of(drawn)
                if any(is_due(one.stamp, stamp) for one in waiting):
                    drawn = {}
            redrawn = [
                one.redraw(frame.image, is_selected=id == self._selected)
                for id, one in drawn.items()
            ]
            self._forget_targets()
            waiting = [*redrawn, *waiting]
        self._requested = waiting
        return self._track(frame, None, seconds)

    def _only_of(self, drawn: Mapping[int, ManualTarget]) -> dict[int, ManualTarget]:
        """Of those that were drawn the selected one, or else the last, where only one may be."""
        last = list(drawn)[-1:]
        return {id: drawn[id] for id in ([self._selected] if self._selected in drawn else last)}

    def _track(self, frame: Frame, interval: float | None, jumped_back: float = 0.0) -> Outcome:
        """Follow the targets into a frame, and start those that were asked for.

        Args:
            frame: The next one.
            interval: Seconds since the last one, None where nobody knows.
            jumped_back: As told in the outcome.
        """
        if self._fit(frame):
            interval = None
        self._kind.accept(frame)
        of_others = self._answers.discard_where(self._kind.is_before_change)
        self._manager.update(frame, interval, self._answers.due(frame.stamp))
        self._clock.take(frame.stamp, interval)
        self._answers.discard_due(frame.stamp)
        started = self._start_requested(frame)
        kept = {target.id for target in self.targets}
        self._drawn = {id: drawn for id, drawn in self._drawn.items() if id in kept}
        rejected_detections = (
            *self._manager.rejected_detections,
            *of_others,
            *self._answers.pop_dropped_message(),
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
        """What became of a frame, with what has waited to be told."""
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
        """Start what was asked for on frames up to this one."""
        due = [one for one in self._requested if is_due(one.stamp, frame.stamp)]
        self._requested = [one for one in self._requested if one not in due]
        started: list[StartedTarget] = []
        for drawn in due:
            try:
                self._kind.check_manual_target(drawn)
                stamp = drawn.stamp if frame.stamp else 0
                begun = self._manager.start(drawn.box, stamp, drawn.label)
            except ValueError as error:
                is_long_ago = frame.stamp - drawn.stamp > self.time_policy.late_within
                if (
                    isinstance(error, FrameNotBufferedError)
                    and is_long_ago
                    and not drawn.has_waited
                ):
                    # A recording that begins again may have sent it before its first frame.
                    self._requested.append(drawn._replace(has_waited=True))
                else:
                    self._refused.append(f"target refused: {error}")
            else:
                started.append(begun)
                self._drawn[begun.id] = drawn._replace(image_size=frame.size)
                if drawn.is_selected:
                    self._selected = begun.id
                elif self._manager.max_targets == 1:
                    self._selected = 0
        there = {target.id for target in self.targets}
        return [one for one in started if one.id in there]

    def _takes_the_place(self, drawn: ManualTarget, frame: Frame) -> bool:
        """Whether a target will be the only one with a frame, whatever images the others are of."""
        if self._manager.max_targets > 1 or drawn.stamp:
            return False
        try:
            check_box(drawn.box, frame.size)
        except ValueError:
            return False
        return True

    def _fit(self, frame: Frame) -> bool:
        """Go on with images of another size, or of another camera.

        A target that somebody drew is given up for another camera only where one was drawn on its
        images.

        Returns:
            Whether all begins anew.

        Raises:
            ValueError: The image fits no target, and they are kept.
        """
        if self._manager.accepts_image(frame.image) or self._manager.resize(frame):
            self._kind.count_match()
            return False
        self._kind.count_mismatch(frame.stamp)
        is_drawn_on = any(
            self._kind.is_on_mismatched_image(one, frame.stamp) or self._takes_the_place(one, frame)
            for one in self._requested
        )
        has_changed = self._kind.is_new_format and not self._drawn
        if self.targets and not (is_drawn_on or has_changed):
            raise ValueError(self._kind.mismatch_message(frame.image))
        if is_drawn_on:
            self._requested = self._kind.moved_to_current(self._requested, frame.stamp)
            if self.targets and self._manager.max_targets > 1:
                self._ended.append(ended_message(target.id for target in self.targets))
        self._manager.reset()
        self._answers.clear()
        self._kind.count_match()
        return True
