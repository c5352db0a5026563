"""Tracks that take what is known of them from outside of the image, as from positions in meters.

A target out of sight is looked for where it is expected. While it is tracked, the image decides.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import relative_center_distances
from pf_tracker_ros.targets.box_kalman_filter import BoxKalmanFilter
from pf_tracker_ros.targets.tracks import Track
from pf_tracker_ros.tracking.hints import Hint
from pf_tracker_ros.tracking.state_operations import StateOperations
from pf_tracker_ros.values import replace

# A box is where it is expected within this distance, in its own sides, or two standard deviations,
# and with sides that differ by up to this factor.
_NEAR, _SAME_SIZE = 0.3, 1.25
# Heights of the image from which on an expected box says nothing: somebody else is measured.
_TOO_NEAR = 1.6
# Standard deviation of the expected center, in widths of the box, from which on it says nothing.
_VAGUE_ABOVE = 1.0
# Log odds by the place that count at least; nothing is impossible.
_LEAST_ODDS = -20.0


def with_hint(
    track: Track, hint: Hint, image_size: tuple[int, int], operations: StateOperations
) -> Track:
    """The track before the next frame, with a hint of the last one."""
    if hint.covered_share is not None:
        track = track.with_covered_share(hint.covered_share)
    filter_state = replace(
        track.filter_state,
        standing=hint.standing,
        place_factor=math.exp(min(max(hint.place_odds, _LEAST_ODDS), 0.0)),
    )
    track = replace(track, filter_state=filter_state)
    is_seen = filter_state.estimate.state == "tracking"
    if hint.box is None or is_seen or _is_as_expected(track.box, hint, image_size):
        return track
    filter_state = replace(operations.move_to(filter_state, hint.box), last_seen_box=hint.box)
    box_filter = BoxKalmanFilter.initiate(np.array(hint.box))
    return replace(track, filter_state=filter_state, box_filter=box_filter)


def _is_as_expected(box: NDArray[np.float64], hint: Hint, image_size: tuple[int, int]) -> bool:
    """Whether a (4,) box is where it is expected, or nothing certain is expected in the image."""
    expected = np.array(hint.box)
    if hint.center_std > _VAGUE_ABOVE * expected[2] or expected[3] > _TOO_NEAR * image_size[1]:
        return True
    center = expected[:2] + expected[2:] / 2
    if not ((center >= 0.0) & (center < image_size)).all():
        return True
    ratios = np.abs(np.log(box[2:] / expected[2:]))
    allowed = max(_NEAR, 2.0 * hint.center_std / expected[2])
    is_near = bool(relative_center_distances(box, expected) < allowed)
    return is_near and float(ratios.max()) < np.log(_SAME_SIZE)
