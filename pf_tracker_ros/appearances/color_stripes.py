"""Color stripes: histograms of the colors in horizontal stripes of a box."""

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

# From top to bottom: clothes differ along a body, whatever its pose.
_STRIPES = 4
# Steps of lightness, and of each of the two colors; these are seldom far from gray.
_LEVELS = np.array([8, 10, 10])
_SCALE = np.array([1 / 256, 1 / 96, 1 / 96])
_MIDDLE = np.array([0.0, 128.0 - 48.0, 128.0 - 48.0])
# Share of the box that is left out at each side: there is seldom the target.
_INSET_ACROSS, _INSET_DOWN = 0.2, 0.05
# Pixels that are looked at, however large the box.
_ROWS, _COLUMNS = 36, 12
# What is at the edge counts less: so much of the weight is gone at the sides, and at the ends.
_FALLS_ACROSS, _FALLS_DOWN = 0.9, 0.7

# An image is searched with boxes of so many pixels across at least, without what is left out; in
# so many steps of a box's width, and twice as many of its height.
_SEARCHED_COLUMNS, _STEPS = 6, 5
# Pixels that are searched, however large the image.
_MOST_SEARCHED = 60_000
# What is expected of a color that was never seen, and of what is in another stripe.
_RARE, _SPILLS = 0.002, 0.1
# What overlaps something else by more than this is that.
_TAKEN_ABOVE = 0.4


def _weights() -> NDArray[np.float64]:
    """(rows * columns,) of the pixels."""
    down, across = (
        np.square((np.arange(count) + 0.5) / count * 2.0 - 1.0) for count in (_ROWS, _COLUMNS)
    )
    weights = 1.0 - _FALLS_DOWN * down[:, None] - _FALLS_ACROSS * across
    return np.maximum(weights, 0.02).ravel()


