"""What happens to each frame: which start the target, which are tracked, which are dropped.

Knows stamps and arrays, not messages.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import build
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tracking.frame_clock import FrameClock, TimePolicy, is_due
from pf_tracker_ros.tracking.frame_history import FrameHistory, PastFrame
from pf_tracker_ros.tracking.input_checks import check_image
from pf_tracker_ros.tracking.likelihood_map import LikelihoodMap
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.scaling import (
    box_within,
    is_scaled,
    scaled_box,
    scaled_to,
    size_of,
    size_text,
)
from pf_tracker_ros.tracking.tracker import Tracker

FrameOutcome = Literal["started", "tracked", "duplicate", "late", "waiting"]

# A target's frame may have been lost on the way; one so much later stands in for it.
_SUBSTITUTE_WITHIN = NANOSECONDS

DRAWN_BEFORE_JUMP = (
    "target refused: it was drawn on a frame from before time went back; draw it again"
)

# Through so many frames a target is followed to catch up: in the meantime no image is answered.
_MOST_CAUGHT_UP = 30


@dataclass(frozen=True)
class Outcome:
    """What became of one frame.

    Attributes:
        frame: "started" or "tracked"; "duplicate" or "late" if it was dropped, which a duplicate
            that a target can start on is not; "waiting" while there is no target.
        estimate: The latest estimate, None while there is no target.
        refused_target: Why the target that this frame should have started was refused, or empty.
        jumped_back: Seconds by which time went back with this frame, 0 if it did not.
        caught_up: Frames from the history that a target was followed through up to this one.
    """

    frame: FrameOutcome
    estimate: Estimate | None
    refused_target: str = ""
    jumped_back: float = 0.0
    caught_up: int = 0


@dataclass(frozen=True)
class _RequestedTarget:
    box: Box
    stamp: int
    # Whether it has waited for a frame with which time goes back to it.
    has_waited: bool = False


class _OfLongAgoError(ValueError):
    """The frame that a target was drawn on is not kept any more."""


@dataclass(frozen=True)
class _Sighting:
    """A frame with the target in it, to learn the target from again."""

    frame: PastFrame
    box: Box


class _FirstBox(NamedTuple):
    """What a target was drawn with.

    Attributes:
        box: Pixels.
        image_size: (width, height) of the image that it was drawn on, pixels.
    """

    box: Box
    image_size: tuple[int, int]


class _Change(NamedTuple):
    """What other parameters come to.

    Attributes:
        parameters: Full name to value.
        seed: Of the next target.
        tracker: With these parameters, and with the target if that had to be learned again; None
            where the parameters are those in force.
    """

    parameters: Mapping[str, Any]
    seed: int
    tracker: Tracker | None


class Session:
    """Feeds frames with stamps to a tracker.

    Stamps are in nanoseconds; 0 means unknown.

    Where the images change their size and keep their aspect ratio, the target is learned again from
    where it was last seen, scaled to them.

    Attributes:
        time_policy: What to do when time jumps back; may be replaced at any time.
        history: The frames that a target can still be started on.

    Args:
        parameters: Full name to value of the tracker's tunables.
        seed: As for `Tracker`.

    Raises:
        ParameterError: A parameter is not allowed, or they contradict each other.
    """

    def __init__(self, parameters: Mapping[str, Any], seed: int) -> None:
        self.time_policy = TimePolicy()
        self.history = FrameHistory()
        self._seed = seed
        self._tracker = Tracker(build(TrackerParameters, parameters), seed)
        self._requested: _RequestedTarget | None = None
        # What the next outcome is to tell: the frame at hand may be refused, and tell nothing.
        self._refused = ""
        self._estimate: Estimate | None = None
        self._first: _FirstBox | None = None
        self._sighting: _Sighting | None = None
        self._checked: _Change | None = None
        self._clock = FrameClock()
        # Before the last one where the target has been learned again from an earlier frame.
        self._followed_until = 0

    @property
    def estimate(self) -> Estimate | None:
        """As told for the last frame that was looked at, None while there is no target."""
        return self._estimate

    @property
    def requested_stamp(self) -> int | None:
        """Stamp of the frame that a requested target waits for, None if there is no such target."""
        return self._requested.stamp if self._requested else None

    def check(self, parameters: Mapping[str, Any], seed: int) -> None:
        """Try what `configure` would do, and change nothing that is told.

        What came of it is kept for a `configure` with the same parameters before the next frame.

        Raises:
            ValueError: As `configure`.
        """
        self._checked = self._change(parameters, seed)

    def configure(self, parameters: Mapping[str, Any], seed: int) -> None:
        """Change parameters, all or none, keeping the target; the seed counts from the next one.

        A change that the library forbids while there is a target, such as that of the motion model,
        takes a tracker of its own: it learns the target again from where it was last seen. A hidden
        or lost target stays so until a frame shows it.

        Raises:
            ValueError: A parameter is not allowed, they contradict each other, or the target
                cannot be learned with them.
        """
        change, self._checked = self._checked, None
        if change is None or (change.parameters, change.seed) != (parameters, seed):
            change = self._change(parameters, seed)
        if change.tracker and change.tracker.started and self._sighting:
            self._tracker = change.tracker
            self._followed_until = self._sighting.frame.stamp
        elif change.tracker:
            self._tracker.share_parameters(change.tracker)
        self._seed = seed

    def _change(self, parameters: Mapping[str, Any], seed: int) -> _Change:
        if parameters == self._tracker.parameters:
            return _Change(parameters, seed, None)
        tracker = Tracker(build(TrackerParameters, parameters), seed)
        if self._sighting and self._tracker.forbid(tracker.parameters):
            image = self._sighting.frame.image
            tracker.take_over(self._tracker, image, box_within(self._sighting.box, image))
        return _Change(parameters, seed, tracker)

    def request(self, box: Box, stamp: int = 0) -> None:
        """Start on a target with the frame of this stamp, or else the first one after it.

        Args:
            box: (x, y, width, height), pixels.
            stamp: Of the frame that the box was drawn on; 0 for the next frame.

        Raises:
            ValueError: The stamp is by another clock than those of the frames.
        """
        self._clock.check_ahead(stamp)
        self._requested = _RequestedTarget(box, stamp)

    def withdraw(self) -> None:
        """Forget a requested target that has not been started."""
        self._requested = None

    def stop(self) -> None:
        """Forget the target, and a requested one."""
        self.withdraw()
        self._forget_target()
        self._clock.begin_anew()

    def _forget_target(self) -> None:
        self._tracker.stop()
        self._estimate = self._sighting = self._checked = None

    def pass_over(self, stamp: int) -> None:
        """Let the clock go on with a frame that is not looked at, as while there is a pause."""
        self._clock.pass_over(stamp)

    def map_likelihood(self) -> LikelihoodMap | None:
        """How likely the target is around its box, in the frame that was looked at last."""
        return self._tracker.map_likelihood()

    def process(self, image: NDArray[np.generic], stamp: int) -> Outcome:
        """Take one frame.

        Args:
            image: As for `Tracker.update`.
            stamp: When it was taken.

        Returns:
            What became of it.

        Raises:
            ValueError: The tracker refuses the image; the target is kept.
        """
        return self.process_unread(lambda: image, stamp)

    def process_unread(self, read: Callable[[], NDArray[np.generic]], stamp: int) -> Outcome:
        """Take one frame, and read its image unless the stamp alone tells that it is dropped.

        Args:
            read: Gives the image, as for `process`.
            stamp: When it was taken.

        Returns:
            What became of it.

        Raises:
            ValueError: As `process`.
            Exception: Whatever `read` raises; nothing has changed then.
        """
        requested = (self._requested.stamp,) if self._requested else ()
        place = self._clock.place(stamp, self.time_policy.late_within, requested)
        is_asked_for = any(is_due(one, stamp) for one in requested)
        if place == "late" or (place == "duplicate" and not is_asked_for):
            self._checked = None
            return Outcome(place, self.estimate)
        image = read()
        # Before anything is given up for it.
        check_image(image)
        frame = Frame(image, stamp)
        self._checked = None
        if place == "jump":
            return self._jump_back(frame)
        if started := self._start_requested(frame, self.history):
            return started
        if place == "duplicate":
            return Outcome(place, self.estimate, self._tell_refused())
        if not self._tracker.started:
            self._take(frame, None)
            return Outcome("waiting", None, self._tell_refused())
        return self._track(frame)

    def _start_requested(self, frame: Frame, history: FrameHistory) -> Outcome | None:
        """Start on what was asked for on frames up to this one.

        Args:
            frame: At hand.
            history: The frames before.

        Returns:
            The outcome, None where nothing starts.
        """
        requested = self._requested
        if requested is None or not is_due(requested.stamp, frame.stamp):
            return None
        self._requested = None
        try:
            return self._start(_frames_of(requested, frame, history), requested.box)
        except _OfLongAgoError as error:
            elapsed = frame.stamp - requested.stamp
            if elapsed > self.time_policy.late_within and not requested.has_waited:
                # A recording that begins again may have sent it before its first frame.
                self._requested = replace(requested, has_waited=True)
            else:
                self._refused = f"target refused: {error}"
        except ValueError as error:
            self._refused = f"target refused: {error}"
        return None

    def _tell_refused(self) -> str:
        """Why what was asked for did not start, if that is still to be told."""
        refused, self._refused = self._refused, ""
        return refused

    def _start(self, frames: Sequence[PastFrame], box: Box) -> Outcome:
        # A tracker of its own for each target: the one before stays as it is if this is refused.
        tracker = self._tracker.empty(self._seed)
        estimate = tracker.start(frames[0].image, box)
        sighting = _Sighting(frames[0], box)
        for before, frame in itertools.pairwise(frames):
            estimate = tracker.update(frame.image, (frame.stamp - before.stamp) / NANOSECONDS)
            if estimate.state == "tracking":
                sighting = _Sighting(frame, estimate.box)
        self._tracker, self._sighting = tracker, sighting
        self._first = _FirstBox(box, frames[0].size)
        self._take(frames[-1], estimate)
        return Outcome("started", estimate, self._tell_refused(), caught_up=len(frames) - 1)

    def _jump_back(self, frame: Frame) -> Outcome:
        """Go on in a time that began anew, without what waits for frames of the old one."""
        is_of_since = self._clock.begins_anew
        seconds = self._clock.jump_back(frame.stamp)
        requested = self._requested
        is_lost = requested and self._clock.is_of_before(requested.stamp, frame.stamp)
        if is_lost and not is_of_since:
            self._requested, self._refused = None, DRAWN_BEFORE_JUMP
        outcome = self._start_requested(frame, FrameHistory()) or self._begin_anew(frame)
        return replace(outcome, jumped_back=seconds)

    def _begin_anew(self, frame: Frame) -> Outcome:
        """Do what the policy says with the target of the old time, on a frame of the new one."""
        policy = self.time_policy.on_jump
        if policy == "keep" and self._tracker.started:
            return self._track(frame, goes_on=False)
        if policy == "restart" and self._tracker.started and self._first:
            try:
                return self._start([frame], _box_in(frame.image, self._first))
            except ValueError as error:
                self._refused = f"target refused: {error}"
        self._forget_target()
        self._take(frame, None)
        return Outcome("waiting", None, self._tell_refused())

    def _track(self, frame: Frame, *, goes_on: bool = True) -> Outcome:
        """Follow the target into a frame; time goes on with it, or has begun anew."""
        tracker, before = self._tracker, self._followed_until
        if not tracker.fits(frame.image) and self._sighting:
            scaled = self._scaled_to(frame.image, self._sighting)
            if scaled:
                tracker, before = scaled, self._sighting.frame.stamp
        known = goes_on and 0 not in (frame.stamp, before) and before <= frame.stamp
        interval = (frame.stamp - before) / NANOSECONDS if known else None
        estimate = tracker.update(frame.image, interval)
        self._tracker = tracker
        if estimate.state == "tracking":
            self._sighting = _Sighting(frame, estimate.box)
        self._take(frame, estimate)
        return Outcome("tracked", estimate, self._tell_refused())

    def _scaled_to(self, image: NDArray[np.generic], sighting: _Sighting) -> Tracker | None:
        """A tracker that learns the target from a sighting scaled to an image's size.

        None where the image is of another kind or aspect ratio, or too small to show the target.
        """
        seen = sighting.frame.image
        scaled = scaled_to(seen, image)
        if scaled is None:
            return None
        tracker = self._tracker.empty(self._seed)
        try:
            box = scaled_box(box_within(sighting.box, seen), size_of(seen), size_of(image))
            tracker.take_over(self._tracker, scaled, box)
        except ValueError:
            return None
        return tracker

    def _take(self, frame: PastFrame, estimate: Estimate | None) -> None:
        self._estimate = estimate
        self._clock.take(frame.stamp)
        self._followed_until = frame.stamp
        self.history.add(frame.image, frame.stamp)


def _box_in(image: NDArray[np.generic], first: _FirstBox) -> Box:
    """The box that a target was drawn with, scaled to an image of the same aspect ratio."""
    if not is_scaled(first.image_size, size_of(image)):
        return first.box
    return scaled_box(first.box, first.image_size, size_of(image))


def _frames_of(requested: _RequestedTarget, frame: Frame, history: FrameHistory) -> list[PastFrame]:
    """The frame that the target was drawn on and those since, the last being this one.

    Where they are too many, those in between are thinned out evenly.
    """
    if requested.stamp in (0, frame.stamp) or frame.stamp == 0:
        return [frame]
    kept = [past for past in history.since(requested.stamp) if past.stamp < frame.stamp]
    if kept and kept[0].size != frame.size:
        raise ValueError(
            f"it was drawn on an image of {size_text(kept[0].size)} px, and they have "
            f"{size_text(frame.size)} px now; allowed: a target on one of these, or stamp 0 "
            "for the next frame"
        )
    frames = [*kept, frame]
    reach = (frame.stamp - frames[0].stamp) / NANOSECONDS
    behind = frames[0].stamp - requested.stamp
    # What was dropped before time went back says nothing of the frames since.
    is_dropped = requested.stamp <= history.dropped_until < frame.stamp
    if behind > _SUBSTITUTE_WITHIN or is_dropped:
        raise _OfLongAgoError(
            f"it was drawn on a frame from {behind / NANOSECONDS:.3f} s before the oldest one "
            f"here; allowed: one of the last {counted(len(kept) + 1, 'frame')}, back to "
            f"{reach:.3f} s ago (parameters 'history_frames' and 'history_megabytes'), or "
            "stamp 0 for the next one"
        )
    steps = min(len(frames) - 1, _MOST_CAUGHT_UP)
    chosen = np.linspace(0, len(frames) - 1, steps + 1).round().astype(int)
    return [frames[index] for index in chosen]
