"""Brightness cue: the mean gray level of a box.

A complete example of a cue. The file alone, in `pf_tracker_ros/cues` or declared by an entry point,
adds it. `brightness` in the parameter `cues` selects it and activates its parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.cue import CUES, Cue, CueParameters, Match, declared_keep, declared_weight
from pf_tracker_ros.frames.region import Region, nearest_pixel
from pf_tracker_ros.parameters import declared


# The parameters with their ranges. Their full names are `brightness.weight`, which every cue has,
# `brightness.sharpness` and `brightness.keep`.
@dataclass(frozen=True)
class BrightnessParameters(CueParameters):
    """The brightness cue."""

    weight: float = declared_weight(0.2)
    sharpness: float = declared(
        0.1,
        "How fast the likelihood falls with the difference of the brightness.",
        unit="per gray level",
        minimum=0.0,
        maximum=10.0,
    )
    keep: float = declared_keep(0.9)


# One cue serves all targets and is stateless. `learn` returns a template, here a float, and the
# other methods receive it.
@CUES.register("brightness", BrightnessParameters)
class Brightness(Cue):
    """Difference of a box's mean gray level from the target's.

    Args:
        parameters: Sharpness and rate of template updates.
    """

    def __init__(self, parameters: BrightnessParameters) -> None:
        self._sharpness = parameters.sharpness
        self._keep = parameters.keep

    def learn(self, region: Region, box: NDArray[np.float64]) -> float:
        """See `Cue.learn`."""
        return float(self._means(region, box[None])[0])

    def log_likelihood(
        self, region: Region, boxes: NDArray[np.float64], template: float
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood`; all boxes are computed at once."""
        return -self._sharpness * np.abs(self._means(region, boxes) - template)

    def match(self, observation: float, template: float) -> Match:
        """See `Cue.match`; the similarity is 0 between black and white."""
        difference = abs(observation - template)
        return Match(-self._sharpness * difference, 1.0 - difference / 255.0)

    def blend(self, template: float, observation: float) -> float:
        """See `Cue.blend`."""
        return self._keep * template + (1.0 - self._keep) * observation

    def _means(self, region: Region, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) mean gray levels of the parts of (N, 4) boxes inside the image."""

        def integrate() -> NDArray[np.int32]:
            return cv2.integral(region.gray, sdepth=cv2.CV_32S)

        # Boxes overlap, so the region caches a map that all of them read.
        integral = region.cached("brightness", integrate)
        height, width = region.gray.shape
        top, _, left, _ = region.padding
        x, y, box_width, box_height = region.region_boxes(boxes).T
        # `region.gray` is without the padding, which is outside the image.
        x0, x1 = (np.clip(nearest_pixel(edge) - left, 0, width) for edge in (x, x + box_width))
        y0, y1 = (np.clip(nearest_pixel(edge) - top, 0, height) for edge in (y, y + box_height))
        sums = integral[y1, x1] - integral[y0, x1] - integral[y1, x0] + integral[y0, x0]
        return sums / np.maximum((x1 - x0) * (y1 - y0), 1)
