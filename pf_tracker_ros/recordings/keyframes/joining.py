"""Joins a forward and a backward pass between two keyframes.

1. Each pass ends at the keyframe where the other begins. If it meets that box, its error there is
   distributed linearly over the pass, as in a loop closure.
2. Where both passes agree, their boxes are averaged, each weighted by its nearness to its own
   keyframe.
3. Where they disagree up to one of the keyframes, the pass from that keyframe counts: the other
   one has left the target. Where they disagree from one keyframe to the other, the passes are
   switched where they are closest to each other. Where they disagree for a while only, the more
   confident one counts.
4. The confidence of the joined box is the mean of the overlap of both passes and their two
   confidences; where they disagree, at most the overlap. Frames below a threshold are for a person
   to check.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.evaluation import metrics
from pf_tracker_ros.tracking.estimate import TrackState

CHECK_JOINED_BELOW = 0.6
"""Confidence below which a joined box is to be checked."""
CHECK_SINGLE_BELOW = 0.7
"""Confidence below which the box of a single pass is to be checked."""
# Overlaps from which the passes agree, and from which a pass has met the other keyframe.
_AGREEMENT = 0.5
_ARRIVAL = 0.3
# Preference for a switch in the middle, as overlap.
_MIDDLE = 0.3
_STATES: tuple[TrackState, ...] = ("tracking", "occluded", "lost")


@dataclass(frozen=True, eq=False)
class Pass:
    """One pass over the frames from a keyframe to the next, both included, in order of time.

    Attributes:
        boxes: (N, 4) x, y, width, height in pixels; that of the keyframe where the pass begins.
        confidences: (N,) 0 to 1.
        states: N states.
    """

    boxes: NDArray[np.float64]
    confidences: NDArray[np.float64]
    states: Sequence[TrackState]


@dataclass(frozen=True, eq=False)
class Joined(Pass):
    """The joined boxes.

    Attributes:
        overlaps: (N,) intersection over union of both passes.
    """

    overlaps: NDArray[np.float64]


def join(forward: Pass, backward: Pass) -> Joined:
    """Join both passes between two keyframes; the keyframes' boxes are met exactly."""
    shares = np.linspace(0.0, 1.0, len(forward.boxes))
    first, last = forward.boxes[0], backward.boxes[-1]
    one = _corrected(forward.boxes, forward.boxes[-1], last, shares)
    other = _corrected(backward.boxes, backward.boxes[0], first, 1.0 - shares)
    overlaps = metrics.overlap(one, other)
    # Share of the backward pass in each box.
    weights = shares.copy()
    for agree, run in groupby(range(len(shares)), lambda number: overlaps[number] >= _AGREEMENT):
        if not agree:
            frames = list(run)
            span = slice(frames[0], frames[-1] + 1)
            weights[span] = _choice(forward, backward, overlaps, shares, span)
    boxes = (1.0 - weights[:, None]) * one + weights[:, None] * other
    boxes[0], boxes[-1] = first, last
    confidences = (overlaps + forward.confidences + backward.confidences) / 3.0
    # Two confident passes on different objects are no ground for confidence.
    disagree = overlaps < _AGREEMENT
    confidences[disagree] = np.minimum(confidences, overlaps)[disagree]
    # A target that one pass sees is not lost.
    states = [
        min(pair, key=_STATES.index) for pair in zip(forward.states, backward.states, strict=True)
    ]
    return Joined(boxes, confidences, states, overlaps)


def _corrected(
    boxes: NDArray[np.float64],
    arrival: NDArray[np.float64],
    keyframe: NDArray[np.float64],
    shares: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The boxes of a pass with its error at the other keyframe distributed.

    Args:
        boxes: (N, 4) of the pass.
        arrival: Its box at the other keyframe.
        keyframe: The true one there.
        shares: (N,) share of the error, from 0 at its own keyframe to 1 at the other.
    """
    if metrics.overlap(arrival[None], keyframe[None])[0] < _ARRIVAL:
        return boxes
    sizes = boxes[:, 2:] * (keyframe[2:] / arrival[2:]) ** shares[:, None]
    # Relative to the size, which may change on the way.
    offset = (keyframe[:2] + keyframe[2:] / 2 - arrival[:2] - arrival[2:] / 2) / arrival[2:]
    centers = boxes[:, :2] + boxes[:, 2:] / 2 + shares[:, None] * offset * boxes[:, 2:]
    return np.hstack([centers - sizes / 2, sizes])


def _choice(
    forward: Pass,
    backward: Pass,
    overlaps: NDArray[np.float64],
    shares: NDArray[np.float64],
    span: slice,
) -> NDArray[np.float64] | float:
    """Share of the backward pass, 0 or 1, in frames where the passes disagree."""
    from_first, to_last = span.start == 0, span.stop == len(shares)
    if from_first and to_last:
        closeness = overlaps + _MIDDLE * (1.0 - np.abs(2.0 * shares - 1.0))
        return (np.arange(len(shares)) > closeness.argmax()).astype(np.float64)
    if from_first or to_last:
        return float(to_last)
    return float(backward.confidences[span].mean() > forward.confidences[span].mean())
