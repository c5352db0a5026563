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

from pf_tracker_ros.boxes import BoxGrid
from pf_tracker_ros.cues.cue import (
    CUES,
    Cue,
    CueParameters,
    box_sums,
    box_sums_on_grid,
    declared_weight,
)
from pf_tracker_ros.frames import Frame, Region
from pf_tracker_ros.parameters import declared


@dataclass(frozen=True)
class ForegroundParameters(CueParameters):
    """The foreground cue."""

    weight: float = declared_weight(0.25)
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
        return self._log_likelihood(self.contrast(region, boxes))

    def log_likelihood_on_grid(
        self, region: Region, grid: BoxGrid, template: None
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood_on_grid`; edges are found once for each row and column."""
        if region.frame.foreground is None:
            return np.zeros(len(grid.top) * len(grid.left))
        return self._log_likelihood(self.contrast_on_grid(region, grid).ravel())

    def _log_likelihood(self, contrast: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._sharpness * (contrast - 1.0)

    def match(self, seen: None, template: None) -> None:
        """See `Cue.match`; that something moves there does not tell whether it is the target."""
        return None

    def blend(self, template: None, seen: None) -> None:
        """See `Cue.blend`."""
        return None

    def contrast(self, region: Region, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) share of foreground in (N, 4) boxes minus that in their rings, -1 to 1.

        Pixels of the mask are counted whole and areas are not, so that the share in a box of few
        pixels is off by up to one row and one column of them.

        Raises:
            ValueError: There is no mask.
        """
        integral, reduction = _integral(region.frame)
        # In memory as it is read, each of x, y, width and height in a row.
        x, y, width, height = np.ascontiguousarray(boxes.T)
        columns = self._edges(x, width, reduction, integral.shape[1] - 1)
        rows = self._edges(y, height, reduction, integral.shape[0] - 1)
        inside, outer = box_sums(integral, columns, rows)
        return self._contrast(inside, outer, width, height, reduction)

    def contrast_on_grid(self, region: Region, grid: BoxGrid) -> NDArray[np.float64]:
        """(rows, columns) the same of the boxes of a grid."""
        integral, reduction = _integral(region.frame)
        width, height = grid.size
        columns = self._edges(grid.left, width, reduction, integral.shape[1] - 1)
        rows = self._edges(grid.top, height, reduction, integral.shape[0] - 1)
        inside, outer = (
            box_sums_on_grid(integral, *edges) for edges in zip(columns, rows, strict=True)
        )
        return self._contrast(inside, outer, width, height, reduction)

    def _edges(
        self,
        starts: NDArray[np.float64],
        sides: NDArray[np.float64] | np.float64,
        reduction: int,
        length: int,
    ) -> NDArray[np.intp]:
        """Edges along an axis, each the one next to it between pixels of the mask.

        Args:
            starts: (N,) of boxes, image pixels.
            sides: (N,) or one for all.
            reduction: Image pixels to one of the mask's.
            length: Pixels of the mask.

        Returns:
            (2, 2, N): of the boxes, then of the rings; where they start, then where they end.
        """
        beyond = self._ring * sides
        edges = np.empty((2, 2, len(starts)))
        np.divide(starts, reduction, out=edges[0, 0])
        np.add(edges[0, 0], sides / reduction, out=edges[0, 1])
        np.divide(starts - beyond, reduction, out=edges[1, 0])
        np.add(edges[1, 0], (sides + 2 * beyond) / reduction, out=edges[1, 1])
        whole = np.minimum(np.maximum(np.rint(edges, out=edges), 0, out=edges), length, out=edges)
        return whole.astype(np.intp)

    def _contrast(
        self,
        inside: NDArray[np.int32],
        outer: NDArray[np.int32],
        width: NDArray[np.float64] | np.float64,
        height: NDArray[np.float64] | np.float64,
        reduction: int,
    ) -> NDArray[np.float64]:
        """What boxes have above their rings, from the mask's sums over both and their sizes."""
        area = width * height / reduction**2
        across, down = self._ring * width, self._ring * height
        ring_area = (width + 2 * across) * (height + 2 * down) / reduction**2 - area
        contrast = (inside / area - (outer - inside) / ring_area) / 255.0
        return np.minimum(np.maximum(contrast, -1.0), 1.0)


def _integral(frame: Frame) -> tuple[NDArray[np.int32], int]:
    """The integral image of a frame's mask, and the image pixels to one of its pixels."""
    if frame.foreground is None:
        raise ValueError("the frame has no foreground")
    mask, reduction = frame.foreground

    def integrate() -> NDArray[np.int32]:
        return cv2.integral(mask, sdepth=cv2.CV_32S)

    return frame.cached("foreground integral", integrate), reduction
