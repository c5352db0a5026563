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

from pf_tracker_ros.boxes import BoxesByAxis, BoxGrid
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
        return self._log_likelihood(region, BoxesByAxis(*np.ascontiguousarray(boxes.T)))

    def log_likelihood_on_grid(
        self, region: Region, grid: BoxGrid, template: None
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood_on_grid`; edges are found once for each row and column."""
        return self._log_likelihood(region, grid.by_axis).ravel()

    def _log_likelihood(self, region: Region, boxes: BoxesByAxis) -> NDArray[np.float64]:
        if region.frame.foreground is None:
            return np.zeros(np.broadcast_shapes(*map(np.shape, boxes)))
        return self._sharpness * (self.contrast(region, boxes) - 1.0)

    def match(self, seen: None, template: None) -> None:
        """See `Cue.match`; that something moves there does not tell whether it is the target."""
        return None

    def blend(self, template: None, seen: None) -> None:
        """See `Cue.blend`."""
        return None

    def contrast(self, region: Region, boxes: BoxesByAxis) -> NDArray[np.float64]:
        """Share of foreground in boxes minus that in their rings, -1 to 1; one for each box.

        Pixels of the mask are counted whole and areas are not, so that the share in a box of few
        pixels is off by up to one row and one column of them.
        """
        mask, reduction = region.frame.foreground or Foreground(np.zeros((1, 1), np.uint8), 1)

        def integrate() -> NDArray[np.int32]:
            return cv2.integral(mask, sdepth=cv2.CV_32S)

        integral = region.frame.share("foreground integral", integrate)
        x, y, width, height = boxes
        across, down = self._ring * width, self._ring * height
        around = BoxesByAxis(x - across, y - down, width + 2 * across, height + 2 * down)
        inside, outside = (_sums(integral, reduction, some) for some in (boxes, around))
        area = width * height / reduction**2
        ring_area = around.width * around.height / reduction**2 - area
        contrast = (inside / area - (outside - inside) / ring_area) / 255.0
        return np.minimum(np.maximum(contrast, -1.0), 1.0)


def _sums(integral: NDArray[np.int32], reduction: int, boxes: BoxesByAxis) -> NDArray[np.int32]:
    """Sums over boxes in image pixels; their broken edges go to the nearest pixel of the mask."""
    x, y, width, height = (side / reduction for side in boxes)
    (left, right), (top, bottom) = (
        np.minimum(np.maximum(np.rint([start, start + side]), 0), length - 1).astype(np.intp)
        for start, side, length in ((x, width, integral.shape[1]), (y, height, integral.shape[0]))
    )
    sums: NDArray[np.int32] = (
        integral[bottom, right]
        - integral[top, right]
        - integral[bottom, left]
        + integral[top, left]
    )
    return sums
