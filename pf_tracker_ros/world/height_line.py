"""Heights of boxes over their lower edges: the ground before a level camera.

A level camera with the focal length f at the height H above the ground sees a target of the height
h at the distance D as f h / D pixels high, with its lower edge f H / D below the horizon. So boxes
on the ground are on a line,

    height = (h / H) (lower edge - horizon),

which needs neither a calibration nor a known height. With both, it gives the camera's height and
pitch, from which the fit of the plane starts (`ground_from_people`). The heights of targets at
other places follow from it alone (`targets/external_likelihoods.py`).

Source: Hoiem, Efros and Hebert 2008, "Putting Objects in Perspective".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class HeightLine:
    """Line of box height over lower edge, through the mean of the boxes.

    Attributes:
        lower_edge: Mean of the boxes, pixels.
        height: Likewise.
        slope: Of the height over the lower edge.
        squares: Sum of the squared distances of the lower edges from their mean, px^2.
        residual_squares: Sum of the squared distances of the heights from the line, px^2.
    """

    lower_edge: float
    height: float
    slope: float
    squares: float
    residual_squares: float

    @classmethod
    def fit(cls, lower_edges: NDArray[np.float64], heights: NDArray[np.float64]) -> HeightLine:
        """The line of (N,) boxes, N >= 1, by least squares."""
        lower_edge, height = float(lower_edges.mean()), float(heights.mean())
        offsets = lower_edges - lower_edge
        # 1 px^2 more, since all lower edges may be equal.
        squares = float(offsets @ offsets) + 1.0
        slope = float(offsets @ heights) / squares
        residuals = heights - height - slope * offsets
        return cls(lower_edge, height, slope, squares, float(residuals @ residuals))

    def at(self, lower_edges: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Heights at lower edges, pixels; negative above the horizon."""
        return self.height + self.slope * (np.asarray(lower_edges) - self.lower_edge)
