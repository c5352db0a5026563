"""Cell means: colors or brightness, and edges, averaged over large cells.

Features of one's own for the correlation filter, complete. As a file in
`pf_tracker_ros/cues/features` they are there: nothing else has to know of them. With a second kind
to choose from, `correlation_response.features` is a parameter, and `cell_means` chooses this one.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.features.features import FEATURES
from pf_tracker_ros.cues.features.gradients_and_colors import GradientsAndColors
from pf_tracker_ros.parameters import declared


# What can be tuned; the full name is `correlation_response.cell_means.edge_weight`.
@dataclass(frozen=True)
class CellMeansParameters:
    """Cell means."""

    edge_weight: float = declared(
        1.0, "Weight of the edges beside the colors.", minimum=0.0, maximum=100.0
    )


# The cue brings its windows to `cell_size` pixels a cell before it asks for its channels, so a larger
# stride sees finer detail, and costs more.
@FEATURES.register("cell_means", CellMeansParameters)
class CellMeans:
    """Mean of each color, or of the gray levels, and mean steepness across and down, by cell."""

    cell_size = 8
    # How sure the tracker is follows from these numbers: until they are measured for these features
    # (`benchmarks/uncertainty.py`), those of others have to do.
    calibration = GradientsAndColors.calibration

    def __init__(self, parameters: CellMeansParameters) -> None:
        self._edge_weight = parameters.edge_weight

    def extract(self, windows: NDArray[np.uint8]) -> NDArray[np.float32]:
        """See `Features.extract`."""
        return np.stack([self._channels(window) for window in windows])

    def _channels(self, window: NDArray[np.uint8]) -> NDArray[np.float32]:
        """(channels, cells, cells) of one of them."""
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
