"""Cell means: colors or brightness, and edges, averaged over large cells.

A complete example of features for the correlation filter. The file alone, in
`pf_tracker_ros/cues/features` or declared by an entry point, adds them. With more than one kind,
`correlation_response.features` is a parameter, and `cell_means` selects this one.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.features.features import FEATURES
from pf_tracker_ros.cues.features.gradients_and_colors import GradientsAndColors
from pf_tracker_ros.parameters import declared


# The full name is `correlation_response.cell_means.edge_weight`.
@dataclass(frozen=True)
class CellMeansParameters:
    """Cell means."""

    edge_weight: float = declared(
        1.0, "Weight of the edges relative to the colors.", minimum=0.0, maximum=100.0
    )


# The cue resizes its windows to `cell_size` pixels per cell, so a larger cell size has finer detail
# and costs more.
@FEATURES.register("cell_means", CellMeansParameters)
class CellMeans:
    """Mean of each color or of the gray levels, and mean horizontal and vertical gradients."""

    cell_size = 8
    # The confidence depends on the calibration. Until it is measured for these features, by
    # `benchmarks/uncertainty.py`, use that of others.
    calibration = GradientsAndColors.calibration

    def __init__(self, parameters: CellMeansParameters) -> None:
        self._edge_weight = parameters.edge_weight

    def extract(self, windows: NDArray[np.uint8]) -> NDArray[np.float32]:
        """See `Features.extract`."""
        return np.stack([self._channels(window) for window in windows])

    def _channels(self, window: NDArray[np.uint8]) -> NDArray[np.float32]:
        """(channels, cells, cells) channels of one window."""
        gray = cv2.cvtColor(window, cv2.COLOR_BGR2GRAY) if window.ndim == 3 else window
        planes = list(cv2.split(window))
        weight = self._edge_weight
        planes += [weight * np.abs(cv2.Sobel(gray, cv2.CV_32F, *axis)) for axis in ((1, 0), (0, 1))]
        cells = len(window) // self.cell_size
        return np.stack(
            [
                cv2.resize(plane.astype(np.float32), (cells, cells), interpolation=cv2.INTER_AREA)
                for plane in planes
            ]
        )
