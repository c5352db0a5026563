"""What happens to each frame where several targets are followed, and to what is said of frames.

Knows stamps and arrays, not messages; see `pf_tracker_ros.tracking.session` for a single target.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.parameters import build
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.detections import Detections
from pf_tracker_ros.targets.history import History
from pf_tracker_ros.targets.multi_tracker import MultiTracker
from pf_tracker_ros.targets.parameters import MultiTrackerParameters
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.tracking.frame_order import LONGEST_WAIT, FrameOrder, TimePolicy
from pf_tracker_ros.tracking.scaling import is_scaled, scaled_box, size_of
from pf_tracker_ros.tracking.session import FrameOutcome

# Answers of detectors that wait for their frames; the oldest beyond are dropped.
MOST_ANSWERS = 20
# So many images in a row that fit no target of a detector's: the camera is another one.
_MOST_MISFITS = 10
# A target drawn on an image that was refused begins on one so much later, nanoseconds.
_SUBSTITUTE_WITHIN = NANOSECONDS
# A detector is ahead of the images by at most that many nanoseconds, or two images if that is more.
_AHEAD_WITHIN = NANOSECONDS // 2


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


class _Drawn(NamedTuple):
    """A target that somebody drew.

    Attributes:
        box: Pixels.
        label: What it is.
        stamp: Of the frame that it was drawn on, 0 for the next one.
        on_misfits: Whether the image before was refused, since it fits no target.
        image_size: (width, height) of that frame, pixels; None before it began.
    """

    box: Box
    label: str
    stamp: int
    on_misfits: bool = False
    image_size: tuple[int, int] | None = None


class _Answer(NamedTuple):
    """What a detector said of the frame with a stamp, 0 for the next one."""

    stamp: int
    detections: Detections


class _Jump(NamedTuple):
    """Time that went back.

    Attributes:
        last: Stamp of the last frame before.
        first: Stamp of the first frame since.
        ahead: Nanoseconds by which a detector may be ahead of the images.
    """

    last: int
    first: int
    ahead: int

    def is_before(self, stamp: int, now: int) -> bool:
        """Whether a frame that has not come is rather one from before time went back.

        Until the old time is reached, a stamp ahead is of a frame of then, told late, or of one to
        come, told early; whichever is less is meant, and nothing is told that early.

        Args:
            stamp: Of the frame.
            now: Stamp of the last frame that came.
        """
        early, beyond = stamp - now, stamp - self.last
        if early <= 0 or now >= self.last or beyond > self.ahead:
            return False
        late = abs(beyond) + now - self.first
        return early > min(late, self.ahead)


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
        self._requested: list[_Drawn] = []
        self._drawn: dict[int, _Drawn] = {}
        self._answers: list[_Answer] = []
        self._dropped_answers = 0
        self._order = FrameOrder()
        self._jump: _Jump | None = None
        self._interval = 0.0
        # Stamps between which no frame was looked at, up to and with the later one.
        self._passed = (0, 0)
        # Of the last image that was accepted, in words.
        self._kind = ""
        # Images in a row that were refused, and the earliest of their stamps.
        self._misfits = self._misfits_since = 0
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
                targets as there may be.
        """
        self._check_clock(stamp)
        others = 0 if self._misfits else len(self.targets)
        self._check_room(others + len(self._requested))
        self._requested.append(_Drawn(box, label, stamp, self._misfits > 0))

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
        self._check_clock(stamp)
        behind = self._order.seen - stamp
        if stamp and self._order.seen and behind > LONGEST_WAIT:
            raise ValueError(
                f"its stamp is {behind / NANOSECONDS:.0f} s before that of the last frame, from "
                "another clock; allowed: the stamp of the frame that the detector saw, or 0 for "
                "the next one"
            )
        after, until = self._passed
        if after < stamp <= until:
            return
        self._answers.append(_Answer(stamp, detections))
        if len(self._answers) > MOST_ANSWERS:
            del self._answers[0]
            self._dropped_answers += 1

    def _check_clock(self, stamp: int) -> None:
        """Refuse what is said of a frame that cannot come.

        Raises:
            ValueError: The stamp is by another clock than those of the frames.
        """
        now = self._order.seen
        if self._jump and 0 not in (stamp, now) and self._jump.is_before(stamp, now):
            raise ValueError(
                f"its stamp is {(stamp - now) / NANOSECONDS:.3f} s after that of the last frame, "
                "of a frame from before time went back; allowed: the stamp of a frame since, or 0 "
                "for the next one"
            )
        self._order.check_ahead(stamp)

    def pass_over(self, stamp: int) -> None:
        """Let the clock go on with a frame that is not looked at, as while there is a pause.

        What detectors say of it, and have said of those before, counts nowhere.

        Args:
            stamp: Of the frame.
        """
        self._order.pass_over(stamp)
        self._passed = (self._order.last, stamp)
        self._answers = [one for one in self._answers if not _is_due(one.stamp, stamp)]

    def stop(self) -> None:
        """Forget all targets, requested ones, and what detectors have said so far."""
        self.withdraw()
        self._answers, self._drawn, self._checked = [], {}, None
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
        """Take one frame, and read its image unless the stamp alone tells that it is dropped.

        Args:
            read: Gives the image, as for `process`.
            stamp: When it was taken.

        Returns:
            What became of it.

        Raises:
            ValueError: As `process`.
            Exception: Whatever `read` raises; the targets are kept.
        """
        behind = (self._order.last - stamp) / NANOSECONDS
        place = self._order.place(stamp, self.time_policy.late_within)
        if place in ("duplicate", "late"):
            self._checked = None
            return MultiOutcome(place, self.targets)
        image = read()
        self._checked = None
        if place == "jump":
            return self._jump_back(image, stamp, behind)
        known = 0 not in (stamp, self._order.last)
        return self._track(image, stamp, -behind if known else None)

    def _jump_back(self, image: NDArray[np.generic], stamp: int, seconds: float) -> MultiOutcome:
        """Go on in a time that began anew, without what waits for frames of the old one."""
        policy = self.time_policy.on_jump
        # Until an image is accepted, each is the first after the jump: of those, targets may wait.
        waiting = [one for one in self._requested if one.stamp == 0 or self._misfits]
        if len(waiting) < len(self._requested):
            self._refused.append(
                "target refused: it was drawn on a frame from before time went back; draw it again"
            )
        ahead = max(_AHEAD_WITHIN, round(2 * self._interval * NANOSECONDS))
        self._jump, self._passed = _Jump(self._order.last, stamp, ahead), (0, 0)
        if policy == "keep":
            self._answers = []
            self._tracker.forget_past()
        else:
            drawn = [*self._drawn.values()] if policy == "restart" else []
            self.stop()
            waiting = [
                *(_Drawn(_box_in(image, one), one.label, 0) for one in drawn),
                *waiting,
            ]
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
        due = [one for one in self._answers if _is_due(one.stamp, stamp)]
        answers = [_aged(one, stamp) for one in due]
        self._tracker.update(image, interval, answers)
        self._order.take(stamp)
        self._interval = interval or self._interval
        self._kind = f"{image.shape} {image.dtype}"
        self._answers = [one for one in self._answers if one not in due]
        started = self._start_requested(image, stamp)
        refused, self._refused = self._refused, []
        ended, self._ended = self._ended, []
        kept = {target.id for target in self.targets}
        self._drawn = {id: drawn for id, drawn in self._drawn.items() if id in kept}
        frame: FrameOutcome = "tracked" if self.targets else "waiting"
        return MultiOutcome(
            "started" if started else frame,
            self.targets,
            tuple(started),
            tuple(refused),
            tuple(ended),
            (*self._tracker.left_out, *self._told_of_dropped()),
            jumped_back,
        )

    def _start_requested(self, image: NDArray[np.generic], stamp: int) -> list[int]:
        """Start what was asked for on frames up to this one; the ids."""
        due = [one for one in self._requested if _is_due(one.stamp, stamp)]
        self._requested = [one for one in self._requested if one not in due]
        started: list[int] = []
        for drawn in due:
            age = 0.0 if 0 in (drawn.stamp, stamp) else (stamp - drawn.stamp) / NANOSECONDS
            try:
                self._check_room(len(self.targets))
                id = self._tracker.start_earlier(drawn.box, age, drawn.label)
            except ValueError as error:
                self._refused.append(f"target refused: {error}")
            else:
                started.append(id)
                self._drawn[id] = drawn._replace(image_size=size_of(image))
        return started

    def _check_room(self, count: int) -> None:
        """Refuse one more target where there are as many as there may be, or more.

        Args:
            count: Targets that there are, or that are to begin before it.
        """
        most = self._tracker.parameters["targets.most"]
        if count == most:
            raise ValueError(f"there are {most} targets, as many as there may be; stop one first")
        if count > most:
            raise ValueError(
                f"there are {count} targets, and there may be {most}; stop {count - most + 1} first"
            )

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
            self._misfits = 0
            return False
        if self._tracker.resize(image):
            self._misfits = 0
            self._tell_unseen()
            return False
        since = min(self._misfits_since, stamp) if self._misfits else stamp
        self._misfits, self._misfits_since = self._misfits + 1, since
        is_drawn_on = any(self._is_of_misfits(one, stamp) for one in self._requested)
        if self.targets and not is_drawn_on and (self._drawn or self._misfits < _MOST_MISFITS):
            raise ValueError(
                f"image is {image.shape} {image.dtype}, but those that the targets were followed "
                f"in were {self._kind}"
            )
        if is_drawn_on:
            self._begin_on_misfits(stamp)
        self._tracker.forget_camera()
        self._answers, self._misfits = [], 0
        return True

    def _is_of_misfits(self, drawn: _Drawn, stamp: int) -> bool:
        """Whether a target was drawn on an image that was refused, up to that with a stamp."""
        if drawn.stamp == 0:
            return drawn.on_misfits
        return self._misfits_since <= drawn.stamp and _is_due(drawn.stamp, stamp)

    def _begin_on_misfits(self, stamp: int) -> None:
        """Let what was drawn on images that were refused begin on this one instead, if soon."""
        for place, one in enumerate(self._requested):
            if self._is_of_misfits(one, stamp) and stamp - one.stamp <= _SUBSTITUTE_WITHIN:
                self._requested[place] = one._replace(stamp=0)
        if self.targets:
            names = ", ".join(str(target.id) for target in self.targets)
            self._ended.append(
                f"ended: {names}; a target was drawn on images of another size or kind, and all "
                "begins anew with them"
            )

    def _tell_unseen(self) -> None:
        """Tell of targets that somebody drew and that could not be learned in another size."""
        there = {target.id for target in self.targets}
        unseen = [str(id) for id in self._drawn if id not in there]
        if unseen:
            self._ended.append(
                f"ended: {', '.join(unseen)}; the images changed their size while it was not seen "
                "in any of the frames that are kept; draw it again where it comes back"
            )

    def _told_of_dropped(self) -> list[str]:
        count, self._dropped_answers = self._dropped_answers, 0
        if not count:
            return []
        return [
            f"{count} of the detector's answers left out: {MOST_ANSWERS} at most wait for a frame; "
            "let frames come, and the detector give each the stamp of the image that it saw"
        ]


def _is_due(said_of: int, stamp: int) -> bool:
    """Whether what was said of a frame counts with the one at hand."""
    return stamp == 0 or said_of <= stamp


def _aged(answer: _Answer, stamp: int) -> Detections:
    """Detections with their age in the frame at hand."""
    age = 0.0 if 0 in (answer.stamp, stamp) else (stamp - answer.stamp) / NANOSECONDS
    given = answer.detections
    return Detections(given.boxes, given.scores, given.labels, age)


def _box_in(image: NDArray[np.generic], drawn: _Drawn) -> Box:
    """The box that a target was drawn with, scaled to an image of the same aspect ratio."""
    size = drawn.image_size
    if size is None or not is_scaled(size, size_of(image)):
        return drawn.box
    return scaled_box(drawn.box, size, size_of(image))
