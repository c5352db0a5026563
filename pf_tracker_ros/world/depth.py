"""Distance of a target from a depth image.

A box contains the target, background beside it, occluders before it, and holes.

1. Sample the pixels on a grid. Each in the box has a weight: its probability to be the target's,
   from colors, times its nearness to the middle column.
2. A mode is a window of depth that holds the most weight. Remove it and find the next one.
3. A mode that is also in the ring around the box is a background or an occluder that goes on there.
4. Choose the mode with the most weight, contrast to the ring and likelihood of the predicted
   distance, and of that by the box. They choose between modes only: weighting pixels within one
   would confirm itself.
5. The distance is the weighted mean of the pixels in the mode.

A prediction excludes modes that are far from it. Only a farther one that the box agrees with shows
the target nevertheless: nothing is seen through it. Where nearly all of the box is nearer or
farther than predicted, and none of that is such a mode, the target is not seen, unless all of it is
nearer, as a pane of glass.

The share of pixels that are clearly nearer than the target is evidence of an occlusion. Without a
prediction, the target may also be in a mode behind the chosen one that scores nearly as high.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.world.box_samples import BoxSamples

# Width of a bin of the logarithm of depth, and depth of the first and beyond the last, meters.
_BIN, _NEAREST, _FARTHEST = 0.02, 0.1, 200.0
# Value of a 16-bit image without a measurement, or with one beyond its range.
_SATURATED = 65535
_BINS = math.ceil(math.log(_FARTHEST / _NEAREST) / _BIN)
# Half the extent of a mode: that of a person, meters, and noise relative to the distance.
_EXTENT, _RELATIVE_EXTENT = 0.12, 0.03
# Most modes, and least share of the weight in one.
_MODES, _MIN_SHARE = 4, 0.06
# Fewest samples with depth in the box.
_MIN_SAMPLES = 12
# Power of a mode's contrast to the ring.
_RING_POWER = 3.0
# Log score, relative to the best, of a mode that may also be the target's.
_RIVAL_LOG_SCORE = math.log(0.3)
# Samples nearer than the target by this share, or by so many standard deviations of a prediction,
# are of an occluder, and ones that are farther by the share of what is behind it. Share of both
# among all samples above which a box may not show the target, and share of those with depth that
# have to be at its distance, or beyond.
_NEARER_BY = _FARTHER_BY = 0.12
_NEARER_SDS = 2.0
_ELSEWHERE_ABOVE, _TARGET_ABOVE = 0.6, 0.12
# Weight of a pixel at the left and right edge of the box.
_EDGE_WEIGHT = 0.2
# Standard deviation of a predicted distance's logarithm, beside its own.
_PREDICTION_SD = 0.05
# Distance in standard deviations beyond which no mode is the predicted target, and up to which the
# box agrees with a mode.
_PREDICTION_GATE, _AGREES_WITHIN = 4.0, 2.0
# Largest difference in aspect ratio between image and depth.
_ASPECT_TOLERANCE = 0.02
# Standard deviation of the distance: a person's thickness, meters, and a share of the distance.
_THICKNESS_SD, _RELATIVE_SD = 0.06, 0.006


@dataclass(frozen=True)
class ExpectedDepth:
    """What other measurements say of a target's depth.

    Attributes:
        depth: Along the optical axis, meters.
        sd: Standard deviation, meters.
        floor: Likelihood, relative to the peak, that any depth has at least; 0 for a prediction,
            which excludes depths.
        is_farthest: Whether the target may also be nearer, as when a box contains a part of it.
    """

    depth: float
    sd: float
    floor: float = 0.0
    is_farthest: bool = False

    @property
    def is_prediction(self) -> bool:
        """Whether it excludes depths."""
        return self.floor == 0.0

    def log_likelihoods(self, depths: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) log likelihoods of depths, up to a constant."""
        offsets = self._offsets(depths)
        return np.log(np.exp(-0.5 * np.square(offsets)) + max(self.floor, 1e-300))

    def is_within(self, depth: float, gate: float) -> bool:
        """Whether a depth is at most so many standard deviations away."""
        return bool(abs(self._offsets(np.array([depth]))[0]) <= gate)

    def _offsets(self, depths: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) distances of depths, standard deviations."""
        offsets = np.log(depths / self.depth) / math.hypot(self.sd / self.depth, _PREDICTION_SD)
        return np.maximum(offsets, 0.0) if self.is_farthest else offsets


@dataclass(frozen=True)
class DepthReading:
    """What a depth image says of a target.

    Attributes:
        depth: Of the target along the optical axis, meters; None where it is not seen.
        sd: Standard deviation, meters; NaN where it is not seen.
        row: Mean row of its samples as a share of the box's height.
        occlusion: Share of the samples that are nearer than the target; None where nothing says how
            far the target is.
        is_unseen: Whether the box shows only what is before or behind the predicted target.
    """

    depth: float | None
    sd: float
    row: float
    occlusion: float | None
    is_unseen: bool = False


def check_depth(depth: object, image_size: tuple[int, int]) -> NDArray[np.generic]:
    """The depth image of the camera's field of view.

    Raises:
        ValueError: It is not (H, W) float32, float64 or uint16, or has another aspect ratio.
    """
    if not isinstance(depth, np.ndarray) or depth.ndim != 2 or depth.size == 0:
        shape = getattr(depth, "shape", type(depth).__name__)
        raise ValueError(f"depth is {shape}; expected an array of rows and columns")
    if depth.dtype not in (np.float32, np.float64, np.uint16):
        raise ValueError(
            f"depth is {depth.dtype}; expected float32 in meters or uint16 in millimeters"
        )
    width, height = image_size
    if abs(depth.shape[1] * height / (depth.shape[0] * width) - 1.0) > _ASPECT_TOLERANCE:
        raise ValueError(
            f"depth is {depth.shape[1]} x {depth.shape[0]} px and the image {width} x {height}; "
            "expected depth that is registered to the image"
        )
    return depth


def read_depth(
    depth: NDArray[np.generic],
    samples: BoxSamples,
    target_probability: NDArray[np.float64] | None = None,
    expected: Sequence[ExpectedDepth] = (),
) -> DepthReading | None:
    """The depth of a target in a box.

    Args:
        depth: (H, W) float in meters or uint16 in millimeters; 0, NaN, infinity and 65535 mm are
            holes.
        samples: Of the box and a ring around it.
        target_probability: (R, C) probability, 0 to 1, of each sample in the box to be the
            target's.
        expected: What else is known of its depth, independently of each other; chooses between
            modes.

    Returns:
        None where too few samples have a depth.
    """
    values, is_valid = _meters(samples.take(depth), depth.dtype)
    is_in_box = is_valid[samples.inside].copy()
    depths = values[samples.inside][is_in_box]
    if not _are_enough(depths, is_in_box.size):
        return None
    middle = 1.0 - (1.0 - _EDGE_WEIGHT) * np.abs(2.0 * samples.across - 1.0)
    weights = np.broadcast_to(np.maximum(middle, _EDGE_WEIGHT), is_in_box.shape)
    if target_probability is not None:
        weights = weights * target_probability
    weights = weights[is_in_box]
    is_valid[samples.inside] = False
    chosen = _choose_mode(depths, weights, values[is_valid], expected)
    predicted = next((one for one in expected if one.is_prediction), None)
    if predicted is not None:
        beyond, nearer = (1.0 + _FARTHER_BY) * predicted.depth, _share_nearer(depths, predicted)
        # By number, not by weight: whatever is at the distance of the target may be the target.
        farther = float(np.count_nonzero(depths > beyond)) / len(depths)
        elsewhere = nearer + farther
        # Of all samples: somebody in black has no depth, but what is beside has. Where nothing
        # farther is seen, a pane of glass may be before the target.
        is_unseen = (
            elsewhere > 1.0 - _TARGET_ABOVE
            and elsewhere * len(depths) > _ELSEWHERE_ABOVE * is_in_box.size
            and farther > _TARGET_ABOVE
        )
        if chosen is None or (chosen[0] <= beyond and is_unseen):
            return DepthReading(None, math.nan, 0.5, nearer, is_unseen)
    if chosen is None:
        return DepthReading(None, math.nan, 0.5, None)
    mode, farthest = chosen
    inside = np.abs(depths - mode) < _EXTENT + _RELATIVE_EXTENT * mode
    mean = float(weights[inside] @ depths[inside] / weights[inside].sum())
    return DepthReading(
        mean,
        math.hypot(_THICKNESS_SD, _RELATIVE_SD * mean),
        float(samples.down[np.nonzero(is_in_box)[0][inside]].mean()),
        _share_nearer(depths, predicted or ExpectedDepth(max(mean, farthest), 0.0)),
    )


def share_nearer(
    depth: NDArray[np.generic], samples: BoxSamples, predicted: ExpectedDepth
) -> float | None:
    """The share, 0 to 1, of the samples in a box that are nearer than a target may be.

    Args:
        depth: As for `read_depth`.
        samples: Of the box.
        predicted: The target.

    Returns:
        None where too few samples have a depth.
    """
    values, is_valid = _meters(samples.take(depth)[samples.inside], depth.dtype)
    depths = values[is_valid]
    return _share_nearer(depths, predicted) if _are_enough(depths, values.size) else None


def _meters(
    values: NDArray[np.generic], dtype: np.dtype[Any]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Values of a depth image in meters, and which of them are a depth."""
    meters = values.astype(np.float64)
    if dtype == np.uint16:
        meters[values == _SATURATED] = np.nan
        meters *= 1e-3
    # A comparison with NaN is false.
    return meters, (meters > _NEAREST) & (meters < _FARTHEST)


