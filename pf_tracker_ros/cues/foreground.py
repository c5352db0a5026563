"""Foreground cue: moving objects, by their difference from the background model.

1. The contrast of a box is the share of foreground inside minus the share in the ring around it,
   -1 to 1, from an integral image of the foreground mask.
2. log p = sharpness * (contrast - 1).

The cue has no template and responds to every moving object. Another cue must distinguish them.

The sum over a box of an integral image I, which holds at each place the sum of all pixels above and
left, takes four values: I(bottom, right) - I(top, right) - I(bottom, left) + I(top, left).

Sources: Zhang Bo, sections 2 and 3.3 (the background is extracted before the target is measured);
Viola, Jones 2001, "Rapid object detection using a boosted cascade of simple features" (integral
images).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxGrid
from pf_tracker_ros.cues.cue import CUES, Cue, CueParameters, declared_weight
from pf_tracker_ros.frames import Frame, Region
from pf_tracker_ros.parameters import declared

Value = TypeVar("Value", np.int32, np.float64)


def box_sums(
    integral: NDArray[Value], columns: NDArray[np.intp], rows: NDArray[np.intp]
) -> NDArray[Value]:
    """(..., N) sums over N boxes, from a (h + 1, w + 1) integral image.

    The (..., 2, N) columns are their left and right edges, the rows the top and bottom edges.
    """
    starts = rows * integral.shape[1]
    corners = integral.ravel().take(starts[..., :, None, :] + columns[..., None, :, :])
    across = corners[..., 1, :] - corners[..., 0, :]
    return across[..., 1, :] - across[..., 0, :]


def box_sums_on_grid(
    integral: NDArray[Value], columns: NDArray[np.intp], rows: NDArray[np.intp]
) -> NDArray[Value]:
    """(R, C) sums over a grid of boxes, from a (h + 1, w + 1) integral image.

    The (2, C) columns are their left and right edges, the (2, R) rows the top and bottom edges.
    """
    down = integral.take(rows[1], axis=0)
    down -= integral.take(rows[0], axis=0)
    return down.take(columns[1], axis=1) - down.take(columns[0], axis=1)


@dataclass(frozen=True)
class ForegroundParameters(CueParameters):
    """The foreground cue."""

    weight: float = declared_weight(0.25)
    sharpness: float = declared(
        20.0,
        "How fast the likelihood falls with a falling foreground contrast between box and ring.",
        minimum=0.0,
        maximum=1000.0,
    )


@CUES.register("foreground", ForegroundParameters)
class ForegroundCue(Cue):
    """Share of foreground in the box minus the share in the ring around it.

    Args:
        parameters: Sharpness.
        ring: Width of the ring on each side of the box, box sides.
    """

    needs_foreground = True
    joins_search = True

    def __init__(self, parameters: ForegroundParameters, *, ring: float = 0.3) -> None:
        self._ring = ring
        self._sharpness = parameters.sharpness

    def learn(self, region: Region, box: NDArray[np.float64]) -> None:
        """See `Cue.learn`; there is no template."""
        return None

    def log_likelihood(
        self, region: Region, boxes: NDArray[np.float64], template: None
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood`; without a foreground mask, all are 0."""
        if region.frame.foreground is None:
            return np.zeros(len(boxes))
        return self._log_likelihood(self.contrast(region, boxes))

    def log_likelihood_on_grid(
        self, region: Region, grid: BoxGrid, template: None
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood_on_grid`; edges are computed once per row and column."""
        if region.frame.foreground is None:
            return np.zeros(len(grid.top) * len(grid.left))
        return self._log_likelihood(self.contrast_on_grid(region, grid).ravel())

    def _log_likelihood(self, contrast: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._sharpness * (contrast - 1.0)

    def match(self, observation: None, template: None) -> None:
        """See `Cue.match`; foreground does not identify the target."""
        return None

    def blend(self, template: None, observation: None) -> None:
        """See `Cue.blend`."""
        return None

    def contrast(self, region: Region, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N,) contrasts, -1 to 1, of (N, 4) boxes.

        Box edges are rounded to whole mask pixels but areas are not, so the share in a small box
        has an error of up to one row and one column.

        Raises:
            ValueError: There is no mask.
        """
        integral, reduction = _integral(region.frame)
        # Contiguous in the order of access.
        x, y, width, height = np.ascontiguousarray(boxes.T)
        columns = self._edges(x, width, reduction, integral.shape[1] - 1)
        rows = self._edges(y, height, reduction, integral.shape[0] - 1)
        inside, outer = box_sums(integral, columns, rows)
        return self._contrast(inside, outer, width, height, reduction)

    def contrast_on_grid(self, region: Region, grid: BoxGrid) -> NDArray[np.float64]:
        """(rows, columns) contrasts of the boxes of a grid."""
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
        """(2, 2, N) edges along an axis, mask pixels: of boxes and rings, then first and last.

        The (N,) starts and the sides, one for each or for all, are image pixels, of which a mask
        pixel has `reduction`. The mask has `length` pixels.
        """
        margin = self._ring * sides
        edges = np.empty((2, 2, len(starts)))
        np.divide(starts, reduction, out=edges[0, 0])
        np.add(edges[0, 0], sides / reduction, out=edges[0, 1])
        np.divide(starts - margin, reduction, out=edges[1, 0])
        np.add(edges[1, 0], (sides + 2 * margin) / reduction, out=edges[1, 1])
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
        """Contrasts, from the mask's sums inside the boxes and in both, and the boxes' sizes."""
        area = width * height / reduction**2
        across, down = self._ring * width, self._ring * height
        ring_area = (width + 2 * across) * (height + 2 * down) / reduction**2 - area
        contrast = (inside / area - (outer - inside) / ring_area) / 255.0
        return np.minimum(np.maximum(contrast, -1.0), 1.0)


def _integral(frame: Frame) -> tuple[NDArray[np.int32], int]:
    """Integral image of a frame's mask, and image pixels per mask pixel."""
    if frame.foreground is None:
        raise ValueError("the frame has no foreground")
    mask, reduction = frame.foreground

    def integrate() -> NDArray[np.int32]:
        return cv2.integral(mask, sdepth=cv2.CV_32S)

    return frame.cached("foreground integral", integrate), reduction
