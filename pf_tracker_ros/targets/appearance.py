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
_STRIPES = 3
# Steps of each of blue, green and red.
_LEVELS = 6
# Share of the box that is left out at each side: there is seldom the target.
_INSET_ACROSS, _INSET_DOWN = 0.2, 0.05
# Pixels that are looked at, however large the box.
_ROWS, _COLUMNS = 36, 12

# (stripes * levels^3,) square roots of the shares of the colors.
Look = NDArray[np.float32]


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
    steps = crop.astype(np.intp) * _LEVELS // 256
    colors = (steps[..., 0] * _LEVELS + steps[..., 1]) * _LEVELS + steps[..., 2]
    colors += (np.arange(_ROWS) * _STRIPES // _ROWS * _LEVELS**3)[:, None]
    counts = np.bincount(colors.ravel(), minlength=_STRIPES * _LEVELS**3)
    return np.sqrt(counts / colors.size).astype(np.float32)


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
