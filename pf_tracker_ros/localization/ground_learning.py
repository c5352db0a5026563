"""Learns the ground from people, where nobody gives the camera's height.

1. Collect whole boxes of trusted targets, at most two a second of each target.
2. From 50 boxes on, and with every 50 more up to 200, fit height, pitch and roll of the camera.
3. A fit that fails leaves the last ground, and the next 50 boxes try again.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

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
        self._boxes: deque[Box] = deque(maxlen=_MAX_BOXES)
        self._taken_at: dict[int, int] = {}

    def add(
        self, frame: TrackerFrame, camera: CameraModel, parameters: LocalizerParameters
    ) -> None:
        """Take the boxes of a frame."""
        if self.plane is not None and self.boxes >= _MAX_BOXES:
            return
        for target in frame.targets:
            # After a jump of the time, stamps may be earlier.
            is_new = abs(frame.stamp - self._taken_at.get(target.id, 0)) >= _INTERVAL
            if distrust(target, parameters.min_confidence) or not is_new:
                continue
            if _is_whole(target.box, camera):
                self._taken_at[target.id] = frame.stamp
                self._boxes.append(target.box)
                self.boxes += 1
                if self.boxes % _BATCH == 0:
                    self._fit(camera, parameters)

    def _fit(self, camera: CameraModel, parameters: LocalizerParameters) -> None:
        try:
            fitted = fit_ground_plane(camera, list(self._boxes), parameters.target.height)
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
