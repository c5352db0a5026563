"""Log odds that the target of a track exists, by the hits and misses of a detector.

1. A miss adds the logarithm of 1 - recall: less where a confirmed target is hidden, and where any
   was missed a moment ago.
2. A hit adds 2.
3. A detector may find the members of a group again, beside them. So a contested hit of a new track
   adds less, or takes up to 1.5, by what the track's hits cost more than those of this scene
   (`HitCost`): at first by an excess of 2. A detector that is imprecise for all targets therefore
   ends none.

The third rule is for a fast detector. The hits of a slow one cost the more the worse the track was
predicted.

Source: Musicki, Evans and Stankovic 1994, "Integrated Probabilistic Data Association", where a hit
adds its log likelihood ratio.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import pairwise_coverage
from pf_tracker_ros.targets.association import Association
from pf_tracker_ros.targets.tracks import Track, TrackSet

# What a hit adds, the minimum before that, and the maximum.
_HIT_LOG_ODDS, _MIN_LOG_ODDS, _MAX_LOG_ODDS = 2.0, -1.0, 1.5
# Time constant, seconds, after which two misses are independent.
_INDEPENDENT_AFTER = 0.3
# Minimum of the visible share, which scales the effect of a miss.
_MIN_VISIBLE = 0.4
# Seconds for which a track is new; interval of a detector, seconds, below which that counts.
_NEW_FOR, _FAST_BELOW = 2.0, 0.15


def update_existence(
    track_set: TrackSet, associations: Mapping[int, Association], recall: float
) -> TrackSet:
    """The track set after a frame with detections: existence of each track, typical cost of a hit.

    Args:
        track_set: In a frame with detections.
        associations: Index of each detected track to its association.
        recall: Share of the visible targets that the detector finds, 0 to 1, exclusive.
    """
    tracks, interval = track_set.tracks, track_set.detection_interval
    independence = 1.0 - math.exp(-interval / _INDEPENDENT_AFTER)
    misses = math.log(1.0 - recall) * independence * _visible_shares(tracks)
    typical_cost = track_set.hit_cost.typical
    updated = []
    for index, track in enumerate(tracks):
        if association := associations.get(index):
            excess = 0.0 if typical_cost is None else association.cost - typical_cost
            rate = max(1.0 / track.hits, independence)
            mean_excess = track.excess_cost + rate * (excess - track.excess_cost)
            gain = _HIT_LOG_ODDS
            is_new = interval < _FAST_BELOW and track.age < _NEW_FOR
            if is_new and association.is_contested and not _is_exempt(track):
                gain = max(gain - max(mean_excess, 0.0), -_MAX_LOG_ODDS)
            log_odds = min(max(track.existence_log_odds, _MIN_LOG_ODDS) + gain, _MAX_LOG_ODDS)
            updated.append(replace(track, excess_cost=mean_excess, existence_log_odds=log_odds))
        else:
            log_odds = track.existence_log_odds + float(misses[index])
            updated.append(replace(track, existence_log_odds=log_odds))
    costs = [
        association.cost
        for index, association in associations.items()
        if not _is_exempt(tracks[index])
    ]
    return replace(track_set, tracks=tuple(updated), hit_cost=track_set.hit_cost.learn(costs))


def _is_exempt(track: Track) -> bool:
    """Whether a track is of no target that a detector started."""
    return track.is_manual or track.is_distractor


def _visible_shares(tracks: Sequence[Track]) -> NDArray[np.float64]:
    """(N,) share of each track's box that no box in front of it covers, at least 0.4."""
    boxes = np.array([track.box for track in tracks]).reshape(-1, 4)
    lower_edges = boxes[:, 1] + boxes[:, 3]
    covered = pairwise_coverage(boxes, boxes) * (lower_edges[None] > lower_edges[:, None])
    visible = np.maximum(1.0 - covered.max(axis=1, initial=0.0), _MIN_VISIBLE)
    # What was never confirmed is not hidden, but most likely nothing.
    visible[[not (track.is_confirmed or track.is_manual) for track in tracks]] = 1.0
    return visible
