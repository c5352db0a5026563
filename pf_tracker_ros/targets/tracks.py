"""Tracks: what is known of each target beside the filter, all of them after a frame, their ids.

A track (`Life`) is a value: where it came from, what speaks for it, what it has been called. All of
a frame are one value, too (`Crowd`), so that the past can be processed again. Ids count from 1 in
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
from pf_tracker_ros.boxes import Box, overlaps
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.course import Course
from pf_tracker_ros.tracking.filter_state import FilterState

# How far a target usually is from its own descriptor, before it is known, and how many detections
# that is worth.
USUALLY_VARIES, _PRIOR_VIEWS = 0.12, 10
# Detections that a descriptor, and how much it varies, are averages of; the least that it varies.
_VIEWS, _LEAST_VARIES = 30, 0.02
# Labels of a target that are counted.
_MOST_LABELS = 10
# Least share of a detection's descriptor in that of its target.
_RATE = 0.05


class Key(NamedTuple):
    """Names a target for good, even where what happened since is worked out again.

    Attributes:
        frame: Number of the frame that it began in.
        place: Among those that began there: from 0 up by a detection, from -1 down by hand; for
            rivals from 1,000,000 up.
    """

    frame: int
    place: int


class Glimpse(NamedTuple):
    """What looks like a target beside it.

    Attributes:
        box: (4,) in the last frame, pixels.
        course: Where it goes.
        seconds: From the first to the last of the frames in a row that showed it.
    """

    box: NDArray[np.float64]
    course: Course
    seconds: float


@dataclass(frozen=True, eq=False)
class Life:
    """A target, and what is known of it beside its place and its templates; a value.

    Attributes:
        key: Its name for good.
        target: As the filter follows it.
        descriptor: Of its appearance, as far as confirmed.
        varies: How far its detections usually are from that, 0 to 1.
        views: Detections that both were made of.
        course: Where it goes.
        log_size: (2,) logarithms of its width and height, smoothed over the detections.
        belief: Logarithm of the odds that there is such a target.
        votes: Label to the sum of the scores with which it was given.
        age: Seconds since it began.
        confirmations: Detections that were taken for it, the first one too.
        unconfirmed_for: Seconds since the last of them.
        learned_for: Seconds since it was learned anew.
        is_confirmed: Whether it was confirmed often enough to be told.
        is_hidden: Whether another target is in front of it.
        is_doubled: Whether its box, then, is as good as that of the other one.
        is_doubted: Whether it may be another one by now, which it was seen beside.
        host: The target that it looks like and is beside of, where only that is known of it: a
            rival, which is followed to be told apart, and not told. None for all others.
        unseen_for: Seconds for which a rival was not seen; more where it should have been.
        glimpse: What looks like it beside it; None where nothing does.
        gone_for: Seconds since it ended; None while it is followed.
        stood: (4,) box that somebody or the detector last told of it whole, pixels; None where
            nobody did, or the camera has moved since.
    """

    key: Key
    target: FilterState
    descriptor: Descriptor
    course: Course
    log_size: NDArray[np.float64]
    belief: float
    varies: float = USUALLY_VARIES
    views: int = 1
    votes: Mapping[str, float] = field(default_factory=dict)
    age: float = 0.0
    confirmations: int = 1
    unconfirmed_for: float = 0.0
    learned_for: float = 0.0
    is_confirmed: bool = False
    is_hidden: bool = False
    is_doubled: bool = False
    is_doubted: bool = False
    host: Key | None = None
    unseen_for: float = 0.0
    glimpse: Glimpse | None = None
    gone_for: float | None = None
    stood: NDArray[np.float64] | None = None

    @property
    def by_hand(self) -> bool:
        """Whether somebody asked for it, so that only they end it."""
        return self.key.place < 0

    @property
    def is_on_its_own(self) -> bool:
        """Whether nobody has told of it since somebody asked for it: no detector knows it."""
        return self.by_hand and self.confirmations == 1

    @property
    def is_rival(self) -> bool:
        """Whether it is only known to look like another."""
        return self.host is not None

    @property
    def label(self) -> str:
        """What it was called most."""
        return max(self.votes, key=lambda label: self.votes[label], default="")

    @property
    def box(self) -> NDArray[np.float64]:
        """(4,) as the last frame left it, pixels."""
        return np.array(self.target.estimate.box)

    @property
    def expected(self) -> NDArray[np.float64]:
        """(4,) box where its course is, pixels."""
        size = self.box[2:]
        return np.concatenate([self.course.center - size / 2, size])

    def carried(self, camera_motion: NDArray[np.float64]) -> Life:
        """The same after the camera has moved: courses are those through the scene.

        Its particles stay: they look for it in the image, near where its course leads, and
        its box has a size of its own, since the scene is not as far away as it is.

        Args:
            camera_motion: (3, 3), see `EgoMotion.follow`.
        """
        glimpse = self.glimpse
        if glimpse:
            glimpse = glimpse._replace(course=glimpse.course.carry(camera_motion))
        course = self.course.carry(camera_motion)
        return replace(self, course=course, glimpse=glimpse, stood=None)

    def predicted(self, interval: float) -> Life:
        """The same, with its course so many seconds later."""
        return replace(self, course=self.course.predict(interval, self.box[3]))

    @property
    def is_told(self) -> bool:
        """Whether it is sure enough, and seen well enough, to be told."""
        is_seen = self.belief > 0.0 and self.target.estimate.state != "lost"
        is_seen = is_seen and not (self.is_doubled or self.is_rival)
        return self.by_hand or (self.is_confirmed and is_seen)

    def voted(self, label: str, score: float) -> Life:
        """The same, called by a label once more; without one, nothing is said."""
        if not label:
            return self
        votes = {**self.votes, label: self.votes.get(label, 0.0) + score}
        if len(votes) > _MOST_LABELS:
            # The newest one stays, or no other could ever win.
            least = min((one for one in votes if one != label), key=lambda one: votes[one])
            del votes[least]
        return replace(self, votes=votes)

    def described(self, frame: Frame, box: Box, appearance: Appearance) -> Life:
        """The same, described anew by what is in its box."""
        (descriptor,) = appearance.extract(frame, np.array([box]))
        return replace(self, descriptor=descriptor, varies=USUALLY_VARIES, views=1)

    def viewed(self, seen: Descriptor, appearance: Appearance) -> Life:
        """The same, seen once more alone."""
        views = self.views + 1
        rate = 1.0 / min(views + _PRIOR_VIEWS, _VIEWS)
        differs = max(float(appearance.distance(self.descriptor, seen[None])[0]), _LEAST_VARIES)
        return replace(
            self,
            descriptor=appearance.blend(self.descriptor, seen, max(1.0 / views, _RATE)),
            varies=self.varies + rate * (differs - self.varies),
            views=views,
        )


SAME_ABOVE = 0.5
"""A target that a late detection has started is the one that was there before if they overlap by
more than this."""


@dataclass(frozen=True, eq=False)
class Crowd:
    """All targets after a frame, a value.

    Attributes:
        frame: Number of that frame.
        lives: The targets that are followed, told or not.
        gone: Those that have ended and are remembered.
        idle_for: Seconds since the detector saw a frame.
        rhythm: Seconds between the last two frames that it saw; infinite before the second.
    """

    frame: int = 0
    lives: tuple[Life, ...] = ()
    gone: tuple[Life, ...] = ()
    idle_for: float = math.inf
    rhythm: float = math.inf

    @property
    def is_heard(self) -> bool:
        """Whether a detector has ever said something."""
        return self.idle_for < math.inf

    @property
    def boxes(self) -> list[Box]:
        """Where the targets are, pixels."""
        return [life.target.estimate.box for life in self.lives]

    def carried(self, camera_motion: NDArray[np.float64]) -> Crowd:
        """The same after the camera has moved, see `Life.carried`."""
        return replace(
            self,
            lives=tuple(life.carried(camera_motion) for life in self.lives),
            gone=tuple(life.carried(camera_motion) for life in self.gone),
        )

    def without(self, stopped: Life) -> Crowd:
        """The same, without one of them, followed or gone.

        Where a late detection has started another one in its place, without that.

        Args:
            stopped: As it was when it was to be forgotten.
        """
        everybody = (*self.lives, *self.gone)
        key = stopped.key
        if all(one.key != key for one in everybody):
            key = _in_place_of(stopped, everybody)
        return replace(
            self,
            lives=tuple(one for one in self.lives if one.key != key),
            gone=tuple(one for one in self.gone if one.key != key),
        )


def _in_place_of(stopped: Life, others: Sequence[Life]) -> Key:
    """The key of the target that a detector started where another one was; else that one's own."""
    started = [one for one in others if not one.by_hand]
    if not started:
        return stopped.key
    same = overlaps(stopped.box[None], np.array([one.box for one in started]))[0]
    best = int(same.argmax())
    return started[best].key if same[best] > SAME_ABOVE else stopped.key


