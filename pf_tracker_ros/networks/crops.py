"""Crops of a frame in the size that a network reads."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.frames.frame import PixelRect
from pf_tracker_ros.frames.region import pixel_range
from pf_tracker_ros.networks.description import ModelDescription
from pf_tracker_ros.networks.engines import Tensor


class Crop(NamedTuple):
    """A part of a frame: (2,) corner and (2,) size, pixels."""

    corner: NDArray[np.float64]
    size: NDArray[np.float64]


def mean_color(frame: Frame) -> tuple[float, ...]:
    """Mean of each channel of a frame, which fills crops beyond the image."""
    view = frame.pixels
    color: tuple[float, ...] = cv2.mean(view)[: 1 if view.ndim == 2 else 3]
    return color


def read_crop(
    frame: Frame, crop: Crop, pixels: tuple[int, int], border: tuple[float, ...]
) -> NDArray[np.uint8]:
    """(height, width) or (height, width, 3) of a part of a frame, with a border beyond it.

    Args:
        frame: The frame.
        crop: The part.
        pixels: Width and height of the result.
        border: Value of each channel beyond the image.
    """
    reduction = max(int((crop.size / pixels).min()), 1)
    # From here on, pixels are those of the reduced view.
    corner, size = crop.corner / reduction, crop.size / reduction
    (left, right), (top, bottom) = (
        pixel_range(start, start + length, -(-limit // reduction))
        for start, length, limit in zip(corner, size, frame.size, strict=True)
    )
    step = size / pixels
    first = corner + step / 2 - (left, top) - 0.5
    return cv2.warpAffine(
        frame.view(PixelRect(top, bottom, left, right), reduction),
        np.array([[step[0], 0.0, first[0]], [0.0, step[1], first[1]]]),
        pixels,
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=border,
    )


def normalized(pixels: NDArray[np.uint8], description: ModelDescription) -> Tensor:
    """(1, 3, height, width) input of a network from (height, width[, 3]) pixels."""
    if pixels.ndim == 2:
        pixels = cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR)
    values: Tensor = cv2.dnn.blobFromImage(pixels, swapRB=description.channels == "rgb")
    # Most networks have one of both, or neither.
    if any(description.mean):
        values -= np.array(description.mean, np.float32)[:, None, None]
    if any(one != 1.0 for one in description.deviation):
        values /= np.array(description.deviation, np.float32)[:, None, None]
    return values
