"""Color stripes: color histograms of the horizontal stripes of a box.

1. The inner part of the box is resized to a fixed number of pixels and converted to CIE Lab.
2. Each pixel, weighted by its distance from the center, is added to the histogram of its stripe. It
   is shared by neighboring bins, so small changes of light change little.
3. The descriptor has the square roots of all bins; the distance is 1 minus the dot product, which
   is the Bhattacharyya coefficient.
4. `find` searches an image by the mean log likelihood ratio of the colors, target against image, in
   each stripe of each box, from integral images.
"""

from __future__ import annotations

import itertools
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances.appearance import APPEARANCES, Appearance, Descriptor
from pf_tracker_ros.boxes import BoxesByAxis, pairwise_iou
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.frames.frame import PixelRect

# Stripes from top to bottom: clothes differ along a body in every pose.
_STRIPES = 4
# Bins of L, a and b; a and b are clipped to a range around gray.
_LEVELS = np.array([8, 10, 10])
_SCALE = np.array([1 / 256, 1 / 96, 1 / 96])
_LOWEST = np.array([0.0, 128.0 - 48.0, 128.0 - 48.0])
# Share of the box omitted at each side, mostly background.
_INSET_ACROSS, _INSET_DOWN = 0.2, 0.05
# Pixels of the resized box.
_ROWS, _COLUMNS = 36, 12
# Decrease of the pixel weight from the center to the sides, and to the ends.
_DECREASE_ACROSS, _DECREASE_DOWN = 0.9, 0.7

# In a search: smallest width of a box without insets, reduced pixels; steps per box width, with
# twice as many per box height.
_SEARCHED_COLUMNS, _STEPS = 6, 5
# Largest number of pixels of the reduced image.
_MAX_SEARCHED = 60_000
# Added to the shares of every color; weight of the mean of all stripes in each stripe.
_PRIOR_SHARE, _OTHER_STRIPES = 0.002, 0.1
# A box with a larger intersection over union with an excluded one is skipped.
_EXCLUDED_ABOVE = 0.4


def _weights() -> NDArray[np.float64]:
    """(rows * columns,) weights of the pixels."""
    down, across = (
        np.square((np.arange(count) + 0.5) / count * 2.0 - 1.0) for count in (_ROWS, _COLUMNS)
    )
    weights = 1.0 - _DECREASE_DOWN * down[:, None] - _DECREASE_ACROSS * across
    return np.maximum(weights, 0.02).ravel()


