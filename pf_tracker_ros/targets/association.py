"""Which detection is of which target, and whether targets are still who they were.

1. Detections are assigned to targets, all at once, at the least cost (`Associator`).
2. Targets that came out of a crossing as each other are exchanged (`correct_id_switches`).
3. Targets that a detector has started are compared with those that are missing (`ReIdentifier`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance
from pf_tracker_ros.boxes import pairwise_coverage
from pf_tracker_ros.targets.detections import Detection
from pf_tracker_ros.targets.tracks import Track, TrackSet


def require_scipy() -> None:
    """Make sure that there is SciPy, which is imported with the first detections.

    Raises:
        ValueError: It cannot be imported; the message says why, and how to get it.
    """
    try:
        import_module("scipy.optimize")
    except ImportError as error:
        raise ValueError(
            f"detections need SciPy ({error}): pip install scipy (with ROS from apt: apt install "
            "python3-scipy)"
        ) from error


def assign(costs: NDArray[np.float64], most: float) -> dict[int, int]:
    """Row to column, each at most once.

    Args:
        costs: (N, M) of each pair; infinite for those that cannot be.
        most: What costs this or more is no pair.
    """
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(np.minimum(costs, most))
    return {
        int(row): int(column)
        for row, column in zip(rows, columns, strict=True)
        if costs[row, column] < most
    }


# Standard deviations of a detection's center, in widths and in heights of its box.
CENTER_STD = np.array([0.15, 0.1])
# Of the logarithms of its sides.
_SIZE_SPREAD = np.array([0.25, 0.15])
# Degrees of freedom of a distance: the tails are heavy, since people crouch, and detectors cut them
# in two or join them.
_TAIL = 3.0
# Squared distance, in units of its variance, beyond which a detection is of another target, however
# alike they look.
_GATE = 60.0
# Weight of a size, and the most that it counts.
_SIZE_WEIGHT, _MOST_OF_SIZE = 0.3, 9.0
# Weight of the appearance, in units of how much that of the target usually varies, and up to how
# many of these it rather speaks for the target.
_APPEARANCE_WEIGHT, _USUALLY = 2.0, 2.4
# Weight of another label.
_LABEL_WEIGHT = 1.0
# A detection that costs more than this is of none of the targets.
_MOST_COST = 5.5


class Associator:
    """Assigns detections to targets, all at once, at the least cost.

    The cost of a pair is what a detection of the target would be unlikely for: its distance under
    the covariance of its course and of the detector, its size, its appearance and its label. The
    appearance counts as much as the target's own views are alike, so that it tells more in one
    footage than in another.

    Args:
        appearance: Compares descriptors.
    """

    def __init__(self, appearance: Appearance) -> None:
        self._appearance = appearance

    def assign(
        self,
        tracks: Sequence[Track],
        seen: Sequence[Detection],
    ) -> dict[int, int]:
        """Place of a target to the place of its detection; each at most once.

        Args:
            tracks: N targets, their courses in this frame.
            seen: M detections.
        """
        if not tracks or not seen:
            return {}
        # Only here: without detections no SciPy is needed.

        boxes = np.array([one.box for one in seen])
        descriptors = np.array([one.descriptor for one in seen])
        costs = np.array([self._costs(track, seen, boxes, descriptors) for track in tracks])
        return assign(costs, _MOST_COST)

    def _costs(
        self,
        track: Track,
        seen: Sequence[Detection],
        boxes: NDArray[np.float64],
        descriptors: NDArray[np.float32],
    ) -> NDArray[np.float64]:
        """(M,) of one target; infinite beyond the gate."""
        size, center_filter = np.exp(track.log_size), track.center_filter
        of_detector = np.square(CENTER_STD * size)
        variance = center_filter.center_variance + of_detector
        apart = boxes[:, :2] + boxes[:, 2:] / 2 - center_filter.center
        squared = (np.square(apart) / variance).sum(axis=1)
        costs = (_TAIL + 2.0) / 2.0 * np.log1p(squared / _TAIL)
        costs += 0.5 * np.log(variance / of_detector).sum()
        sizes = np.square(np.log(boxes[:, 2:] / size) / _SIZE_SPREAD).sum(axis=1)
        costs += _SIZE_WEIGHT * np.minimum(sizes, _MOST_OF_SIZE)
        label = track.label
        costs += _LABEL_WEIGHT * np.array([one.label != label for one in seen])
        differs = self._appearance.distance(track.descriptor, descriptors)
        costs += _APPEARANCE_WEIGHT * (differs / track.mean_appearance_distance - _USUALLY)
        costs[squared > _GATE] = np.inf
        return costs


# Targets within so many heights of each other may have been taken for each other.
_NEAR = 2.0
# By how much the descriptors must fit better the other way round.
_MARGIN = 0.15


def correct_id_switches(
    tracks: Sequence[Track], own: Sequence[Detection | None], appearance: Appearance
) -> tuple[Track, ...]:
    """The targets, with those exchanged that came out of a crossing as each other.

    Who is who is asked of the appearance, as soon as detections show both alone; the filters go on.

    Args:
        tracks: The targets.
        own: The detection of each, None where there is none.
        appearance: Compares descriptors.
    """
    settled = list(tracks)
    shown = [place for place, one in enumerate(own) if one is not None and one.is_clear]
    for place, other in itertools.combinations(shown, 2):
        one, another = settled[place], settled[other]
        seen, seen_other = own[place], own[other]
        if seen is None or seen_other is None or not _are_near(seen, seen_other):
            continue
        shown_both = np.array([seen.descriptor, seen_other.descriptor])
        one_as_is, one_exchanged = appearance.distance(one.descriptor, shown_both)
        another_exchanged, another_as_is = appearance.distance(another.descriptor, shown_both)
        if one_as_is + another_as_is - (one_exchanged + another_exchanged) > _MARGIN:
            settled[place], settled[other] = _with_filter(another, one), _with_filter(one, another)
    return tuple(settled)


def _are_near(one: Detection, other: Detection) -> bool:
    apart = one.box[:2] + one.box[2:] / 2 - other.box[:2] - other.box[2:] / 2
    return math.hypot(*apart) < _NEAR * (one.box[3] + other.box[3]) / 2


def _with_filter(track: Track, other: Track) -> Track:
    """Who the one is, where the other one was followed."""
    return replace(
        track,
        filter_state=other.filter_state,
        center_filter=other.center_filter,
        log_size=other.log_size,
        time_since_template_update=other.time_since_template_update,
        is_occluded_by_other=other.is_occluded_by_other,
        distractor_candidate=other.distractor_candidate,
    )


# A target is recognized where its appearance differs by less than so much of what it usually
# varies by.
_ALIKE_BELOW = 1.5
# How far it may have come: box heights at once, and in each second.
_REACH, _SPEED = 1.0, 1.0
# Belief below which a target that somebody asked for is missing, if the image does not show it.
_MISSING_BELOW = -1.0
# A box that holds more than this of another target's is around both.
_HOLDS_ABOVE = 0.8


class ReIdentifier:
    """Gives targets that a detector has started the names of those they were before.

    Nobody ends what was started by hand. If it is lost, though, the detector finds it before
    anybody knows that it is the same one, and it begins as another: until the detector has missed
    the one often enough, and both look alike.

    Args:
        appearance: Compares descriptors.
    """

    def __init__(self, appearance: Appearance) -> None:
        self._appearance = appearance

    def reidentify(self, track_set: TrackSet) -> TrackSet:
        """The crowd with those recognized that a detection shows.

        What has ended is recognized by the first detection or not at all.

        Args:
            track_set: In a frame that the detector saw.
        """
        missing = [
            *track_set.ended_tracks,
            *(track for track in track_set.tracks if _is_missing(track)),
        ]
        shown = [track for track in track_set.tracks if _may_be_another(track, track_set.tracks)]
        if not missing or not shown:
            return track_set
        differs = np.array([self._differences(before, shown) for before in missing])
        pairs = assign(differs, _ALIKE_BELOW)
        known = {shown[column].key: missing[row] for row, column in pairs.items()}
        found = {before.key for before in known.values()}
        return replace(
            track_set,
            tracks=tuple(
                _as_before(track, known[track.key]) if track.key in known else track
                for track in track_set.tracks
                if track.key not in found
            ),
            ended_tracks=tuple(track for track in track_set.ended_tracks if track.key not in found),
        )

    def _differences(self, before: Track, shown: Sequence[Track]) -> NDArray[np.float64]:
        """(N,) how unlike a missing target others are, in what it varies by; infinite if not it."""
        differs = self._appearance.distance(
            before.descriptor, np.array([track.descriptor for track in shown])
        )
        may_be = [_may_be(before, track) for track in shown]
        return np.where(may_be, differs / before.mean_appearance_distance, math.inf)


def _is_missing(track: Track) -> bool:
    """Whether somebody asked for a target that neither the detector nor the image shows."""
    is_seen = track.unconfirmed_for == 0.0 or track.filter_state.estimate.state == "tracking"
    return track.is_manual and not is_seen and track.existence_log_odds < _MISSING_BELOW


def _may_be_another(track: Track, tracks: Sequence[Track]) -> bool:
    """Whether a detection shows a target that a detector has started, and that one alone."""
    if track.unconfirmed_for > 0.0 or track.is_manual or track.is_distractor:
        return False
    known = (one for one in tracks if one is not track and one.is_reported and not _is_missing(one))
    others = [one.box for one in known if one.filter_state.estimate.state != "lost"]
    inside = pairwise_coverage(np.array(others).reshape(-1, 4), track.box[None])
    return bool((inside <= _HOLDS_ABOVE).all())


def _may_be(before: Track, track: Track) -> bool:
    """Whether another target may be the missing one, whatever it looks like."""
    if before.time_since_end is None:
        since, began_after = before.unconfirmed_for, track.age <= before.unconfirmed_for
    else:
        since, began_after = before.time_since_end, track.hits == 1
    # Nobody looks for what has ended: its course alone goes along where the camera turns.
    one, other = track.box, before.box if before.time_since_end is None else before.expected
    apart = one[:2] + one[2:] / 2 - other[:2] - other[2:] / 2
    is_near = math.hypot(*apart) <= (_REACH + _SPEED * since) * other[3]
    return began_after and is_near and _may_be_called(before, track.label)


def _may_be_called(before: Track, label: str) -> bool:
    """Whether a target may have a label: nobody has called it anything else alone."""
    known = set(before.votes) - {""}
    return not known or label in known or not label


def _as_before(track: Track, before: Track) -> Track:
    """A target that is the one of before, where it is now."""
    votes = {
        label: before.votes.get(label, 0.0) + track.votes.get(label, 0.0)
        for label in (*before.votes, *track.votes)
    }
    return replace(
        track,
        key=before.key,
        descriptor=before.descriptor,
        mean_appearance_distance=before.mean_appearance_distance,
        appearance_samples=before.appearance_samples,
        existence_log_odds=max(track.existence_log_odds, 0.5),
        age=before.age + (before.time_since_end or 0.0),
        hits=before.hits + track.hits,
        votes=votes,
    )
