"""Parts of a frame, brought to a number of pixels whatever their size."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames.frame import Frame
from pf_tracker_ros.frames.tiles import Part

# How many image pixels one pixel of a window may stand for before they are averaged first.
_UNREDUCED = 1.75


def read_window(
    frame: Frame, center: NDArray[np.float64], side: float, pixels: int, gray: bool = False
) -> NDArray[np.uint8]:
    """A square part of a frame, with as many pixels as asked for.

    Where that is fewer than the image has, the image's are averaged, not skipped.

    Args:
        frame: To look at.
        center: (2,) x and y of the middle, image pixels; may be outside the image.
        side: Image pixels.
        pixels: Along each side of the window.
        gray: Whether colors are of no interest.

    Returns:
        (pixels, pixels, 3) or (pixels, pixels); what is outside repeats the image's border.
    """
    reduction = max(int(side / pixels + 2.0 - _UNREDUCED), 1)
    # From here on in pixels of the reduced view.
    center, side = center / reduction, side / reduction
    (left, right), (top, bottom) = (
        _inside(middle - side / 2, middle + side / 2, -(-length // reduction))
        for middle, length in zip(center, frame.size, strict=True)
    )
    crop = frame.view(Part(top, bottom, left, right), reduction)
    if gray and crop.ndim == 3:
        crop = cv2.cvtColor(crop, cv2.COLOR_BGR2GRAY)
    step = side / pixels
    first = center - side / 2 + step / 2 - (left, top) - 0.5
    return cv2.warpAffine(
        crop,
        np.array([[step, 0.0, first[0]], [0.0, step, first[1]]]),
        (pixels, pixels),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )


def _inside(start: float, end: float, length: int) -> tuple[int, int]:
    """The whole pixels from before the start to behind the end, at least one, inside a length."""
    first = min(max(math.floor(start) - 1, 0), length - 1)
    return first, max(min(math.ceil(end) + 1, length), first + 1)
