"""How many frames got lost on the way, estimated from the rhythm of the stamps that came."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pf_tracker_ros.stamps import NANOSECONDS

# Fewer intervals have no rhythm.
_FEWEST_INTERVALS = 10
# The shortest intervals are those between neighbors; their share of all is unknown, but not tiny.
_SHORT_QUANTILE = 0.1
_SHORT_WITHIN = 1.5
# A camera's stamps lie about whole multiples of its interval, most of them this near.
_NEAR_WHOLE = 0.25
_LARGEST_MULTIPLE = 4.0
_REGULAR_SHARE = 0.8
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


def rhythm(stamps: Sequence[int]) -> Rhythm | None:
    """The rhythm of a camera, from the stamps of those of its frames that came.

    Args:
        stamps: Nanoseconds, in any order, duplicates allowed.

    Returns:
        The rhythm; None where there are too few stamps, or none that they keep to.
    """
    gaps = np.diff(np.unique(np.asarray(stamps, dtype=np.int64))).astype(np.float64)
    gaps = gaps[gaps < _LONGEST_GAP]
    if len(gaps) < _FEWEST_INTERVALS:
        return None
    shortest = np.quantile(gaps, _SHORT_QUANTILE)
    interval = float(np.median(gaps[gaps <= _SHORT_WITHIN * shortest]))
    multiples = gaps / interval
    # An error of the interval adds up over many of them: long gaps say nothing of regularity.
    judged = multiples[multiples < _LARGEST_MULTIPLE]
    if np.mean(np.abs(judged - np.rint(judged)) < _NEAR_WHOLE) < _REGULAR_SHARE:
        return None
    expected = float(np.maximum(np.rint(multiples), 1.0).sum())
    return Rhythm(interval / NANOSECONDS, (expected - len(gaps)) / expected)


def loss_message(found: Rhythm, processing: float, topic: str, reliability: str) -> str:
    """How many frames are lost, why that is likely to be, and the cure.

    Args:
        found: The rhythm of the frames.
        processing: Seconds that a frame takes the node.
        topic: Of the images.
        reliability: With which they are subscribed to, `reliable` or `best_effort`.
    """
    share = f"about {100 * found.lost_share:.0f} % of the frames on {topic} are "
    if processing > found.interval:
        return (
            f"{share}passed over, because one comes every {1e3 * found.interval:.0f} ms but takes "
            f"{1e3 * processing:.0f} ms: take a cheaper preset, fewer particles or smaller images"
        )
    profile = (
        "start both sides with the Fast DDS profile for large images "
        "(large_images:=true in the launch files)"
    )
    if reliability == "reliable":
        return f"{share}lost on the way although they are sent reliably: {profile}"
    return (
        f"{share}lost on the way, which best effort allows: let the camera publish reliably and "
        f"image_reliability be auto, or {profile}"
    )
