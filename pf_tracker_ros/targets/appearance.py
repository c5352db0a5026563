"""What is in a box, told so that targets can be told apart over a long time.

A cue's template follows its target from frame to frame, and takes in what hides it. This is made of
what a detector has confirmed, and changes slowly.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.frames.tiles import Part

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

# (stripes * levels,) square roots of the shares of the colors.
Look = NDArray[np.float32]


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


def look_at(frame: Frame, box: NDArray[np.float64]) -> Look:
    """The look of what is in a (4,) box, whose center is inside the image."""
    (left, right), (top, bottom) = (
        _inner(start, side, inset, length)
        for start, side, inset, length in zip(
            box[:2], box[2:], (_INSET_ACROSS, _INSET_DOWN), frame.size, strict=True
        )
    )
    crop = frame.view(Part(top, bottom, left, right))
    crop = cv2.resize(crop, (_COLUMNS, _ROWS), interpolation=cv2.INTER_AREA)
    if crop.ndim == 2:
        crop = cv2.cvtColor(crop, cv2.COLOR_GRAY2BGR)
    colors = cv2.cvtColor(crop, cv2.COLOR_BGR2LAB).reshape(-1, 3)
    # Between two steps a pixel counts for both: light that changes a little changes little.
    places = np.clip((colors - _MIDDLE) * _SCALE, 0.0, 1.0) * _LEVELS - 0.5
    lower = np.floor(places)
    upper_share = (places - lower).T
    lower = lower.T
    # (3, 2, pixels): of each color the steps below and above, and their shares.
    steps = np.clip([lower, lower + 1.0], 0, _LEVELS[:, None] - 1).astype(np.intp)
    first, second, third = np.swapaxes(steps, 0, 1)
    one, two, three = np.swapaxes([1.0 - upper_share, upper_share], 0, 1)
    bins = first[:, None, None] * _LEVELS[1] + second[:, None]
    bins = bins * _LEVELS[2] + third + _STRIPE
    shares = one[:, None, None] * two[:, None] * three * _WEIGHTS
    counts = np.bincount(bins.ravel(), shares.ravel(), minlength=_STRIPES * _BINS)
    return np.sqrt(counts / _WEIGHTS.sum()).astype(np.float32)


def unlikeness(one: Look, other: Look) -> float:
    """How far two looks differ, 0 (the same) to 1 (nothing in common)."""
    return max(1.0 - float(one @ other), 0.0)


def blend(look: Look, seen: Look, share: float) -> Look:
    """A look moved to another by a share, 0 to 1."""
    return np.sqrt((1.0 - share) * np.square(look) + share * np.square(seen))


def _inner(start: float, side: float, inset: float, length: int) -> tuple[int, int]:
    """Whole pixels of a side without its insets, at least one, inside the image."""
    first = int(np.clip(start + inset * side, 0, length - 1))
    return first, int(np.clip(np.ceil(start + (1.0 - inset) * side), first + 1, length))
