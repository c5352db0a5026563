"""Data association: which detection belongs to which track, and whether identities still hold.

1. `Associator`: global nearest neighbor. The cost of a pair of track and detection is a negative
   log likelihood ratio, with squared Mahalanobis distance d^2 of the centers under the variance S
   of prediction plus detector, and the detector's own variance R:

       cost = 5/2 log(1 + d^2 / 3) + 1/2 log(|S| / |R|) + 0.3 (size) + 1 (other label)
              + 2 (appearance distance / mean appearance distance of the track - 2.4)

   Pairs with d^2 above a gate are excluded, and for a held track that the image does not show,
   those with a larger appearance distance than the one at which it is found again. The Hungarian
   algorithm minimizes the sum over all pairs; a pair above the maximum cost is none.
2. `correct_id_switches`: where two detected tracks are near each other and their descriptors fit
   better the other way round, they exchange filters.
3. `ReIdentifier`: a new track takes over the key of a lost one with a similar appearance.

Sources: Wojke, Bewley and Paulus 2017, "Simple Online and Realtime Tracking with a Deep Association
Metric", for the gate and the appearance; the heavy tails are those of Student's t distribution.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from importlib import import_module

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import Appearance
from pf_tracker_ros.boxes import pairwise_coverage
from pf_tracker_ros.targets.box_kalman_filter import CENTER_STD
from pf_tracker_ros.targets.detections import Detection
from pf_tracker_ros.targets.tracks import Track, TrackSet, boxes_of
from pf_tracker_ros.values import replace


def require_scipy() -> None:
    """Check that SciPy can be imported; only detections need it.

    Raises:
        ValueError: It cannot be imported; the message has the reason and the remedy.
    """
    try:
        import_module("scipy.optimize")
    except ImportError as error:
        raise ValueError(
            f"detections need SciPy ({error}): pip install scipy (with ROS from apt: apt install "
            "python3-scipy)"
        ) from error


def assign(costs: NDArray[np.float64], max_cost: float) -> dict[int, int]:
    """Row to column, each at most once, by the Hungarian algorithm.

    `costs` are (N, M), infinite for excluded pairs. A pair costs less than `max_cost`.
    """
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(np.minimum(costs, max_cost))
    return {
        int(row): int(column)
        for row, column in zip(rows, columns, strict=True)
        if costs[row, column] < max_cost
    }


# Standard deviations of the logarithms of a detection's width and height.
_LOG_SIZE_STD = np.array([0.25, 0.15])
# Degrees of freedom of the center's distance. The tails are heavy: people crouch, and detectors
# split or merge them.
_DEGREES_OF_FREEDOM = 3.0
# Largest squared Mahalanobis distance.
_GATE = 60.0
# Weight of the size, and its maximum.
_SIZE_WEIGHT, _MAX_SIZE_COST = 0.3, 9.0
# Weight of the appearance distance, in mean distances of the track, and the distance that costs
# nothing.
_APPEARANCE_WEIGHT, _NEUTRAL_DISTANCE = 2.0, 2.4
# Cost of another label.
_LABEL_WEIGHT = 1.0
# Maximum cost of a pair.
_MAX_COST = 5.5


class Associator:
    """Assigns detections to tracks, all at once, at the least total cost.

    The appearance distance is relative to the track's mean distance, so that the appearance counts
    more for targets that always look the same.
    """

    def __init__(self, appearance: Appearance) -> None:
        self._appearance = appearance

    def assign(self, tracks: Sequence[Track], detections: Sequence[Detection]) -> dict[int, int]:
        """Index of a track, predicted into this frame, to that of its detection, each once."""
        if not tracks or not detections:
            return {}
        boxes = np.array([one.box for one in detections])
        descriptors = np.array([one.descriptor for one in detections])
        costs = np.array([self._costs(track, detections, boxes, descriptors) for track in tracks])
        return assign(costs, _MAX_COST)

    def _costs(
        self,
        track: Track,
        detections: Sequence[Detection],
        boxes: NDArray[np.float64],
        descriptors: NDArray[np.float32],
    ) -> NDArray[np.float64]:
        """(M,) costs of one track; infinite beyond the gate."""
        size, box_filter = track.box_filter.size, track.box_filter
        detector_variance = np.square(CENTER_STD * size)
        variance = box_filter.center_variance + detector_variance
        offsets = boxes[:, :2] + boxes[:, 2:] / 2 - box_filter.center
        squared = (np.square(offsets) / variance).sum(axis=1)
        costs = (_DEGREES_OF_FREEDOM + 2.0) / 2.0 * np.log1p(squared / _DEGREES_OF_FREEDOM)
        costs += 0.5 * np.log(variance / detector_variance).sum()
        sizes = np.square(np.log(boxes[:, 2:] / size) / _LOG_SIZE_STD).sum(axis=1)
        costs += _SIZE_WEIGHT * np.minimum(sizes, _MAX_SIZE_COST)
        label = track.label
        costs += _LABEL_WEIGHT * np.array([one.label != label for one in detections])
        distances = self._appearance.distance(track.descriptor, descriptors)
        relative = distances / track.mean_appearance_distance
        costs += _APPEARANCE_WEIGHT * (relative - _NEUTRAL_DISTANCE)
        costs[squared > _GATE] = np.inf
        # Who covers a held target is detected in its place.
        if track.is_held and track.filter_state.estimate.state != "tracking":
            costs[distances > track.largest_distance] = np.inf
        return costs


def learn_others(
    tracks: Sequence[Track],
    assigned: Sequence[Detection | None],
    detections: Sequence[Detection],
    appearance: Appearance,
) -> tuple[Track, ...]:
    """The tracks; held ones that are detected know how others look that are seen with them.

    Others of another label are never taken for them.
    """
    learned = []
    for track, own in zip(tracks, assigned, strict=True):
        others = [
            one.descriptor
            for one in detections
            if one.is_clear and one is not own and _allows_label(track, one.label)
        ]
        is_seen = track.is_held and own is not None and own.is_clear
        learned.append(
            track.learn_others(np.array(others), appearance) if is_seen and others else track
        )
    return tuple(learned)


# Tracks within so many heights of each other may have switched.
_NEAR = 2.0
# Least decrease of the sum of both appearance distances.
_MIN_GAIN = 0.15


def correct_id_switches(
    tracks: Sequence[Track], assigned: Sequence[Detection | None], appearance: Appearance
) -> tuple[Track, ...]:
    """The tracks, with identities exchanged between those that switched at a crossing.

    The appearance decides, as soon as detections show both without overlap. The filters stay where
    they are.
    """
    corrected = list(tracks)
    clear = [(index, one) for index, one in enumerate(assigned) if one and one.is_clear]
    for (index, detection), (other_index, other_detection) in itertools.combinations(clear, 2):
        if not _are_near(detection, other_detection):
            continue
        one, other = corrected[index], corrected[other_index]
        descriptors = np.array([detection.descriptor, other_detection.descriptor])
        one_kept, one_exchanged = appearance.distance(one.descriptor, descriptors)
        other_exchanged, other_kept = appearance.distance(other.descriptor, descriptors)
        if one_kept + other_kept - (one_exchanged + other_exchanged) > _MIN_GAIN:
            corrected[index] = _with_filter_of(other, one)
            corrected[other_index] = _with_filter_of(one, other)
    return tuple(corrected)


def _are_near(one: Detection, other: Detection) -> bool:
    offset = one.box[:2] + one.box[2:] / 2 - other.box[:2] - other.box[2:] / 2
    return math.hypot(*offset) < _NEAR * (one.box[3] + other.box[3]) / 2


def _with_filter_of(track: Track, other: Track) -> Track:
    """A track with its own identity and the filters of another one."""
    return replace(
        track,
        filter_state=other.filter_state,
        box_filter=other.box_filter,
        time_since_template_update=other.time_since_template_update,
        is_occluded_by_other=other.is_occluded_by_other,
        distractor_candidate=other.distractor_candidate,
    )


# Largest displacement while lost: box heights, and heights per second.
_MAX_OFFSET, _MAX_SPEED = 1.0, 1.0
# A box that covers more than this of another track's box is around both.
_COVERS_ABOVE = 0.8


class ReIdentifier:
    """Gives new tracks the identity of lost ones.

    Lost are ended tracks, and manual targets that neither the detector nor the image shows. A
    manual target never ends. The detector finds it as a new track, which takes over its key once
    the detector has missed it often enough and both look alike.
    """

    def __init__(self, appearance: Appearance) -> None:
        self._appearance = appearance

    def reidentify(self, track_set: TrackSet) -> TrackSet:
        """The track set of a frame with detections, with the lost tracks that they show.

        An ended track is re-identified by the first detection of a new one, or not at all.
        """
        missing = [
            *track_set.ended_tracks,
            *(track for track in track_set.tracks if track.is_missing),
        ]
        candidates = [track for track in track_set.tracks if _is_candidate(track, track_set.tracks)]
        if not missing or not candidates:
            return track_set
        distances = np.array([self._distances(before, candidates) for before in missing])
        pairs = assign(distances, 1.0)
        matches = {candidates[column].key: missing[row] for row, column in pairs.items()}
        found = {before.key for before in matches.values()}
        return replace(
            track_set,
            tracks=tuple(
                _with_identity_of(track, matches[track.key]) if track.key in matches else track
                for track in track_set.tracks
                if track.key not in found
            ),
            ended_tracks=tuple(track for track in track_set.ended_tracks if track.key not in found),
        )

    def _distances(self, before: Track, candidates: Sequence[Track]) -> NDArray[np.float64]:
        """(N,) appearance distances of a missing track over the largest; infinite if excluded."""
        distances = self._appearance.distance(
            before.descriptor, np.array([track.descriptor for track in candidates])
        )
        allowed = [_can_be_same(before, track) for track in candidates]
        return np.where(allowed, distances / before.largest_distance, math.inf)


def _is_candidate(track: Track, tracks: Sequence[Track]) -> bool:
    """Whether a track began by detections, is detected now, and its box is around no other one."""
    if track.unconfirmed_for > 0.0 or track.is_held or not track.hits:
        return False
    known = (one for one in tracks if one is not track and one.is_reported and not one.is_missing)
    others = boxes_of(one for one in known if one.filter_state.estimate.state != "lost")
    covered = pairwise_coverage(others, track.box[None])
    return bool((covered <= _COVERS_ABOVE).all())


def _can_be_same(before: Track, track: Track) -> bool:
    """Whether times, distance and labels allow that a track is the missing one."""
    if before.time_since_end is None:
        since, began_after = before.unconfirmed_for, track.age <= before.unconfirmed_for
    else:
        since, began_after = before.time_since_end, track.hits == 1
    # No filter searches for an ended track: only its center filter follows the camera.
    box, last = track.box, before.box if before.time_since_end is None else before.predicted_box
    offset = box[:2] + box[2:] / 2 - last[:2] - last[2:] / 2
    is_near = math.hypot(*offset) <= (_MAX_OFFSET + _MAX_SPEED * since) * last[3]
    return began_after and is_near and _allows_label(before, track.label)


def _allows_label(before: Track, label: str) -> bool:
    """Whether a track may have a label: one of its own, or either has none."""
    known = set(before.votes) - {""}
    return not known or label in known or not label


def _with_identity_of(track: Track, before: Track) -> Track:
    """A new track with the key, the appearance and the history of a missing one."""
    votes = {
        label: before.votes.get(label, 0.0) + track.votes.get(label, 0.0)
        for label in (*before.votes, *track.votes)
    }
    found = replace(
        track,
        key=before.key,
        distracted_key=None,
        is_confirmed=True,
        is_selected=before.is_selected,
        descriptor=before.descriptor,
        mean_appearance_distance=before.mean_appearance_distance,
        appearance_samples=before.appearance_samples,
        others_distance=before.others_distance,
        age=before.age + (before.time_since_end or 0.0),
        hits=before.hits + track.hits,
        votes=votes,
    )
    return found.with_existence(max(track.existence_log_odds, 0.5), is_found=before.is_held)