# Names of targets that are remembered beyond those that there are.
_MOST_NAMES = 10_000


class Names:
    """Key of a target to its id."""

    def __init__(self) -> None:
        self._ids: dict[Key, int] = {}
        self._last = 0

    def __contains__(self, key: Key) -> bool:
        return key in self._ids

    def __getitem__(self, key: Key) -> int:
        return self._ids[key]

    def get(self, key: Key) -> int | None:
        """The id of a target, None while it has none."""
        return self._ids.get(key)

    def name(self, life: Life) -> int:
        """The id of a target, which gets one if it has none."""
        if life.key not in self._ids:
            self._last += 1
            self._ids[life.key] = self._last
        return self._ids[life.key]

    def told(self, lives: Sequence[Life]) -> dict[int, Life]:
        """Id to target, of those that are told."""
        return {self._ids[life.key]: life for life in lives if life.is_told and life.key in self}

    def next_by_hand(self, frame: int) -> Key:
        """A key for a target that is asked for in a frame."""
        places = (key.place for key in self._ids if key.frame == frame)
        # Not by their number: one that was taken over has left its place.
        return Key(frame, min(0, min(places, default=0)) - 1)

    def hand_over(self, before: Sequence[Key], now: Key) -> None:
        """Let a target be called as the first of some that it takes over, which are no more."""
        names = [name for key in before if (name := self._ids.pop(key, None)) is not None]
        if names:
            self._ids[now] = names[0]

    def pass_on(self, told: Mapping[int, Life], crowd: Crowd) -> None:
        """Let targets that took the places of others, when those were worked out again, be them.

        Args:
            told: Id to target, as told before.
            crowd: As worked out again.
        """
        there = {life.key for life in (*crowd.lives, *crowd.gone)}
        lost = [(name, life) for name, life in told.items() if life.key not in there]
        for life in crowd.lives:
            if not lost or not life.is_told or life.key in self._ids:
                continue
            same = overlaps(life.box[None], np.array([one.box for _, one in lost]))[0]
            best = int(same.argmax())
            if same[best] > SAME_ABOVE:
                name, before = lost.pop(best)
                # Worked out once more, that one may be back, as another one.
                del self._ids[before.key]
                self._ids[life.key] = name

    def forget(self, crowd: Crowd, oldest: int) -> None:
        """Forget those that no frame can bring back.

        Args:
            crowd: All targets that there are.
            oldest: Number of the oldest frame that may be worked out again.
        """
        if len(self._ids) > _MOST_NAMES:
            there = {life.key for life in (*crowd.lives, *crowd.gone)}
            self._ids = {
                key: name for key, name in self._ids.items() if key in there or key.frame >= oldest
            }
