"""What looks like a target beside it, and is none: followed too, so that both can be told apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.targets.associator import CENTER_SPREAD
from pf_tracker_ros.targets.course import Course
from pf_tracker_ros.targets.crowd import Crowd
from pf_tracker_ros.targets.geometry import overlaps
from pf_tracker_ros.targets.initiator import Initiator, is_cut
from pf_tracker_ros.targets.life import Glimpse, Key, Life

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
# Seconds for which one that is hidden is carried on.
_HIDDEN_FOR = 2.0
# Each costs as much as a target.
_MOST = 2
# Their places among what begins in a frame are above those of detections.
_FIRST_PLACE = 1_000_000


class Rivals:
    """Starts and ends rivals: targets that nobody asked for and that are not told.

    A target that walks past its like could leave with it. So what looks like a target beside it is
    followed as well, as soon as the two are about to cross: then it explains its own pixels, and a
    detection of it is not taken for the target's. The first detection makes it a target like
    others; until then it ends once it is far from its target, or not seen.

    Args:
        initiator: Begins them.
        most: Targets at a time, rivals too.
        lost_after: Seconds for which targets count as hidden at most.
    """

    def __init__(self, initiator: Initiator, most: int, lost_after: float) -> None:
        self._initiator = initiator
        self._most = most
        self._hidden_for = min(_HIDDEN_FOR, lost_after)

    def start(self, crowd: Crowd, frame: Frame, interval: float, *, is_seen: bool) -> Crowd:
        """The crowd with what was seen beside the targets in several frames.

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
            if rivals >= _MOST or len(lives) >= self._most:
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

    def end(self, crowd: Crowd) -> Crowd:
        """The crowd without the rivals that are of no use any more."""
        targets = [life for life in crowd.lives if not life.is_rival]
        if len(targets) == len(crowd.lives):
            return crowd
        lives = tuple(
            life for life in crowd.lives if not life.is_rival or self._is_of_use(life, targets)
        )
        return replace(crowd, lives=lives)

    def _is_of_use(self, life: Life, targets: Sequence[Life]) -> bool:
        """Whether a rival is seen, or hidden for a while, near its target and on no other one."""
        box, track = life.box, life.target.track
        is_carried_on = life.is_hidden and track.hidden_for < self._hidden_for
        if track.state != "tracking" and not is_carried_on:
            return False
        boxes = np.array([one.box for one in targets]).reshape(-1, 4)
        is_host = np.array([one.key == life.host for one in targets], dtype=bool)
        if overlaps(box[None], boxes[~is_host]).max(initial=0.0) > _SAME_ABOVE:
            return False
        apart = np.abs(boxes[:, :2] + boxes[:, 2:] / 2 - box[:2] - box[2:] / 2)
        return bool((is_host & (apart < _FAR * box[2:]).all(axis=1)).any())


def _glimpsed(life: Life, interval: float) -> Life:
    """A target with what was seen beside it lately, this frame included."""
    box, before = life.target.rival, life.glimpse
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
