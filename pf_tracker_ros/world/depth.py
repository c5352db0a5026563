"""Distance of a target from a depth image.

A box contains the target, background beside it, occluders before it, and holes.

1. Sample the box's pixels on a grid. Each has a weight: its probability to be the target's, from
   colors, times its nearness to the middle column.
2. A mode is a window of depth that holds the most weight. Remove it and find the next one.
3. Choose the mode with the most weight times the likelihood of the predicted distance. The
   prediction chooses between modes only: weighting pixels within one would confirm itself.
4. The distance is the weighted median of the pixels in the mode.

The share of pixels that are clearly nearer than the target is evidence of an occlusion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Most samples along each axis of the box.
_COLUMNS, _ROWS = 32, 48
# Width of a bin of the logarithm of depth, and depth of the first and beyond the last, meters.
_BIN, _NEAREST, _FARTHEST = 0.02, 0.1, 200.0
_BINS = math.ceil(math.log(_FARTHEST / _NEAREST) / _BIN)
# Half the extent of a mode: that of a person, meters, and noise relative to the distance.
_EXTENT, _RELATIVE_EXTENT = 0.2, 0.04
# Most modes, and least share of the weight in one.
_MODES, _MIN_SHARE = 4, 0.06
# Fewest samples with depth in the box.
_MIN_SAMPLES = 12
# Samples nearer than the target by this share are of an occluder.
_NEARER_BY = 0.12
# Weight of a pixel at the left and right edge of the box.
_EDGE_WEIGHT = 0.2
# Standard deviation of a predicted distance's logarithm, beside its own.
_PREDICTION_SD = 0.05
# Distance in standard deviations beyond which no mode is the predicted target.
_PREDICTION_GATE = 4.0
# Largest difference in aspect ratio between image and depth.
_ASPECT_TOLERANCE = 0.02
# Standard deviation of the distance: a person's thickness, meters, and a share of the distance.
_THICKNESS_SD, _RELATIVE_SD = 0.06, 0.01


@dataclass(frozen=True)
class ExpectedDepth:
    """What other measurements say of a target's depth.

    Attributes:
        depth: Along the optical axis, meters.
        sd: Standard deviation, meters.
        floor: Likelihood, relative to the peak, that a depth has at least; 0 where it is sure.
        is_farthest: Whether the target may also be nearer, as when a box contains a part of it.
    """

    depth: float
    sd: float
    floor: float = 0.0
    is_farthest: bool = False

    def log_likelihoods(self, depths: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) log likelihoods of depths, up to a constant."""
        sd = math.hypot(self.sd / self.depth, _PREDICTION_SD)
        offsets = np.log(depths / self.depth) / sd
        if self.is_farthest:
            offsets = np.maximum(offsets, 0.0)
        return np.log(np.exp(-0.5 * np.square(offsets)) + max(self.floor, 1e-300))

    def excludes(self, depth: float) -> bool:
        """Whether a depth cannot be the target's."""
        sd = math.hypot(self.sd / self.depth, _PREDICTION_SD)
        offset = math.log(depth / self.depth) / sd
        return self.floor == 0.0 and abs(offset) > _PREDICTION_GATE


@dataclass(frozen=True)
class DepthReading:
    """What a depth image says of a target.

    Attributes:
        depth: Of the target along the optical axis, meters; None where it is not seen.
        sd: Standard deviation, meters; NaN where it is not seen.
        column: Mean column of its pixels as a share of the box's width; likewise `row`.
        row: See `column`.
        occlusion: Share of the samples that are nearer than the target; None where nothing says how
            far the target is.
    """

    depth: float | None
    sd: float
    column: float
    row: float
    occlusion: float | None


@dataclass(frozen=True, eq=False)
class BoxSamples:
    """A grid of pixels in a box, in an image of any resolution.

    Attributes:
        columns: (C,) indices of the sampled columns.
        rows: (R,) of the sampled rows.
        across: (C,) positions in the box, 0 to 1 from left to right.
        down: (R,) likewise from top to bottom.
    """

    columns: NDArray[np.intp]
    rows: NDArray[np.intp]
    across: NDArray[np.float64]
    down: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        box: tuple[float, float, float, float],
        image_size: tuple[int, int],
        shape: tuple[int, ...],
    ) -> BoxSamples | None:
        """Samples of a box, at most one a pixel; None where it is outside the image.

        Args:
            box: In pixels of the camera's image.
            image_size: (width, height) of that.
            shape: Of the array to sample, whose first axes are rows and columns.
        """
        x, y, width, height = box
        columns, across = _axis(x, width, image_size[0], shape[1], _COLUMNS)
        rows, down = _axis(y, height, image_size[1], shape[0], _ROWS)
        if not (len(columns) and len(rows)):
            return None
        return cls(columns, rows, across, down)

    def take(self, array: NDArray[np.generic]) -> NDArray[np.generic]:
        """(R, C, ...) samples of an array of the shape."""
        return array[self.rows[:, None], self.columns]

    def resample(self, over_box: NDArray[np.generic]) -> NDArray[np.float64]:
        """(R, C) nearest values of a (rows, columns) map over the box.

        Raises:
            ValueError: The map has other dimensions, or values outside 0 to 1.
        """
        if over_box.ndim != 2 or over_box.size == 0 or over_box.dtype.kind not in "fiu":
            raise ValueError(
                f"target_probability is {over_box.shape} {over_box.dtype}; expected numbers in rows "
                "and columns over the box"
            )
        rows = np.clip(self.down * over_box.shape[0], 0, over_box.shape[0] - 1).astype(np.intp)
        columns = np.clip(self.across * over_box.shape[1], 0, over_box.shape[1] - 1)
        values = over_box[rows[:, None], columns.astype(np.intp)].astype(np.float64)
        if not (values.min() >= 0.0 and values.max() <= 1.0):
            raise ValueError("target_probability must be between 0 and 1")
        return values


