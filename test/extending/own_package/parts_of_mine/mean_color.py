"""An appearance: the mean color of a box, in place of a network's descriptor."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.appearances import APPEARANCES, Appearance, Descriptor
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.frames.frame import PixelRect
from pf_tracker_ros.parameters import declared


# The full name is `appearance.mean_color.scale`.
@dataclass(frozen=True)
class MeanColorParameters:
    """Mean color."""

    scale: float = declared(
        3.0,
        "Distance per difference of two colors, as a share of the largest difference.",
        minimum=0.1,
        maximum=100.0,
    )


# Without `find`, lost targets are not searched for in the whole image.
@APPEARANCES.register("mean_color", MeanColorParameters)
class MeanColor(Appearance):
    """Mean blue, green and red of the middle of a box, 0 to 1.

    Args:
        parameters: The scale.
    """

    def __init__(self, parameters: MeanColorParameters) -> None:
        self._scale = parameters.scale

    def extract(self, frame: Frame, boxes: NDArray[np.float64]) -> NDArray[np.float32]:
        """See `Appearance.extract`; a network would process all crops at once."""
        means = [self._mean(frame, box) for box in boxes]
        return np.array(means, dtype=np.float32).reshape(-1, 3) / np.float32(255.0)

    def distance(self, descriptor: Descriptor, others: NDArray[np.float32]) -> NDArray[np.float64]:
        """See `Appearance.distance`."""
        difference = np.linalg.norm(others - descriptor, axis=1).astype(np.float64)
        return np.minimum(self._scale * difference / np.sqrt(3.0), 1.0)

    def blend(self, descriptor: Descriptor, other: Descriptor, share: float) -> Descriptor:
        """See `Appearance.blend`."""
        return descriptor + np.float32(share) * (other - descriptor)

    def _mean(self, frame: Frame, box: NDArray[np.float64]) -> list[float]:
        first = np.clip(box[:2] + box[2:] / 4, 0, np.array(frame.size) - 1)
        last = np.clip(box[:2] + 3 * box[2:] / 4, first + 1, frame.size)
        (left, top), (right, bottom) = np.rint([first, last]).astype(int).tolist()
        crop = frame.view(PixelRect(top, max(bottom, top + 1), left, max(right, left + 1)))
        color = cv2.cvtColor(crop, cv2.COLOR_GRAY2BGR) if crop.ndim == 2 else crop
        return list(color.mean(axis=(0, 1)))
