"""What happens to each frame where several targets are followed, and to what is said of frames.

Knows stamps and arrays, not messages; see `pf_tracker_ros.tracking.session` for a single target.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.parameters import build
from pf_tracker_ros.targets.detections import Detections
from pf_tracker_ros.targets.drawn import Drawn
from pf_tracker_ros.targets.history import History
from pf_tracker_ros.targets.image_kind import ImageKind, ended_for_others, ended_unseen
from pf_tracker_ros.targets.multi_tracker import MultiTracker
from pf_tracker_ros.targets.parameters import MultiTrackerParameters
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.targets.waiting_answers import WaitingAnswers
from pf_tracker_ros.tracking.frame_clock import FrameClock, TimePolicy, age_of, is_due
from pf_tracker_ros.tracking.input_checks import check_image
from pf_tracker_ros.tracking.scaling import size_of
from pf_tracker_ros.tracking.session import DRAWN_BEFORE_JUMP, FrameOutcome


@dataclass(frozen=True)
class MultiOutcome:
    """What became of one frame.

    Attributes:
        frame: As in `Outcome`; "started" where a target began that somebody asked for, "waiting"
            while there is none.
        targets: The targets after it, in the order of their ids; of the last frame if this one was
            dropped.
        started: Ids of those that somebody asked for and that began with it.
        refused: Why others that were asked for did not begin.
        ended: Which targets ended because of the images, and why.
        left_out: Why detections were no use.
        jumped_back: Seconds by which time went back with this frame, 0 if it did not.
    """

    frame: FrameOutcome
    targets: tuple[TrackedTarget, ...] = ()
    started: tuple[int, ...] = ()
    refused: tuple[str, ...] = ()
    ended: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    jumped_back: float = 0.0


class MultiSession:
    """Feeds frames and detections with stamps to a tracker of several targets.

    Stamps are in nanoseconds; 0 means unknown. Where the images change their size and keep their
    aspect ratio, the targets are learned again from where they were last seen, scaled to them.

    Attributes:
        time_policy: What to do when time jumps back; "restart" begins anew with the targets that
            somebody drew, and leaves the others to the detector. May be replaced at any time.

    Args:
        parameters: Full name to value of the tracker's tunables.
        seed: As for `MultiTracker`.

    Raises:
        ParameterError: A parameter is not allowed, or they contradict each other.
    """

    def __init__(self, parameters: Mapping[str, Any], seed: int) -> None:
        self.time_policy = TimePolicy()
        self._seed = seed
        self._tracker = MultiTracker(build(MultiTrackerParameters, parameters), seed)
        self._checked: tuple[Mapping[str, Any], int, MultiTracker] | None = None
        self._clock = FrameClock()
        self._answers = WaitingAnswers()
        self._kind = ImageKind()
        self._requested: list[Drawn] = []
        self._drawn: dict[int, Drawn] = {}
        # What the next outcome is to tell.
        self._refused: list[str] = []
        self._ended: list[str] = []

    @property
    def targets(self) -> tuple[TrackedTarget, ...]:
        """The targets after the last frame that was looked at, in the order of their ids."""
        return self._tracker.targets

    @property
    def history(self) -> History:
        """The frames that a target can still be started on, and that detections may be of."""
        return self._tracker.history

    @property
    def requested_stamp(self) -> int | None:
        """Stamp of the frame that a requested target waits for, None if there is no such target."""
        return min((one.stamp for one in self._requested), default=None)

    def check(self, parameters: Mapping[str, Any], seed: int) -> None:
        """Try what `configure` would do, and change nothing that is told.

        Raises:
            ValueError: As `configure`.
        """
        other = MultiTracker(build(MultiTrackerParameters, parameters), seed)
        self._tracker.check_parameters(other)
        self._checked = (parameters, seed, other)

    def configure(self, parameters: Mapping[str, Any], seed: int) -> None:
        """Change parameters, all or none, keeping the targets; see `MultiTracker.set_parameters`.

        The seed counts from the next target.

        Raises:
            ValueError: A parameter is not allowed, they contradict each other, or a target was not
                seen for so long that it could not be learned with them.
        """
        checked, self._checked = self._checked, None
        if (dict(parameters), seed) == (self._tracker.parameters, self._seed):
            return
        if checked and checked[:2] == (parameters, seed):
            other = checked[2]
        else:
            other = MultiTracker(build(MultiTrackerParameters, parameters), seed)
        self._tracker.share_parameters(other)
        self._seed = seed

    def request(self, box: Box, stamp: int = 0, label: str = "") -> None:
        """Start one more target with the frame of this stamp, or else the first one after it.

        Where the last images were refused because they are of another kind, all begins anew with
        these.

        Args:
            box: (x, y, width, height), pixels.
            stamp: Of the frame that the box was drawn on; 0 for the next frame.
            label: What it is.

        Raises:
            ValueError: The stamp is by another clock than those of the frames, or there are as many
                targets as there may be, and the box is on none of them.
        """
        self._clock.check_ahead(stamp)
        is_other_kind = self._kind.is_doubtful
        others = 0 if is_other_kind else len(self.targets)
        if is_other_kind or not self._tracker.is_followed(box):
            self._tracker.check_room(others + len(self._requested))
        self._requested.append(Drawn(box, label, stamp, is_other_kind))

    def withdraw(self) -> None:
        """Forget requested targets that have not been started."""
        self._requested = []

    def add_detections(self, detections: Detections, stamp: int = 0) -> None:
        """Take what a detector found; it counts with the next frame that is not before it.

        Args:
            detections: Of one frame; their age is not looked at.
            stamp: Of that frame, of now or gone by or to come; 0 for the next one. Of one that was
                passed over, nothing counts.

        Raises:
            ValueError: The stamp is by another clock than those of the frames.
        """
        self._clock.check_ahead(stamp)
        self._clock.check_behind(stamp)
        if not self._clock.was_passed_over(stamp):
            self._answers.add(detections, stamp)

    def pass_over(self, stamp: int) -> None:
        """Let the clock go on with a frame that is not looked at, as while there is a pause.

        What detectors say of it, and have said of those before, counts nowhere.

        Args:
            stamp: Of the frame.
        """
        self._clock.pass_over(stamp)
        self._answers.forget_due(stamp)

    def stop(self) -> None:
        """Forget all targets, requested ones, and what detectors have said so far."""
        self.withdraw()
        self._forget_targets()
        self._clock.begin_anew()

    def _forget_targets(self) -> None:
        self._answers.clear()
        self._drawn, self._checked = {}, None
        self._tracker.clear()

    def stop_target(self, id: int) -> None:
        """Forget one target; a detector that still sees it will start it again, with another id.

        Raises:
            ValueError: There is no such target; the message lists those there are.
        """
        self._tracker.stop(id)
        self._drawn.pop(id, None)

    def process(self, image: NDArray[np.generic], stamp: int) -> MultiOutcome:
        """Take one frame.

        Args:
            image: As for `MultiTracker.update`.
            stamp: When it was taken.

        Returns:
            What became of it.

        Raises:
            ValueError: The tracker refuses the image; the targets are kept.
        """
        return self.process_unread(lambda: image, stamp)

    def process_unread(self, read: Callable[[], NDArray[np.generic]], stamp: int) -> MultiOutcome:
        """As `process`, with an image that is read only if it is needed; see `Session`."""
        requested = [one.stamp for one in self._requested]
        place = self._clock.place(stamp, self.time_policy.late_within, requested)
        is_asked_for = any(is_due(one, stamp) for one in requested)
        if place == "late" or (place == "duplicate" and not is_asked_for):
            self._checked = None
            return MultiOutcome(place, self.targets)
        image = read()
        # Before anything is given up for it.
        check_image(image)
        self._checked = None
        if place == "jump":
            return self._jump_back(image, stamp)
        if place == "duplicate":
            # It has been looked at, so that a target can start on it as on any that is kept.
            return self._outcome(place, self._start_requested(image, stamp))
        return self._track(image, stamp, self._clock.since_last(stamp))

    def _jump_back(self, image: NDArray[np.generic], stamp: int) -> MultiOutcome:
        """Go on in a time that began anew, without what waits for frames of the old one."""
        policy = self.time_policy.on_jump
        are_of_since = self._clock.begins_anew
        seconds = self._clock.jump_back(stamp)
        waiting = [
            one
            for one in self._requested
            if are_of_since or not self._clock.is_of_before(one.stamp, stamp)
        ]
        if len(waiting) < len(self._requested):
            self._refused.append(DRAWN_BEFORE_JUMP)
        if policy == "keep":
            self._answers.clear()
            self._tracker.forget_past()
        else:
            drawn = [*self._drawn.values()] if policy == "restart" else []
            self._forget_targets()
            waiting = [*(one.redraw(image) for one in drawn), *waiting]
        self._requested = waiting
        return self._track(image, stamp, None, seconds)

    def _track(
        self,
        image: NDArray[np.generic],
        stamp: int,
        interval: float | None,
        jumped_back: float = 0.0,
    ) -> MultiOutcome:
        """Follow the targets into a frame, and start those that were asked for.

        Args:
            image: Of the frame.
            stamp: Of the frame.
            interval: Seconds since the last one, None where nobody knows.
            jumped_back: As told in the outcome.
        """
        if self._fit(image, stamp):
            interval = None
        self._kind.accept(image, stamp)
        of_others = self._answers.forget_all_of(self._kind.is_of_others)
        self._tracker.update(image, interval, self._answers.due(stamp))
        self._clock.take(stamp, interval)
        self._answers.forget_due(stamp)
        started = self._start_requested(image, stamp)
        kept = {target.id for target in self.targets}
        self._drawn = {id: drawn for id, drawn in self._drawn.items() if id in kept}
        left_out = (*self._tracker.left_out, *of_others, *self._answers.tell_dropped())
        frame: FrameOutcome = "tracked" if self.targets else "waiting"
        return self._outcome(frame, started, left_out, jumped_back)

    def _outcome(
        self,
        frame: FrameOutcome,
        started: Sequence[int],
        left_out: tuple[str, ...] = (),
        jumped_back: float = 0.0,
    ) -> MultiOutcome:
        """What became of a frame, with what has waited to be told."""
        refused, self._refused = self._refused, []
        ended, self._ended = self._ended, []
        return MultiOutcome(
            "started" if started else frame,
            self.targets,
            tuple(started),
            tuple(refused),
            tuple(ended),
            left_out,
            jumped_back,
        )

    def _start_requested(self, image: NDArray[np.generic], stamp: int) -> list[int]:
        """Start what was asked for on frames up to this one; the ids."""
        due = [one for one in self._requested if is_due(one.stamp, stamp)]
        self._requested = [one for one in self._requested if one not in due]
        started: list[int] = []
        for drawn in due:
            age = age_of(drawn.stamp, stamp)
            try:
                self._kind.check_drawn(drawn)
                id = self._tracker.start_earlier(drawn.box, age, drawn.label)
            except ValueError as error:
                self._refused.append(f"target refused: {error}")
            else:
                started.append(id)
                self._drawn[id] = drawn._replace(image_size=size_of(image))
        return started

    def _fit(self, image: NDArray[np.generic], stamp: int) -> bool:
        """Go on with images of another size, or of another camera.

        A target that somebody drew is given up for another camera only where one was drawn on its
        images.

        Returns:
            Whether all begins anew.

        Raises:
            ValueError: The image fits no target, and they are kept.
        """
        if self._tracker.fits(image):
            self._kind.fit()
            return False
        if self._tracker.resize(image):
            self._kind.fit()
            self._tell_unseen()
            return False
        self._kind.misfit(stamp)
        is_drawn_on = any(self._kind.is_of_misfits(one, stamp) for one in self._requested)
        has_changed = self._kind.is_another and not self._drawn
        if self.targets and not (is_drawn_on or has_changed):
            raise ValueError(self._kind.refusal(image))
        if is_drawn_on:
            self._requested = self._kind.brought_over(self._requested, stamp)
            if self.targets:
                self._ended.append(ended_for_others(target.id for target in self.targets))
        self._tracker.forget_camera()
        self._answers.clear()
        self._kind.fit()
        return True

    def _tell_unseen(self) -> None:
        """Tell of targets that somebody drew and that could not be learned in another size."""
        there = {target.id for target in self.targets}
        unseen = [id for id in self._drawn if id not in there]
        if unseen:
            self._ended.append(ended_unseen(unseen))
