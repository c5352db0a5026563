"""Learns the ground from people, where nobody gives the camera's height.

1. Collect whole boxes of trusted targets, at most two a second of each target.
2. From 50 boxes on, and with every 50 more up to 200, fit height, pitch and roll of the camera, or
   only the height where all boxes have a known direction down.
3. A fit that fails leaves the last ground, and the next 50 boxes try again.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.localization.tracker_frame import TrackerFrame
from pf_tracker_ros.localization.world_tracks import distrust
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.world import CameraModel, GroundPlane, fit_ground_plane
from pf_tracker_ros.world.box_edges import BoxEdges

_BATCH, _MAX_BOXES = 50, 200
# Nanoseconds between two boxes of one target.
_INTERVAL = NANOSECONDS // 2


@dataclass
class GroundLearning:
    """Boxes so far, and the ground learned from them.

    Attributes:
        plane: The ground; None before a fit.
        boxes: Number of boxes so far.
        problem: Why the last fit failed; empty otherwise.
    """

    plane: GroundPlane | None = None
    boxes: int = 0
    problem: str = ""

    def __post_init__(self) -> None:
        self._boxes: deque[tuple[Box, NDArray[np.float64] | None]] = deque(maxlen=_MAX_BOXES)
        self._taken_at: dict[int, int] = {}

    def add(
        self,
        frame: TrackerFrame,
        camera: CameraModel,
        parameters: LocalizerParameters,
        down: NDArray[np.float64] | None = None,
    ) -> None:
        """Take the boxes of a frame.

        Args:
            frame: Of the tracker.
            camera: The calibration.
            parameters: Of the localizer.
            down: (3,) direction down in camera coordinates; None where it is unknown.
        """
        if self.plane is not None and self.boxes >= _MAX_BOXES:
            return
        for target in frame.targets:
            # After a jump of the time, stamps may be earlier.
            is_new = abs(frame.stamp - self._taken_at.get(target.id, 0)) >= _INTERVAL
            if distrust(target, parameters.min_confidence) or not is_new:
                continue
            if _is_whole(target.box, camera):
                self._taken_at[target.id] = frame.stamp
                self._boxes.append((target.box, down))
                self.boxes += 1
                if self.boxes % _BATCH == 0:
                    self._fit(camera, parameters)

    def _fit(self, camera: CameraModel, parameters: LocalizerParameters) -> None:
        boxes = [box for box, _ in self._boxes]
        directions = [down for _, down in self._boxes if down is not None]
        down = np.array(directions) if len(directions) == len(boxes) else None
        try:
            fitted = fit_ground_plane(camera, boxes, parameters.target.height, down=down)
        except ValueError as error:
            self.problem = f"the ground cannot be learned from {self.boxes} boxes: {error}"
        else:
            self.plane, self.problem = fitted.plane, ""


def _is_whole(box: Box, camera: CameraModel) -> bool:
    try:
        edges = BoxEdges.of(box, None, (camera.width, camera.height))
    except ValueError:
        return False
    return edges is not None and edges.is_whole
