"""How many frames got lost on the way, estimated from the rhythm of the stamps that came."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.tracking.frame_clock import LATE_WITHIN

# Fewer intervals have no rhythm.
_FEWEST_INTERVALS = 10
# The shortest intervals are those between neighbors; their share of all is unknown, but not tiny.
_SHORT_QUANTILE = 0.1
_SHORT_WITHIN = 1.5
# A camera that changes its rate keeps no rhythm meanwhile.
_SAME_RHYTHM = 0.25
_TELLING_INTERVALS = 20
# A camera's stamps lie about whole multiples of its interval, most of them this near.
_NEAR_WHOLE = 0.25
_LARGEST_MULTIPLE = 4.0
_REGULAR_SHARE = 0.8
# One gap is a pause; where frames get lost there are several, and short ones among them.
_FEWEST_GAPS = 3
_FEWEST_SHORT_GAPS = 2
# Where a frame is missing, the next one also comes later: else the stamps are coarse.
_LEAST_CORRELATION = 0.3
# A longer silence is a pause of the camera, not a loss.
_LONGEST_GAP = 2.0 * NANOSECONDS


@dataclass(frozen=True)
class Rhythm:
    """What the stamps of some frames tell.

    Attributes:
        interval: Seconds from one frame of the camera to the next.
        lost_share: Share of its frames that are missing between those that came, 0 to 1.
    """

    interval: float
    lost_share: float


def rhythm(stamps: Sequence[int], arrivals: Sequence[float]) -> Rhythm | None:
    """The rhythm of a camera, from the stamps of those of its frames that came.

    Args:
        stamps: Nanoseconds, in the order in which the frames came; some may be late or double, and
            time may begin anew, as when a recording is played again.
        arrivals: Seconds by any clock at which the frames came, one for each stamp.

    Returns:
        The rhythm; None where there are too few stamps, or none that they keep to.
    """
    gaps, waits = _between_neighbors(
        np.asarray(stamps, dtype=np.int64), np.asarray(arrivals, dtype=np.float64)
    )
    if len(gaps) < _FEWEST_INTERVALS:
        return None
    interval = _interval(gaps)
    some = min(len(gaps) // 2, _TELLING_INTERVALS)
    shorter, longer = sorted([_interval(gaps[:some]), _interval(gaps[-some:])])
    if longer > (1.0 + _SAME_RHYTHM) * shorter:
        return None
    multiples = gaps / interval
    # An error of the interval adds up over many of them: long gaps say nothing of regularity.
    judged = multiples[multiples < _LARGEST_MULTIPLE]
    if np.mean(np.abs(judged - np.rint(judged)) < _NEAR_WHOLE) < _REGULAR_SHARE:
        return None
    missing = np.maximum(np.rint(multiples), 1.0) - 1.0
    if np.count_nonzero(missing) < _FEWEST_GAPS:
        return Rhythm(interval / NANOSECONDS, 0.0)
    are_losses = (
        np.count_nonzero(np.rint(judged) > 1.0) >= _FEWEST_SHORT_GAPS
        and np.corrcoef(gaps, waits)[0, 1] > _LEAST_CORRELATION
    )
    if not are_losses:
        return None
    lost = float(missing.sum() - missing.max())
    return Rhythm(interval / NANOSECONDS, lost / (lost + len(gaps)))


def _between_neighbors(
    stamps: NDArray[np.int64], arrivals: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """From one frame to the next by the stamps, nanoseconds, and by the arrivals, seconds."""
    gaps, waits = [], []
    starts = np.flatnonzero(np.diff(stamps) < -LATE_WITHIN) + 1
    for times, came in zip(np.split(stamps, starts), np.split(arrivals, starts), strict=True):
        ordered, first = np.unique(times, return_index=True)
        gaps.append(np.diff(ordered).astype(np.float64))
        waits.append(np.diff(came[first]))
    all_gaps, all_waits = np.concatenate(gaps), np.concatenate(waits)
    are_near = all_gaps < _LONGEST_GAP
    return all_gaps[are_near], all_waits[are_near]


def _interval(gaps: NDArray[np.float64]) -> float:
    shortest = np.quantile(gaps, _SHORT_QUANTILE)
    return float(np.median(gaps[gaps <= _SHORT_WITHIN * shortest]))


def overload_message(processing: float) -> str:
    """What to do where the node is busy all the time.

    Args:
        processing: Seconds that a frame takes it.
    """
    return (
        f"frames are passed over, because each takes {1e3 * processing:.0f} ms and they come "
        "faster: take a cheaper preset, fewer particles or smaller images"
    )


def loss_message(found: Rhythm, topic: str, reliability: str) -> str:
    """How many frames are lost on the way, and the cure.

    Args:
        found: The rhythm of the frames.
        topic: Of the images.
        reliability: With which they are subscribed to, `reliable` or `best_effort`.
    """
    share = f"about {100 * found.lost_share:.0f} % of the frames on {topic} are lost on the way"
    profile = (
        "start both sides with the Fast DDS profile for large images "
        "(large_images:=true in the launch files)"
    )
    if reliability == "reliable":
        return f"{share} although they are sent reliably: {profile}"
    return (
        f"{share}, which best effort allows: let the camera publish reliably and "
        f"image_reliability be auto, or {profile}"
    )
