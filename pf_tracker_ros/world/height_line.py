"""Heights of boxes over their lower edges: the ground before a level camera.

A level camera with the focal length f at the height H above the ground sees a target of the height
h at the distance D as f h / D pixels high, with its lower edge f H / D below the horizon. So boxes
on the ground are on a line,

    height = (h / H) (lower edge - horizon),

which needs neither a calibration nor a known height. With both, it gives the camera's height and
pitch, from which the fit of the plane starts (`ground_from_people`).

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
    """

    lower_edge: float
    height: float
    slope: float

    @classmethod
    def fit(cls, lower_edges: NDArray[np.float64], heights: NDArray[np.float64]) -> HeightLine:
        """The line of (N,) boxes, N >= 1, by least squares."""
        lower_edge, height = float(lower_edges.mean()), float(heights.mean())
        offsets = lower_edges - lower_edge
        # 1 px^2 more, since all lower edges may be equal.
        squares = float(offsets @ offsets) + 1.0
        return cls(lower_edge, height, float(offsets @ heights) / squares)
