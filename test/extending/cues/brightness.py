"""Brightness cue: how bright a box is on average.

A cue of one's own, complete. As a file in `pf_tracker_ros/cues` it is there: nothing else has to
know of it. `brightness` in the parameter `cues` chooses it, and its parameters then count.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.cue import CUES, Cue, CueParameters, Match, declared_keep, declared_weight
from pf_tracker_ros.frames.region import Region, nearest_pixel
from pf_tracker_ros.parameters import declared


# What can be tuned, each with its range. The full names are `brightness.weight`, which every cue
# has, `brightness.sharpness` and `brightness.keep`.
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


# A cue is made once, for all targets, and holds nothing of any of them: what it learns of one is a
# value that `learn` returns, here a float, and that it is given back.
@CUES.register("brightness", BrightnessParameters)
class Brightness(Cue):
    """Mean gray level of a box against that of the target.

    Args:
        parameters: Sharpness, and how slowly the template changes.
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
        """See `Cue.log_likelihood`; all boxes at once, since there are hundreds."""
        return -self._sharpness * np.abs(self._means(region, boxes) - template)

    def match(self, seen: float, template: float) -> Match:
        """See `Cue.match`; the similarity is 0 between black and white."""
        difference = abs(seen - template)
        return Match(-self._sharpness * difference, 1.0 - difference / 255.0)

    def blend(self, template: float, seen: float) -> float:
        """See `Cue.blend`."""
        return self._keep * template + (1.0 - self._keep) * seen

    def _means(self, region: Region, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) mean gray levels of (N, 4) boxes, over what of them is inside the image."""

        def integrate() -> NDArray[np.int32]:
            return cv2.integral(region.gray, sdepth=cv2.CV_32S)

        # Boxes overlap, so what all of them need is computed once, when it is first asked for.
        integral = region.cached("brightness", integrate)
        height, width = region.gray.shape
        top, _, left, _ = region.padding
        x, y, box_width, box_height = region.region_boxes(boxes).T
        # The region begins at its padding, which is outside the image, and not in `region.gray`.
        x0, x1 = (np.clip(nearest_pixel(edge) - left, 0, width) for edge in (x, x + box_width))
        y0, y1 = (np.clip(nearest_pixel(edge) - top, 0, height) for edge in (y, y + box_height))
        sums = integral[y1, x1] - integral[y0, x1] - integral[y1, x0] + integral[y0, x0]
        return sums / np.maximum((x1 - x0) * (y1 - y0), 1)
