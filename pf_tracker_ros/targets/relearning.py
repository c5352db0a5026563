"""Adapts tracks to changed parameters or to images of another size.

Where a change affects what a target is described by, such as its templates or the state of its
motion model, each target is relearned in the frame and at the box where it was last seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.targets.frame_buffer import HistoryEntry
from pf_tracker_ros.targets.tracks import LastSeen, Track, TrackKey, TrackSet
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.scaling import clamp_box, scaled_box, scaled_to
from pf_tracker_ros.tracking.target_filter import TargetFilter
from pf_tracker_ros.values import replace


def needs_relearning(
    track_set: TrackSet,
    entries: Sequence[HistoryEntry],
    before: Mapping[str, Any],
    after: Mapping[str, Any],
) -> bool:
    """Whether a change of all parameters, by full name, requires that targets are relearned."""
    earlier = (one for entry in entries for one in entry.tracks_before.tracks)
    tracks = [*track_set.tracks, *track_set.ended_tracks, *earlier]
    for name, one in declarations(TrackerParameters).items():
        if tracks and one.read_only and one.is_active(before) and after[name] != before[name]:
            return True
    weighted = {name for name in after["cues"] if after[f"{name}.weight"] > 0.0}
    return not all(weighted & track.filter_state.templates.keys() for track in tracks)


def reconfigured(track_set: TrackSet, target_filter: TargetFilter) -> TrackSet:
    """The track set for a change of parameters that requires no relearning."""
    return track_set.with_tracks(
        replace(track, filter_state=target_filter.reconfigure(track.filter_state))
        for track in track_set.tracks
    )


def reconfigured_entry(entry: HistoryEntry, target_filter: TargetFilter) -> HistoryEntry:
    """A history entry for a change of parameters that requires no relearning."""
    return replace(
        entry,
        tracks_before=reconfigured(entry.tracks_before, target_filter),
        started=reconfigured(TrackSet(tracks=entry.started), target_filter).tracks,
    )


def relearned(
    track_set: TrackSet,
    last_seen: Mapping[TrackKey, LastSeen],
    target_filter: TargetFilter,
    appearance: Appearance | None = None,
) -> tuple[TrackSet, tuple[Track, ...]]:
    """The track set with every target relearned where it was last seen.

    The states stay, such as "occluded". A new appearance computes new descriptors, and ended tracks
    are dropped; None keeps both.

    Returns:
        The track set, and the tracks dropped from it because they were never seen.
    """
    tracks: list[Track] = []
    unseen: list[Track] = []
    for track in track_set.tracks:
        seen = last_seen.get(track.key)
        if seen is None:
            unseen.append(track)
            continue
        box, before = clamp_box(seen.box, seen.frame.image), track.filter_state
        state = target_filter.initialize(
            seen.frame, box, before.generator_state, before.estimate.state
        )
        status = state.status._replace(hidden_for=before.status.hidden_for)
        state = replace(state, status=status, exemplars=before.exemplars)
        new = replace(track, filter_state=state, time_since_template_update=0.0)
        tracks.append(new.reset_descriptor(seen.frame, box, appearance) if appearance else new)
    ended = () if appearance else track_set.ended_tracks
    return replace(track_set, tracks=tuple(tracks), ended_tracks=ended), tuple(unseen)


def resized(
    track_set: TrackSet,
    last_seen: Mapping[TrackKey, LastSeen],
    target_filter: TargetFilter,
    last: Frame,
    resized_last: Frame,
) -> tuple[TrackSet, dict[TrackKey, LastSeen]]:
    """The track set in images of another size, without targets that were never seen.

    `resized_last` is the last frame in the new size, prepared by the image front end.

    Returns:
        The track set, and where its targets were last seen, scaled as well.
    """
    frames = {id(last): resized_last}
    before, after = last.size, resized_last.size
    factors = np.divide(after, before)
    scaled: dict[TrackKey, LastSeen] = {}
    for key, seen in last_seen.items():
        image = scaled_to(seen.frame.image, resized_last.image)
        if image is not None:
            frame = frames.setdefault(id(seen.frame), Frame(image, seen.frame.stamp))
            scaled[key] = LastSeen(frame, scaled_box(seen.box, seen.frame.size, after))
    track_set, _ = relearned(track_set, scaled, target_filter)
    tracks = [_scaled(track, factors) for track in track_set.tracks]
    ended = []
    for track in track_set.ended_tracks:
        state = track.filter_state
        box = scaled_box(state.estimate.box, before, after)
        state = replace(state, estimate=replace(state.estimate, box=box))
        ended.append(replace(_scaled(track, factors), filter_state=state))
    return replace(track_set, tracks=tuple(tracks), ended_tracks=tuple(ended)), scaled


def _scaled(track: Track, factors: NDArray[np.float64]) -> Track:
    """The track, except its filter state, scaled by (2,) factors along x and y."""
    return replace(
        track,
        box_filter=track.box_filter.scale(factors),
        distractor_candidate=None,
    )
