"""Targets for other parameters, or images of another size: learned again where they were seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance
from pf_tracker_ros.boxes import Box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.targets.tracks import Track, TrackKey, TrackSet
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.scaling import clamp_box, scaled_box, scaled_to
from pf_tracker_ros.tracking.target_filter import TargetFilter


class LastSeen(NamedTuple):
    """Where a target was last seen.

    Attributes:
        frame: In which.
        box: Of the target.
    """

    frame: Frame
    box: Box


def needs_relearning(
    tracks: Sequence[Track], before: Mapping[str, Any], after: Mapping[str, Any]
) -> bool:
    """Whether other parameters ask for targets that are learned again.

    Args:
        tracks: Those that are followed, and were in the frames that are kept.
        before: Full name to value of every parameter in force.
        after: The same of the others.
    """
    for name, one in declarations(TrackerParameters).items():
        if tracks and one.read_only and one.is_active(before) and after[name] != before[name]:
            return True
    knowing = {name for name in after["cues"] if after[f"{name}.weight"] > 0.0}
    return not all(knowing & track.filter_state.templates.keys() for track in tracks)


def reconfigured(track_set: TrackSet, target_filter: TargetFilter) -> TrackSet:
    """The crowd for other parameters, which need nothing learned again."""
    tracks = (
        replace(track, filter_state=target_filter.reconfigure(track.filter_state))
        for track in track_set.tracks
    )
    return replace(track_set, tracks=tuple(tracks))


def relearned(
    track_set: TrackSet,
    last_seen: Mapping[TrackKey, LastSeen],
    target_filter: TargetFilter,
    appearance: Appearance | None = None,
) -> tuple[TrackSet, tuple[Track, ...]]:
    """The crowd with every target learned again; one that is hidden is so until it is seen.

    Args:
        track_set: After the last frame.
        last_seen: Where its targets were last seen.
        target_filter: Learns them.
        appearance: Describes them anew, and those that have ended are forgotten; None where the
            descriptors stay.

    Returns:
        The crowd, and those that are not in it because they were never seen.
    """
    tracks: list[Track] = []
    unseen: list[Track] = []
    for track in track_set.tracks:
        sight = last_seen.get(track.key)
        if sight is None:
            unseen.append(track)
            continue
        box, before = clamp_box(sight.box, sight.frame.image), track.filter_state
        target = target_filter.initialize(
            sight.frame, box, before.generator_state, before.estimate.state
        )
        learned = replace(track, filter_state=target, time_since_template_update=0.0)
        tracks.append(
            learned.reset_descriptor(sight.frame, box, appearance) if appearance else learned
        )
    gone = () if appearance else track_set.ended_tracks
    return replace(track_set, tracks=tuple(tracks), ended_tracks=gone), tuple(unseen)


def resized(
    track_set: TrackSet,
    last_seen: Mapping[TrackKey, LastSeen],
    target_filter: TargetFilter,
    last: Frame,
    opened: Frame,
) -> tuple[TrackSet, dict[TrackKey, LastSeen]]:
    """The crowd in images of another size, without those that were never seen.

    Args:
        track_set: After the last frame.
        last_seen: Where its targets were last seen.
        target_filter: Learns them.
        last: The last frame.
        opened: The same in that size, and what the image front end knows of it.

    Returns:
        The crowd, and where its targets were last seen, scaled as well.
    """
    frames = {id(last): opened}
    before, after = last.size, opened.size
    factors = np.divide(after, before)
    scaled: dict[TrackKey, LastSeen] = {}
    for key, sight in last_seen.items():
        image = scaled_to(sight.frame.image, opened.image)
        if image is not None:
            frame = frames.setdefault(id(sight.frame), Frame(image, sight.frame.stamp))
            scaled[key] = LastSeen(frame, scaled_box(sight.box, sight.frame.size, after))
    track_set, _ = relearned(track_set, scaled, target_filter)
    tracks = [_scaled(track, factors) for track in track_set.tracks]
    gone = []
    for track in track_set.ended_tracks:
        estimate = track.filter_state.estimate
        there = replace(estimate, box=scaled_box(estimate.box, before, after))
        gone.append(
            replace(
                _scaled(track, factors), filter_state=replace(track.filter_state, estimate=there)
            )
        )
    return replace(track_set, tracks=tuple(tracks), ended_tracks=tuple(gone)), scaled


def _scaled(track: Track, factors: NDArray[np.float64]) -> Track:
    """What is known of a target beside the filter, by how many pixels one becomes on each axis."""
    return replace(
        track,
        log_size=track.log_size + np.log(factors),
        center_filter=track.center_filter.scale(factors),
        distractor_candidate=None,
        ground_box=None if track.ground_box is None else track.ground_box * np.tile(factors, 2),
    )
