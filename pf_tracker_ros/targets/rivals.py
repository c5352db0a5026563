"""What looks like a target beside it, and is none: followed too, so that both can be told apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import as_box, is_cut, overlaps
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.association import CENTER_SPREAD
from pf_tracker_ros.targets.course import Course
from pf_tracker_ros.targets.lifecycle import Initiator
from pf_tracker_ros.targets.tracks import Crowd, Glimpse, Key, Life
from pf_tracker_ros.tracking.state_operations import StateOperations

# Seconds for which it is seen, so that it is no flicker, and how far it may be from where it was
# expected, in its sides.
_SHOWN_FOR, _NEAR = 0.1, 0.5
# What overlaps a target by more than this is part of it.
_APART_BELOW = 0.3
# What overlaps another target by more than this is that one.
_SAME_ABOVE = 0.5
# Two that will be within half a side of each other in so many seconds may be taken for each other.
_MEET, _SOON = 0.5, 1.0
# Farther from its target, in its own sides, it is not taken for it.
_FAR = 2.0
# Seconds for which one is carried on that is not seen because its target is in front of it or
# behind it, within so many sides; one that should be seen then ends so many times faster.
_UNSEEN_FOR, _BESIDE, _FASTER = 2.0, 0.7, 6.0
# At a time.
_MOST = 2
# Their places among what begins in a frame are above those of detections.
_FIRST_PLACE = 1_000_000


class Rivals:
    """Starts, moves and ends rivals: targets that nobody asked for and that are not told.

    A target that walks past its like could leave with it. So what looks like a target beside it is
    a target as well, as soon as the two are about to cross: it explains its own pixels, and a
    detection of it is not taken for that of the other one. It costs next to nothing: its course
    leads it, and what the other one, which it looks like, sees of it in its own search corrects
    that. The first detection makes it a target like others; until then it ends once it is far from
    the other one, or not seen.

    Args:
        initiator: Begins them.
        operations: Moves them.
    """

    def __init__(self, initiator: Initiator, operations: StateOperations) -> None:
        self._initiator = initiator
        self._operations = operations

    def start(self, crowd: Crowd, frame: Frame, interval: float, *, is_seen: bool) -> Crowd:
        """The crowd with what was seen beside the targets for a moment.

        Args:
            crowd: In this frame.
            frame: At hand.
            interval: Seconds since the last one.
            is_seen: Whether a detector saw the frame: then it is that which tells what is there.
        """
        lives = [_glimpsed(life, interval) for life in crowd.lives]
        if is_seen:
            return replace(crowd, lives=tuple(lives))
        rivals = sum(life.is_rival for life in lives)
        for host in tuple(lives):
            glimpse = host.glimpse
            if glimpse is None or glimpse.seconds < _SHOWN_FOR or not host.is_told:
                continue
            if rivals >= _MOST:
                break
            others = np.array([life.box for life in lives])
            is_part = overlaps(glimpse.box[None], others).max() > _APART_BELOW
            if is_part or is_cut(glimpse.box, frame.size) or not _will_meet(host, glimpse):
                continue
            key = Key(crowd.frame, _FIRST_PLACE + rivals)
            life = self._initiator.begin_rival(frame, glimpse.box, key, host)
            lives.append(replace(life, course=glimpse.course))
            rivals += 1
        return replace(crowd, lives=tuple(lives))

    def move(self, crowd: Crowd, interval: float) -> Crowd:
        """The crowd with the rivals where they are seen, without those of no use any more.

        Args:
            crowd: In this frame.
            interval: Seconds since the last one.
        """
        targets = {life.key: life for life in crowd.lives if not life.is_rival}
        if len(targets) == len(crowd.lives):
            return crowd
        lives: list[Life] = []
        for life in crowd.lives:
            if not life.host:
                lives.append(life)
            elif life.host in targets:
                host = targets[life.host]
                rival = self._moved(life, host, interval)
                if _is_of_use(rival, host, [one for one in targets.values() if one is not host]):
                    lives.append(rival)
        return replace(crowd, lives=tuple(lives))

    def _moved(self, rival: Life, host: Life, interval: float) -> Life:
        """A rival where its course takes it, corrected by what its host sees of it."""
        course, seen, unseen_for = rival.course, host.target.distractor_box, 0.0
        if seen is not None and _are_within(rival.expected, seen, _NEAR):
            center, deviation = seen[:2] + seen[2:] / 2, CENTER_SPREAD * seen[2:]
            course = course.correct(center, deviation)
        else:
            is_visible = not host.is_hidden and not _are_within(rival.expected, host.box, _BESIDE)
            unseen_for = rival.unseen_for + interval * (_FASTER if is_visible else 1.0)
        rival = replace(
            rival, course=course, age=rival.age + interval, glimpse=None, unseen_for=unseen_for
        )
        target = self._operations.move_to(rival.target, as_box(rival.expected))
        return replace(rival, target=target)


def _glimpsed(life: Life, interval: float) -> Life:
    """A target with what was seen beside it lately, this frame included."""
    box, before = life.target.distractor_box, life.glimpse
    if box is None or life.is_rival or life.is_hidden:
        return life if before is None else replace(life, glimpse=None)
    center, deviation = box[:2] + box[2:] / 2, CENTER_SPREAD * box[2:]
    if before is not None:
        course = before.course.predict(interval, box[3])
        if (np.abs(course.center - center) < _NEAR * box[2:]).all():
            course = course.correct(center, deviation)
            return replace(life, glimpse=Glimpse(box, course, before.seconds + interval))
    return replace(life, glimpse=Glimpse(box, Course.begin(box, deviation), 0.0))


def _will_meet(host: Life, glimpse: Glimpse) -> bool:
    """Whether a target and what was seen beside it are about to cross."""
    apart = glimpse.course.center - host.course.center
    speed = glimpse.course.velocity - host.course.velocity
    when = np.clip(-(apart @ speed) / np.maximum(speed @ speed, 1e-9), 0.0, _SOON)
    return bool((np.abs(apart + when * speed) < _MEET * glimpse.box[2:]).all())


def _is_of_use(rival: Life, host: Life, others: Sequence[Life]) -> bool:
    """Whether a rival may be seen near its host, and is none of the other targets."""
    if rival.unseen_for > _UNSEEN_FOR or not _are_within(rival.box, host.box, _FAR):
        return False
    boxes = np.array([one.box for one in others]).reshape(-1, 4)
    return bool(overlaps(rival.box[None], boxes).max(initial=0.0) <= _SAME_ABOVE)


def _are_within(one: NDArray[np.float64], other: NDArray[np.float64], sides: float) -> bool:
    """Whether the centers of two (4,) boxes are within so many sides of the first one."""
    apart = np.abs(other[:2] + other[2:] / 2 - one[:2] - one[2:] / 2)
    return bool((apart < sides * one[2:]).all())
