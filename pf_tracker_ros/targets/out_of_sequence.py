"""Out-of-sequence measurements: late detections, and targets that were drawn on an earlier frame.

1. The frame that a late measurement is of is found in the frame buffer by its stamp.
2. The targets are those that were there before that frame.
3. It and all frames since are processed again, with what is known of them now.

A late measurement so has the effect that it would have had in time; it costs the frames since.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pf_tracker_ros.boxes import overlaps
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.detections import DOUBLED_ABOVE, Detections, Sighting
from pf_tracker_ros.targets.frame_buffer import FrameBuffer, Moment
from pf_tracker_ros.targets.keeper import CrowdKeeper
from pf_tracker_ros.targets.tracks import Crowd, Life

# How late a detection may be, in nanoseconds.
_LATEST = 2 * NANOSECONDS
# Nanoseconds that a detector takes at most. What it says of that time before the first frame is no
# fault: it was there before the tracker.
_SLOWEST = 5 * NANOSECONDS
# Before the first frame of all there is none that could be nearer than by so much.
_NEAR_FIRST = NANOSECONDS // 50
# What counts of detections in a frame, None where they say nothing of it; why others do not.
Looker = Callable[[Detections, Frame], tuple[tuple[Sighting, ...] | None, list[str]]]


class StampedDetections(NamedTuple):
    """What a detector found in the frame with a stamp, nanoseconds; 0 for the one at hand."""

    stamp: int
    detections: Detections


def insert_late(
    buffer: FrameBuffer, late: Sequence[StampedDetections], now: int, look: Looker
) -> tuple[list[Moment], list[str]]:
    """The moments from the oldest on that late detections are of, with these in them.

    Args:
        buffer: The frames so far.
        late: Of earlier frames than the one at hand.
        now: Stamp of the frame at hand, nanoseconds.
        look: Tells what counts of detections.

    Returns:
        The moments, to be processed again, and what was left out.
    """
    moments: list[Moment] = []
    left_out: list[str] = []
    for stamp, detections in sorted(late, key=lambda one: one.stamp):
        since = moments_since(buffer, stamp) if now - stamp <= _LATEST else []
        if not since:
            oldest = max(buffer.first.stamp, now - _LATEST) if len(buffer) else now
            early = buffer.first.stamp - stamp if len(buffer) else 0
            if not (buffer.is_whole and _NEAR_FIRST < early < _SLOWEST):
                left_out.append(
                    f"the detections are {(now - stamp) / NANOSECONDS:.3g} s old, and frames of "
                    f"the last {(now - oldest) / NANOSECONDS:.2g} s are kept"
                )
            continue
        moments = moments or since
        place = len(moments) - len(since)
        moment = moments[place]
        seen, reasons = look(detections, moment.frame)
        moments[place] = replace(moment, seen=merged(moment.seen, seen))
        left_out += reasons
    return moments, left_out


def moments_since(buffer: FrameBuffer, stamp: int) -> list[Moment]:
    """The moments from the one on that a stamp is of; none where that is not kept.

    Args:
        buffer: The frames so far.
        stamp: Of the frame that a detector saw, nanoseconds; up to half an interval off.
    """
    since = buffer.since(stamp)
    if not since:
        return buffer.moments[-1:]
    early = since[0].stamp - stamp
    allowed = round(since[0].interval * NANOSECONDS / 2)
    if buffer.is_whole and since[0] is buffer.first:
        allowed = max(allowed, _NEAR_FIRST)
    return since if early <= allowed else []


def reprocess(keeper: CrowdKeeper, moments: Sequence[Moment]) -> tuple[Crowd, list[Moment]]:
    """What moments make of the targets that there were before the first of them.

    Args:
        keeper: Makes the crowd of a frame out of the one before.
        moments: One after the other, at least one.

    Returns:
        The targets after the last, and the moments, each with the targets before it.
    """
    crowd = moments[0].before
    revised = []
    for moment in moments:
        revised.append(replace(moment, before=crowd))
        crowd = keeper.advance(crowd, moment.frame, moment.interval, moment.seen)
        crowd = keeper.initiator.join(crowd, moment.begun)
        for life in moment.stopped:
            crowd = crowd.without(life)
    return crowd, revised


def replay_track(
    keeper: CrowdKeeper, life: Life, moments: Sequence[Moment], taken_over: Sequence[Life] = ()
) -> tuple[Life, list[Moment]]:
    """Take a target that began in a moment through those since, which it joins.

    It is followed by itself: the others were there before it. What looks like it beside it helps to
    tell it apart and does not join them, since it may be one of them; for the same reason, it is
    not looked for elsewhere.

    Args:
        keeper: Makes the crowd of a frame out of the one before.
        life: Began in the first moment.
        moments: That one and those since.
        taken_over: Those in whose place it is from the first moment on.

    Returns:
        The target after the last, and the moments with it.
    """
    first, *others = moments
    alone = Crowd(frame=life.key.frame, lives=(life,), idle_for=0.0)
    keys = {one.key for one in taken_over}
    begun = (one for one in first.begun if one.key not in keys)
    # What only looks like a target, nobody would miss.
    stopped = (*first.stopped, *(one for one in taken_over if not one.is_rival))
    revised = [replace(first, begun=(*begun, life), stopped=stopped)]
    for moment in others:
        there = (one for one in moment.before.lives if one.key not in keys)
        before = replace(moment.before, lives=(*there, alone.lives[0]))
        revised.append(replace(moment, before=before))
        alone = keeper.advance(alone, moment.frame, moment.interval, None)
    return alone.lives[0], revised


def merged(
    known: tuple[Sighting, ...] | None, seen: tuple[Sighting, ...] | None
) -> tuple[Sighting, ...] | None:
    """What was said of a frame, and what is said of it in addition, each object once.

    What was known keeps its places, which targets are named by.
    """
    if not known or seen is None:
        return known if seen is None else seen
    boxes = np.array([one.box for one in known])
    new = [one for one in seen if overlaps(one.box[None], boxes).max() <= DOUBLED_ABOVE]
    return (*known, *new)
