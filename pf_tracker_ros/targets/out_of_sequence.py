"""Out-of-sequence measurements: late detections, and manual targets on earlier frames.

A slow detector reports on a frame after later frames have been processed. The measurement is
applied at its own time stamp:

1. Find the frame of the measurement in the frame buffer by its stamp.
2. Restore the track set before that frame.
3. Reprocess that frame and all since, with all their detections and manual targets.

The result is the same as if the measurement had been in time, but for hints about the place of a
target in these frames, which followed from boxes that are revised. The cost is one update for each
frame since. The term is that of Bar-Shalom 2002, "Update with out-of-sequence measurements in
tracking: exact solution", whose update of a Kalman filter needs no reprocessing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.detections import Detection, Detections, StampedDetections
from pf_tracker_ros.targets.frame_buffer import FrameBuffer, HistoryEntry
from pf_tracker_ros.targets.pipeline import TrackingPipeline
from pf_tracker_ros.targets.tracks import Track, TrackSet
from pf_tracker_ros.values import replace

# Maximum age of late detections, nanoseconds.
_MAX_AGE = 2 * NANOSECONDS
# Maximum latency of a detector, nanoseconds. Detections of that time before the first frame are
# ignored silently, since the detector may have started before the tracker.
_MAX_LATENCY = 5 * NANOSECONDS
# Tolerance before the first frame of all, nanoseconds: no other frame can be nearer.
_FIRST_TOLERANCE = NANOSECONDS // 50
# Time between detections and their frame, nanoseconds, above which they are of a frame that was
# skipped; more for a slow camera.
_FARTHEST = NANOSECONDS // 10
# Returns the valid detections in a frame, None if there is no information, and why others are
# rejected.
DetectionFilter = Callable[[Detections, Frame], tuple[tuple[Detection, ...] | None, list[str]]]


def insert_late(
    buffer: FrameBuffer,
    late: Sequence[StampedDetections],
    now: int,
    filter_detections: DetectionFilter,
) -> tuple[list[HistoryEntry], list[str]]:
    """Insert late detections into the history; `now` is the stamp of the current frame.

    Returns:
        The entries to reprocess, from the earliest frame with late detections on, and why
        detections were rejected.
    """
    entries: list[HistoryEntry] = []
    rejected: list[str] = []
    for detections, stamp in sorted(late, key=lambda one: one.stamp):
        since = entries_since(buffer, stamp) if now - stamp <= _MAX_AGE else []
        if not since:
            rejected += _reasons_to_reject(buffer, stamp, now)
            continue
        index = max(len(entries) - len(since), 0)
        entry = entries[index] if entries else since[0]
        found, reasons = filter_detections(detections, entry.frame)
        rejected += reasons
        revised = entry.with_detections(found, abs(entry.stamp - stamp))
        if revised is not entry:
            entries = entries or since
            entries[index] = revised
    return entries, rejected


def is_current(stamp: int, now: int, interval: float, buffer: FrameBuffer) -> bool:
    """Whether detections belong to the current frame: up to half an interval before it."""
    reach = _reach(buffer.entries[-1:])
    return 0 in (stamp, now) or now - stamp <= min(interval * NANOSECONDS / 2, reach)


def entries_since(buffer: FrameBuffer, stamp: int) -> list[HistoryEntry]:
    """The entries from the frame of a stamp on; none if that frame is not buffered.

    Detections have stamps of up to half an interval before that of their frame.
    """
    entries = buffer.entries
    since = buffer.since(stamp) or entries[-1:]
    if not since:
        return []
    before = entries[: len(entries) - len(since)]
    early = since[0].stamp - stamp
    allowed = min(since[0].interval * NANOSECONDS / 2, _reach(before[-1:]))
    if buffer.is_complete and not before:
        allowed = max(allowed, _FIRST_TOLERANCE)
    return since if -_reach(since[:1]) <= early <= allowed else []


def _reach(last: Sequence[HistoryEntry]) -> float:
    """How far from a frame detections may be, nanoseconds, by the interval of the frame before.

    That of the frame itself may be a gap, in which images were lost.
    """
    return max([_FARTHEST, *(one.interval * NANOSECONDS / 2 for one in last)])


def _reasons_to_reject(buffer: FrameBuffer, stamp: int, now: int) -> list[str]:
    """Why detections without a frame are rejected; none for those of skipped and no frames."""
    first = buffer.first.stamp if len(buffer) else now
    is_skipped = now - stamp <= _MAX_AGE and stamp >= first
    is_of_start = buffer.is_complete or not len(buffer)
    if is_skipped or (is_of_start and 0 < first - stamp < _MAX_LATENCY):
        return []
    kept = now - max(first, now - _MAX_AGE)
    return [
        f"the detections are {(now - stamp) / NANOSECONDS:.3g} s old, and frames of the last "
        f"{kept / NANOSECONDS:.2g} s are kept, since the first image or as frame_buffer_length "
        "allows"
    ]


def reprocess(
    pipeline: TrackingPipeline, entries: Sequence[HistoryEntry]
) -> tuple[TrackSet, list[HistoryEntry]]:
    """Reprocess consecutive entries, at least one, from the track set before the first.

    Returns:
        The track set after the last entry, and the entries, each with its new track set before.
    """
    track_set = entries[0].tracks_before
    revised = []
    for entry in entries:
        track_set = track_set.with_outside_evidence(entry.tracks_before)
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
    replaced: Sequence[Track] = (),
) -> tuple[Track, list[HistoryEntry]]:
    """Advance a new manual track, started in the first entry, alone through the frames since.

    The other tracks stay as they are, but for the `replaced` ones. Distractors that arise in the
    replay are not added to the history, since they may be other targets. For the same reason there
    is no redetection (`time_since_detection` 0).

    Returns:
        The track after the last entry, and the entries with it.
    """
    first, *others = entries
    alone = TrackSet(frame=track.key.frame, tracks=(track,), time_since_detection=0.0)
    keys = {one.key for one in replaced}
    started = (one for one in first.started if one.key not in keys)
    # A distractor is no target that could be stopped.
    stopped = (*first.stopped, *(one for one in replaced if not one.is_distractor))
    revised = [replace(first, started=(*started, track), stopped=stopped)]
    for entry in others:
        kept = (one for one in entry.tracks_before.tracks if one.key not in keys)
        before = replace(entry.tracks_before, tracks=(*kept, alone.tracks[0]))
        revised.append(replace(entry, tracks_before=before))
        alone = pipeline.advance(alone, entry.frame, entry.interval, None)
    return alone.tracks[0], revised