_WEIGHTS = _weights()
_BINS = int(_LEVELS.prod())
_STRIPE = np.repeat(np.arange(_ROWS) * _STRIPES // _ROWS * _BINS, _COLUMNS)


@APPEARANCES.register("color_stripes")
class ColorStripes(Appearance):
    """Square roots of the shares of the colors in stripes of a box; D = 4 * 800."""

    def extract(self, frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.float32]:
        """See `Appearance.extract`."""
        lab = np.empty((len(boxes), _ROWS, _COLUMNS, 3), dtype=np.uint8)
        for number, box in enumerate(boxes):
            (left, right), (top, bottom) = (
                _inner(start, side, inset, length)
                for start, side, inset, length in zip(
                    box[:2], box[2:], (_INSET_ACROSS, _INSET_DOWN), frame.size, strict=True
                )
            )
            crop = frame.view(PixelRect(top, bottom, left, right))
            lab[number] = _lab(cv2.resize(crop, (_COLUMNS, _ROWS), interpolation=cv2.INTER_AREA))
        # Between two steps a pixel counts for both: light that changes a little changes little.
        places = _in_steps(lab.reshape(-1, 3)) - 0.5
        lower = np.floor(places)
        upper_share = (places - lower).T
        lower = lower.T
        # (3, 2, pixels): of each color the steps below and above, and their shares.
        steps = np.clip([lower, lower + 1.0], 0, _LEVELS[:, None] - 1).astype(np.intp)
        first, second, third = np.swapaxes(steps, 0, 1)
        one, two, three = np.swapaxes([1.0 - upper_share, upper_share], 0, 1)
        bins = first[:, None, None] * _LEVELS[1] + second[:, None]
        of_box = np.arange(len(boxes))[:, None] * (_STRIPES * _BINS) + _STRIPE
        bins = bins * _LEVELS[2] + third + of_box.ravel()
        weights = np.tile(_WEIGHTS, len(boxes))
        shares = one[:, None, None] * two[:, None] * three * weights
        size = len(boxes) * _STRIPES * _BINS
        counts = np.bincount(bins.ravel(), shares.ravel(), minlength=size)
        counts = counts.reshape(len(boxes), _STRIPES * _BINS)
        return np.sqrt(counts / _WEIGHTS.sum()).astype(np.float32)

    def distance(self, descriptor: Descriptor, others: NDArray[np.float32]) -> NDArray[np.float64]:
        """See `Appearance.distance`: 1 minus the Bhattacharyya coefficient."""
        return np.maximum(1.0 - (others @ descriptor).astype(np.float64), 0.0)

    def blend(self, descriptor: Descriptor, seen: Descriptor, share: float) -> Descriptor:
        """See `Appearance.blend`."""
        return np.sqrt((1.0 - share) * np.square(descriptor) + share * np.square(seen))

    def find(
        self,
        frame: Frame,
        descriptor: Descriptor,
        size: NDArray[np.float64],
        excluded: NDArray[np.float64],
        max_count: int,
    ) -> list[NDArray[np.float64]]:
        """See `Appearance.find`.

        All places are asked, by how much oftener each color is in the descriptor than in the image;
        the descriptors of the boxes themselves tell more.
        """
        pixels = frame.size[0] * frame.size[1]
        narrow = math.floor((1.0 - 2.0 * _INSET_ACROSS) * size[0] / _SEARCHED_COLUMNS)
        reduction = max(narrow, math.ceil(math.sqrt(pixels / _MOST_SEARCHED)), 1)
        across, down = size / reduction
        # Centers are in the image, whose last pixels may be less than one of the reduced image.
        ends = np.array(frame.size) / reduction - (across / 2, down / 2)
        x = np.arange(-across / 2, ends[0], max(across / _STEPS, 1.0))
        y = np.arange(-down / 2, ends[1], max(down / (2 * _STEPS), 1.0))
        likeness = _likeness(frame, descriptor, reduction, BoxesByAxis(x, y, across, down))
        corners = np.stack(np.broadcast_arrays(x * reduction, y[:, None] * reduction), axis=-1)
        boxes = np.concatenate([corners, np.broadcast_to(size, corners.shape)], axis=-1)
        if len(excluded):
            taken = pairwise_iou(boxes.reshape(-1, 4), excluded).max(axis=1) > _TAKEN_ABOVE
            likeness[taken.reshape(likeness.shape)] = -np.inf
        best: list[NDArray[np.float64]] = []
        for _ in range(max_count):
            row, column = divmod(int(likeness.argmax()), len(x))
            if likeness[row, column] == -np.inf:
                break
            best.append(boxes[row, column])
            is_near = np.abs(y - y[row]) < down / 2, np.abs(x - x[column]) < across / 2
            likeness[np.ix_(*is_near)] = -np.inf
        return best


def _lab(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(h, w, 3) lightness and two colors of (h, w, 3) BGR or (h, w) gray pixels."""
    color = cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR) if pixels.ndim == 2 else pixels
    return cv2.cvtColor(color, cv2.COLOR_BGR2LAB)


def _in_steps(lab: NDArray[np.generic]) -> NDArray[np.float64]:
    """(..., 3) lightness and colors, 0 to 255, in steps from 0 to `_LEVELS`."""
    return np.clip((lab - _MIDDLE) * _SCALE, 0.0, 1.0) * _LEVELS


def _bins(frame: Frame, reduction: int) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """The bin of each pixel of a reduced image, and the share of each bin in it."""
    width, height = (-(-length // reduction) for length in frame.size)
    colors = _lab(frame.view(PixelRect(0, height, 0, width), reduction))
    first, second, third = cv2.split(cv2.LUT(colors, _STEP_OF))
    bins = (first.astype(np.intp) * _LEVELS[1] + second) * _LEVELS[2] + third
    return bins, np.bincount(bins.ravel(), minlength=_BINS) / bins.size


def _likeness(
    frame: Frame, descriptor: Descriptor, reduction: int, boxes: BoxesByAxis
) -> NDArray[np.float64]:
    """How much a descriptor speaks for boxes.

    Args:
        frame: They are in.
        descriptor: Looked for.
        reduction: Of the image.
        boxes: (columns,) left and (rows,) upper edges, and the sides of all, in its pixels.

    Returns:
        (rows, columns) sums over the stripes of the mean log ratio of how often a color is in the
        descriptor, and in the image.
    """
    bins, shares = frame.cached(("color bins", reduction), lambda: _bins(frame, reduction))
    wanted = np.square(descriptor.reshape(_STRIPES, _BINS)) * _STRIPES
    # A stripe may be off by some: what is in others is expected a little, too.
    wanted = (1.0 - _SPILLS) * wanted + _SPILLS * wanted.mean(axis=0)
    tells = np.log((wanted + _RARE) / (shares + _RARE)).astype(np.float32)
    height, width = bins.shape
    left, right = _edges(boxes.x, boxes.width, (_INSET_ACROSS, 1.0 - _INSET_ACROSS), width)
    likeness = np.zeros((len(boxes.y), len(boxes.x)))
    ends = np.linspace(_INSET_DOWN, 1.0 - _INSET_DOWN, _STRIPES + 1)
    for stripe, part in enumerate(itertools.pairwise(ends.tolist())):
        top, bottom = _edges(boxes.y, boxes.height, part, height)
        sums = cv2.integral(tells[stripe][bins], sdepth=cv2.CV_64F)
        total = sums[np.ix_(bottom, right)] - sums[np.ix_(top, right)]
        total += sums[np.ix_(top, left)] - sums[np.ix_(bottom, left)]
        likeness += total / np.maximum((bottom - top)[:, None] * (right - left), 1)
    return likeness


def _step_of() -> NDArray[np.uint8]:
    """(256, 1, 3) the step of each value of lightness and the two colors."""
    values = np.arange(256)[:, None, None] + np.zeros(3)
    return np.minimum(_in_steps(values), _LEVELS - 1).astype(np.uint8)


_STEP_OF = _step_of()


def _edges(
    starts: NDArray[np.float64],
    side: NDArray[np.float64] | float,
    part: tuple[float, float],
    length: int,
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Where a part of each of some sides begins and ends, whole pixels inside the image."""
    first, last = (
        np.clip(np.rint(starts + share * side), 0, length).astype(np.intp) for share in part
    )
    return first, last


def _inner(start: float, side: float, inset: float, length: int) -> tuple[int, int]:
    """Whole pixels of a side without its insets, at least one, inside the image."""
    first = int(np.clip(start + inset * side, 0, length - 1))
    return first, int(np.clip(np.ceil(start + (1.0 - inset) * side), first + 1, length))
