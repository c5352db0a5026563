"""Foreground cue: what differs from the background model, and so is not background.

A box scores by the share of foreground in it minus that in the ring around it. The cue knows no
target: what moves looks alike to it, and a color cue beside it has to tell who is who.

Source: Zhang Bo, sections 2 and 3.3 (the background is extracted before the target is measured).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.cue import CUES, Cue
from pf_tracker_ros.frames import Foreground, Region
from pf_tracker_ros.parameters import declared


@dataclass(frozen=True)
class ForegroundParameters:
    """The foreground cue."""

    sharpness: float = declared(
        20.0,
        "How fast the likelihood falls as the foreground's share in the box does, against that in "
        "the ring.",
        minimum=0.0,
        maximum=1000.0,
    )


@CUES.register("foreground", ForegroundParameters)
class ForegroundCue(Cue):
    """Share of foreground in the box minus that in the ring around it.

    Args:
        parameters: Sharpness.
        ring: Width of the ring of surroundings on each side of the box, box sides.
    """

    needs_foreground = True
    joins_search = True
    usual_power = 0.25

    def __init__(self, parameters: ForegroundParameters, *, ring: float = 0.3) -> None:
        self._ring = ring
        self._sharpness = parameters.sharpness

    def learn(self, region: Region, box: NDArray[np.float64]) -> None:
        """See `Cue.learn`; there is nothing to learn."""
        return None

    def log_likelihood(
        self, region: Region, boxes: NDArray[np.float64], template: None
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood`; without a foreground mask, all boxes are alike."""
        if region.frame.foreground is None:
            return np.zeros(len(boxes))
        return self._sharpness * (self.contrast(region, boxes) - 1.0)

    def match(self, seen: None, template: None) -> None:
        """See `Cue.match`; that something moves there does not tell whether it is the target."""
        return None

    def blend(self, template: None, seen: None) -> None:
        """See `Cue.blend`."""
        return None

    def contrast(self, region: Region, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) share of foreground, 0 to 1, in (N, 4) boxes minus that in their rings."""
        mask, reduction = region.frame.foreground or Foreground(np.zeros((1, 1), np.uint8), 1)

        def integrate() -> NDArray[np.int32]:
            return cv2.integral(mask, sdepth=cv2.CV_32S)

        integral = region.frame.share("foreground integral", integrate)
        margin = self._ring * boxes[:, 2:]
        around = np.empty(boxes.shape)
        around[:, :2] = boxes[:, :2] - margin
        around[:, 2:] = boxes[:, 2:] + 2 * margin
        inside, outside = _sums(integral, boxes / reduction), _sums(integral, around / reduction)
        area = boxes[:, 2] * boxes[:, 3] / reduction**2
        ring_area = around[:, 2] * around[:, 3] / reduction**2 - area
        contrast = (inside / area - (outside - inside) / ring_area) / 255.0
        return np.minimum(np.maximum(contrast, -1.0), 1.0)


def _sums(integral: NDArray[np.int32], boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) sums over (N, 4) boxes; a box's broken edges go to the nearest pixel."""
    height, width = integral.shape
    # In memory as it is read, each of x and y in a row.
    starts = np.ascontiguousarray(boxes[:, :2].T)
    edges = np.rint([starts, starts + boxes[:, 2:].T]).astype(np.intp)
    farthest = np.array([[width - 1], [height - 1]])
    (left, top), (right, bottom) = np.minimum(np.maximum(edges, 0), farthest)
    return (
        integral[bottom, right].astype(np.float64)
        - integral[top, right]
        - integral[bottom, left]
        + integral[top, left]
    )