_WEIGHTS = _weights()
_BINS = int(_LEVELS.prod())
_STRIPE = np.repeat(np.arange(_ROWS) * _STRIPES // _ROWS * _BINS, _COLUMNS)


@APPEARANCES.register("color_stripes")
class ColorStripes(Appearance):
    """Square roots of the color histograms of the stripes; D = 4 * 800."""

    def extract(self, frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.float32]:
        """See `Appearance.extract`."""
        resized = []
        for box in boxes:
            (left, right), (top, bottom) = (
                _inner(start, side, inset, length)
                for start, side, inset, length in zip(
                    box[:2].tolist(),
                    box[2:].tolist(),
                    (_INSET_ACROSS, _INSET_DOWN),
                    frame.size,
                    strict=True,
                )
            )
            crop = frame.view(PixelRect(top, bottom, left, right))
            resized.append(cv2.resize(crop, (_COLUMNS, _ROWS), interpolation=cv2.INTER_AREA))
        if not resized:
            return np.empty((0, _STRIPES * _BINS), dtype=np.float32)
        # Each pixel is shared by the two nearest bins of each axis: (2, pixels) for each.
        channels = _lab(np.concatenate(resized)).reshape(-1, 3).T
        first, second, third = (
            steps.take(channel, axis=1)
            for steps, channel in zip(_STEPS_TO_BIN, channels, strict=True)
        )
        one, two, three = (
            shares.take(channel, axis=1) for shares, channel in zip(_SHARES, channels, strict=True)
        )
        first_bins = np.arange(len(boxes))[:, None] * (_STRIPES * _BINS) + _STRIPE
        bins = first[:, None, None] + second[:, None] + (third + first_bins.ravel())
        shares = one[:, None, None] * two[:, None] * three
        shares = shares.reshape(2, 2, 2, len(boxes), -1) * _WEIGHTS
        size = len(boxes) * _STRIPES * _BINS
        counts = np.bincount(bins.ravel(), shares.ravel(), minlength=size)
        counts = counts.reshape(len(boxes), _STRIPES * _BINS)
        return np.sqrt(counts / _WEIGHTS.sum()).astype(np.float32)

    def distance(self, descriptor: Descriptor, others: NDArray[np.float32]) -> NDArray[np.float64]:
        """See `Appearance.distance`: 1 minus the Bhattacharyya coefficient."""
        return np.maximum(1.0 - (others @ descriptor).astype(np.float64), 0.0)

    def blend(self, descriptor: Descriptor, other: Descriptor, share: float) -> Descriptor:
        """See `Appearance.blend`."""
        return np.sqrt((1.0 - share) * np.square(descriptor) + share * np.square(other))

    def find(
        self,
        frame: Frame,
        descriptor: Descriptor,
        size: NDArray[np.float64],
        excluded: NDArray[np.float64],
        max_count: int,
    ) -> list[NDArray[np.float64]]:
        """See `Appearance.find`; compare the descriptors of the returned boxes to confirm them."""
        pixels = frame.size[0] * frame.size[1]
        of_box = math.floor((1.0 - 2.0 * _INSET_ACROSS) * size[0] / _SEARCHED_COLUMNS)
        reduction = max(of_box, math.ceil(math.sqrt(pixels / _MAX_SEARCHED)), 1)
        across, down = size / reduction
        # Centers are inside the image, which may end within a reduced pixel.
        ends = np.array(frame.size) / reduction - (across / 2, down / 2)
        x = np.arange(-across / 2, ends[0], max(across / _STEPS, 1.0))
        y = np.arange(-down / 2, ends[1], max(down / (2 * _STEPS), 1.0))
        log_ratio = _log_ratio(frame, descriptor, reduction, BoxesByAxis(x, y, across, down))
        corners = np.stack(np.broadcast_arrays(x * reduction, y[:, None] * reduction), axis=-1)
        boxes = np.concatenate([corners, np.broadcast_to(size, corners.shape)], axis=-1)
        if len(excluded):
            overlap = pairwise_iou(boxes.reshape(-1, 4), excluded).max(axis=1)
            log_ratio[(overlap > _EXCLUDED_ABOVE).reshape(log_ratio.shape)] = -np.inf
        best: list[NDArray[np.float64]] = []
        for _ in range(max_count):
            row, column = divmod(int(log_ratio.argmax()), len(x))
            if log_ratio[row, column] == -np.inf:
                break
            best.append(boxes[row, column])
            is_near = np.abs(y - y[row]) < down / 2, np.abs(x - x[column]) < across / 2
            log_ratio[np.ix_(*is_near)] = -np.inf
        return best


def _lab(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(h, w, 3) CIE Lab of (h, w, 3) BGR or (h, w) gray pixels."""
    color = cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR) if pixels.ndim == 2 else pixels
    return cv2.cvtColor(color, cv2.COLOR_BGR2LAB)


def _in_bins(lab: NDArray[np.generic]) -> NDArray[np.float64]:
    """(..., 3) Lab values, 0 to 255, in units of bins, 0 to `_LEVELS`."""
    return np.clip((lab - _LOWEST) * _SCALE, 0.0, 1.0) * _LEVELS


def _bins(frame: Frame, reduction: int) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """The bin of each pixel of a reduced image, and the share of each bin."""
    width, height = (-(-length // reduction) for length in frame.size)
    colors = _lab(frame.view(PixelRect(0, height, 0, width), reduction))
    first, second, third = cv2.split(cv2.LUT(colors, _BIN_TABLE))
    bins = (first.astype(np.intp) * _LEVELS[1] + second) * _LEVELS[2] + third
    return bins, np.bincount(bins.ravel(), minlength=_BINS) / bins.size


def _log_ratio(
    frame: Frame, descriptor: Descriptor, reduction: int, boxes: BoxesByAxis
) -> NDArray[np.float64]:
    """(rows, columns) log likelihood ratios of target and image for (columns,) x (rows,) boxes.

    Each sums, over the stripes, the mean log ratio of each color's share in the descriptor to that
    in the image. Edges and common sides of the boxes are reduced pixels.
    """
    bins, shares = frame.cached(("color bins", reduction), lambda: _bins(frame, reduction))
    target = np.square(descriptor.reshape(_STRIPES, _BINS)) * _STRIPES
    # Stripes are not exactly aligned, so each includes some of the others.
    target = (1.0 - _OTHER_STRIPES) * target + _OTHER_STRIPES * target.mean(axis=0)
    by_color = np.log((target + _PRIOR_SHARE) / (shares + _PRIOR_SHARE)).astype(np.float32)
    height, width = bins.shape
    left, right = _edges(boxes.x, boxes.width, (_INSET_ACROSS, 1.0 - _INSET_ACROSS), width)
    log_ratio = np.zeros((len(boxes.y), len(boxes.x)))
    ends = np.linspace(_INSET_DOWN, 1.0 - _INSET_DOWN, _STRIPES + 1)
    for stripe, part in enumerate(itertools.pairwise(ends.tolist())):
        top, bottom = _edges(boxes.y, boxes.height, part, height)
        sums = cv2.integral(by_color[stripe][bins], sdepth=cv2.CV_64F)
        total = sums[np.ix_(bottom, right)] - sums[np.ix_(top, right)]
        total += sums[np.ix_(top, left)] - sums[np.ix_(bottom, left)]
        log_ratio += total / np.maximum((bottom - top)[:, None] * (right - left), 1)
    return log_ratio


def _bin_table() -> NDArray[np.uint8]:
    """(256, 1, 3) bin of each value of L, a and b."""
    values = np.arange(256)[:, None, None] + np.zeros(3)
    return np.minimum(_in_bins(values), _LEVELS - 1).astype(np.uint8)


_BIN_TABLE = _bin_table()


def _bins_of_values() -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """(3, 2, 256) steps to the lower and the upper bin of each value of L, a and b, and shares."""
    positions = _in_bins(np.arange(256)[:, None] + np.zeros(3)).T - 0.5
    lower = np.floor(positions)
    upper_share = positions - lower
    numbers = np.clip(np.stack([lower, lower + 1.0], axis=1), 0, _LEVELS[:, None, None] - 1)
    strides = np.array([_LEVELS[1] * _LEVELS[2], _LEVELS[2], 1])
    return (
        numbers.astype(np.intp) * strides[:, None, None],
        np.stack([1.0 - upper_share, upper_share], axis=1),
    )


_STEPS_TO_BIN, _SHARES = _bins_of_values()


def _edges(
    starts: NDArray[np.float64],
    side: NDArray[np.float64] | float,
    part: tuple[float, float],
    length: int,
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First and last edges of a part of each side, whole pixels inside the image."""
    first, last = (
        np.clip(np.rint(starts + share * side), 0, length).astype(np.intp) for share in part
    )
    return first, last


def _inner(start: float, side: float, inset: float, length: int) -> tuple[int, int]:
    """Pixel range [first, last) of a side without its insets, at least 1, inside the image."""
    first = int(min(max(start + inset * side, 0), length - 1))
    return first, min(max(math.ceil(start + (1.0 - inset) * side), first + 1), length)