def _are_enough(depths: NDArray[np.float64], samples: int) -> bool:
    return len(depths) >= min(_MIN_SAMPLES, samples)


def _choose_mode(
    depths: NDArray[np.float64],
    weights: NDArray[np.float64],
    around: NDArray[np.float64],
    expected: Sequence[ExpectedDepth],
) -> tuple[float, float] | None:
    """Middle of the target's mode, and of the farthest one that may also be the target's.

    None where nothing there is the target.

    Args:
        depths: (N,) of the samples in the box, meters.
        weights: (N,) of these.
        around: (M,) of the samples in the ring.
        expected: What else is known.
    """
    total = float(weights.sum())
    if total <= 0.0:
        return None
    histogram = _histogram(depths, weights / total)
    ring = _window_sums(_histogram(around, np.full(len(around), 1.0 / max(len(around), 1))))
    modes, scores = [], []
    for _ in range(_MODES):
        shares = _window_sums(histogram)
        share = float(shares.max())
        if share < _MIN_SHARE:
            break
        # Several windows contain the same bins: the middle of these.
        places = np.flatnonzero(shares > share - 1e-9)
        place = int(places[len(places) // 2])
        modes.append(float(_BIN_CENTERS[place]))
        scores.append(share * (share / (share + float(ring[place]))) ** _RING_POWER)
        histogram[_WINDOW_START[place] : _WINDOW_END[place]] = 0.0
    if not modes:
        return None
    log_scores, middles = np.log(scores), np.array(modes)
    prediction = next((one for one in expected if one.is_prediction), None)
    by_box = [one for one in expected if not one.is_prediction]
    for one in by_box:
        log_scores += one.log_likelihoods(middles)
    if prediction is not None:
        seen = modes[int(np.argmax(log_scores))]
        log_scores += prediction.log_likelihoods(middles)
        if not prediction.is_within(modes[int(np.argmax(log_scores))], _PREDICTION_GATE):
            agrees = by_box and all(one.is_within(seen, _AGREES_WITHIN) for one in by_box)
            return (seen, seen) if agrees and seen > prediction.depth else None
    best = int(np.argmax(log_scores))
    farthest = max(
        mode
        for mode, score in zip(modes, log_scores, strict=True)
        if score >= log_scores[best] + _RIVAL_LOG_SCORE
    )
    return modes[best], farthest


def _histogram(depths: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """(_BINS,) sums of weights."""
    bins = (np.log(depths / _NEAREST) / _BIN).astype(np.intp)
    return np.bincount(bins, weights, _BINS).astype(np.float64, copy=False)


def _window_sums(histogram: NDArray[np.float64]) -> NDArray[np.float64]:
    """(_BINS,) sum of the histogram over the window of each bin."""
    cumulated = np.empty(_BINS + 1)
    cumulated[0] = 0.0
    np.cumsum(histogram, out=cumulated[1:])
    return cumulated[_WINDOW_END] - cumulated[_WINDOW_START]


def _share_nearer(depths: NDArray[np.float64], target: ExpectedDepth) -> float:
    margin = math.hypot(_NEARER_BY, _NEARER_SDS * target.sd / target.depth)
    return float(np.count_nonzero(depths < math.exp(-margin) * target.depth)) / len(depths)


_BIN_CENTERS = _NEAREST * np.exp((np.arange(_BINS) + 0.5) * _BIN)
_REACH = _EXTENT + _RELATIVE_EXTENT * _BIN_CENTERS
_BIN_EDGES = _NEAREST * np.exp(np.arange(_BINS + 1) * _BIN)
_WINDOW_START = np.searchsorted(_BIN_EDGES, _BIN_CENTERS - _REACH)
_WINDOW_END = np.searchsorted(_BIN_EDGES, _BIN_CENTERS + _REACH) - 1