def _axis(
    start: float, length: float, size: int, cells: int, most: int
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Indices of the cells along one axis, and their positions in the box, 0 to 1."""
    scale = cells / size
    first = max(math.floor(start * scale), 0)
    end = min(max(math.ceil((start + length) * scale), first + 1), cells)
    if first >= end:
        return np.empty(0, dtype=np.intp), np.empty(0)
    count = min(most, end - first)
    indices = (first + (np.arange(count) + 0.5) * ((end - first) / count)).astype(np.intp)
    return indices, ((indices + 0.5) / scale - start) / length


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
    expected: ExpectedDepth | None = None,
) -> DepthReading | None:
    """The depth of a target in a box.

    Args:
        depth: (H, W) float in meters or uint16 in millimeters; 0, NaN and infinity are holes.
        samples: Of the box.
        target_probability: (R, C) probability, 0 to 1, of each sample to be the target's.
        expected: What else is known of its depth; chooses between modes.

    Returns:
        None where too few samples have a depth.
    """
    values = samples.take(depth).astype(np.float64)
    if depth.dtype == np.uint16:
        values *= 1e-3
    # A comparison with NaN is false.
    is_valid = (values > _NEAREST) & (values < _FARTHEST)
    depths = values[is_valid]
    if len(depths) < min(_MIN_SAMPLES, values.size):
        return None
    middle = 1.0 - (1.0 - _EDGE_WEIGHT) * np.abs(2.0 * samples.across - 1.0)
    weights = np.broadcast_to(np.maximum(middle, _EDGE_WEIGHT), values.shape)
    if target_probability is not None:
        weights = weights * target_probability
    weights = weights[is_valid]
    mode = _choose_mode(depths, weights, expected)
    if mode is None:
        nearer = None if expected is None else _share_nearer(depths, expected.depth)
        return DepthReading(None, math.nan, 0.5, 0.5, nearer)
    reach = _EXTENT + _RELATIVE_EXTENT * mode
    inside = np.abs(depths - mode) < reach
    median = _weighted_median(depths[inside], weights[inside])
    rows, columns = np.nonzero(is_valid)
    is_sure = expected is not None and expected.floor == 0.0
    reference = expected.depth if expected is not None and is_sure else median
    return DepthReading(
        median,
        math.hypot(_THICKNESS_SD, _RELATIVE_SD * median),
        float(samples.across[columns[inside]].mean()),
        float(samples.down[rows[inside]].mean()),
        _share_nearer(depths, reference),
    )


def _choose_mode(
    depths: NDArray[np.float64], weights: NDArray[np.float64], expected: ExpectedDepth | None
) -> float | None:
    """Middle of the target's mode; None where nothing there is the target."""
    bins = (np.log(depths / _NEAREST) / _BIN).astype(np.intp)
    histogram = np.bincount(bins, weights, _BINS)
    total = float(histogram.sum())
    if total <= 0.0:
        return None
    modes, masses = [], []
    for _ in range(_MODES):
        cumulated = np.concatenate([_ZERO, np.cumsum(histogram)])
        mass = cumulated[_WINDOW_END] - cumulated[_WINDOW_START]
        best = float(mass.max())
        if best < _MIN_SHARE * total:
            break
        # The same bins are in several windows: the middle of these.
        places = np.flatnonzero(mass > best - 1e-9 * total)
        place = int(places[len(places) // 2])
        modes.append(float(_BIN_CENTERS[place]))
        masses.append(best)
        histogram[_WINDOW_START[place] : _WINDOW_END[place]] = 0.0
    if not modes:
        return None
    scores = np.log(masses)
    if expected is not None:
        scores += expected.log_likelihoods(np.array(modes))
    mode = modes[int(np.argmax(scores))]
    return None if expected is not None and expected.excludes(mode) else mode


def _weighted_median(values: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    order = np.argsort(values)
    cumulated = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(cumulated, cumulated[-1] / 2.0)]])


def _share_nearer(depths: NDArray[np.float64], depth: float) -> float:
    return float(np.count_nonzero(depths < (1.0 - _NEARER_BY) * depth)) / len(depths)


_ZERO = np.zeros(1)
_BIN_CENTERS = _NEAREST * np.exp((np.arange(_BINS) + 0.5) * _BIN)
_REACH = _EXTENT + _RELATIVE_EXTENT * _BIN_CENTERS
_BIN_EDGES = _NEAREST * np.exp(np.arange(_BINS + 1) * _BIN)
_WINDOW_START = np.searchsorted(_BIN_EDGES, _BIN_CENTERS - _REACH)
_WINDOW_END = np.searchsorted(_BIN_EDGES, _BIN_CENTERS + _REACH) - 1
