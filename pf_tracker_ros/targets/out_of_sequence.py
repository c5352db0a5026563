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

from pf_tracker_ros.boxes import pairwise_iou
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.detections import DUPLICATE_ABOVE, Detection, Detections
from pf_tracker_ros.targets.frame_buffer import FrameBuffer, HistoryEntry
from pf_tracker_ros.targets.pipeline import TrackingPipeline
from pf_tracker_ros.targets.tracks import Track, TrackSet

# How late a detection may be, in nanoseconds.
_LATEST = 2 * NANOSECONDS
# Nanoseconds that a detector takes at most. What it says of that time before the first frame is no
# fault: it was there before the tracker.
_SLOWEST = 5 * NANOSECONDS
# Before the first frame of all there is none that could be nearer than by so much.
_NEAR_FIRST = NANOSECONDS // 50
# What counts of detections in a frame, None where they say nothing of it; why others do not.
DetectionFilter = Callable[[Detections, Frame], tuple[tuple[Detection, ...] | None, list[str]]]


class StampedDetections(NamedTuple):
    """What a detector found in the frame with a stamp, nanoseconds; 0 for the one at hand."""

    stamp: int
    detections: Detections


def insert_late(
    buffer: FrameBuffer, late: Sequence[StampedDetections], now: int, look: DetectionFilter
) -> tuple[list[HistoryEntry], list[str]]:
    """The moments from the oldest on that late detections are of, with these in them.

    Args:
        buffer: The frames so far.
        late: Of earlier frames than the one at hand.
        now: Stamp of the frame at hand, nanoseconds.
        look: Tells what counts of detections.

    Returns:
        The moments, to be processed again, and what was left out.
    """
    entries: list[HistoryEntry] = []
    rejected_detections: list[str] = []
    for stamp, detections in sorted(late, key=lambda one: one.stamp):
        since = entries_since(buffer, stamp) if now - stamp <= _LATEST else []
        if not since:
            oldest = max(buffer.first.stamp, now - _LATEST) if len(buffer) else now
            early = buffer.first.stamp - stamp if len(buffer) else 0
            if not (buffer.is_complete and _NEAR_FIRST < early < _SLOWEST):
                rejected_detections.append(
                    f"the detections are {(now - stamp) / NANOSECONDS:.3g} s old, and frames of "
                    f"the last {(now - oldest) / NANOSECONDS:.2g} s are kept"
                )
            continue
        entries = entries or since
        place = len(entries) - len(since)
        entry = entries[place]
        seen, reasons = look(detections, entry.frame)
        entries[place] = replace(entry, detections=merge_detections(entry.detections, seen))
        rejected_detections += reasons
    return entries, rejected_detections


def entries_since(buffer: FrameBuffer, stamp: int) -> list[HistoryEntry]:
    """The moments from the one on that a stamp is of; none where that is not kept.

    Args:
        buffer: The frames so far.
        stamp: Of the frame that a detector saw, nanoseconds; up to half an interval off.
    """
    since = buffer.since(stamp)
    if not since:
        return buffer.entries[-1:]
    early = since[0].stamp - stamp
    allowed = round(since[0].interval * NANOSECONDS / 2)
    if buffer.is_complete and since[0] is buffer.first:
        allowed = max(allowed, _NEAR_FIRST)
    return since if early <= allowed else []


def reprocess(
    pipeline: TrackingPipeline, entries: Sequence[HistoryEntry]
) -> tuple[TrackSet, list[HistoryEntry]]:
    """What moments make of the targets that there were before the first of them.

    Args:
        pipeline: Makes the crowd of a frame out of the one before.
        entries: One after the other, at least one.

    Returns:
        The targets after the last, and the moments, each with the targets before it.
    """
    track_set = entries[0].tracks_before
    revised = []
    for entry in entries:
        revised.append(replace(entry, tracks_before=track_set))
        track_set = pipeline.advance(track_set, entry.frame, entry.interval, entry.detections)
        track_set = pipeline.initiator.add_manual(track_set, entry.started)
        for track in entry.stopped:
            track_set = track_set.without(track)
    return track_set, revised


def replay_track(
    pipeline: TrackingPipeline,
    track: Track,
    entries: Sequence[HistoryEntry],
    taken_over: Sequence[Track] = (),
) -> tuple[Track, list[HistoryEntry]]:
    """Take a target that began in a moment through those since, which it joins.

    It is followed by itself: the others were there before it. What looks like it beside it helps to
    tell it apart and does not join them, since it may be one of them; for the same reason, it is
    not looked for elsewhere.

    Args:
        pipeline: Makes the crowd of a frame out of the one before.
        track: Began in the first moment.
        entries: That one and those since.
        taken_over: Those in whose place it is from the first moment on.

    Returns:
        The target after the last, and the moments with it.
    """
    first, *others = entries
    alone = TrackSet(frame=track.key.frame, tracks=(track,), time_since_detection=0.0)
    keys = {one.key for one in taken_over}
    begun = (one for one in first.started if one.key not in keys)
    # What only looks like a target, nobody would miss.
    stopped = (*first.stopped, *(one for one in taken_over if not one.is_distractor))
    revised = [replace(first, started=(*begun, track), stopped=stopped)]
    for entry in others:
        there = (one for one in entry.tracks_before.tracks if one.key not in keys)
        before = replace(entry.tracks_before, tracks=(*there, alone.tracks[0]))
        revised.append(replace(entry, tracks_before=before))
        alone = pipeline.advance(alone, entry.frame, entry.interval, None)
    return alone.tracks[0], revised


def merge_detections(
    known: tuple[Detection, ...] | None, seen: tuple[Detection, ...] | None
) -> tuple[Detection, ...] | None:
    """What was said of a frame, and what is said of it in addition, each object once.

    What was known keeps its places, which targets are named by.
    """
    if not known or seen is None:
        return known if seen is None else seen
    boxes = np.array([one.box for one in known])
    new = [one for one in seen if pairwise_iou(one.box[None], boxes).max() <= DUPLICATE_ABOVE]
    return (*known, *new)
