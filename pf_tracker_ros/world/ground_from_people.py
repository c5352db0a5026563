"""The ground plane from boxes of people of a known height."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from pf_tracker_ros.world.camera_model import CameraModel
from pf_tracker_ros.world.ground_plane import GroundPlane

MIN_BOXES = 50


@dataclass(frozen=True, eq=False)
class PeopleGround:
    """A ground plane that was learned.

    Attributes:
        plane: The ground, its `tilt_sd` and `height_sd` from the fit.
        boxes: Number of boxes that agree with it.
    """

    plane: GroundPlane
    boxes: int


def fit_ground_plane(
    camera: CameraModel,
    boxes: ArrayLike,
    target_height: float = 1.75,
    target_height_sd: float = 0.1,
) -> PeopleGround:
    """Fit height, pitch and roll of a camera to people who stand on the ground.

    Args:
        camera: Its calibration.
        boxes: (N, 4) in pixels, at least 50 that are whole; others are left out.
        target_height: Mean height of the people, meters.
        target_height_sd: Standard deviation of their heights, meters.

    Raises:
        ValueError: Fewer than 50 whole boxes, or no plane within the bounds fits them.
    """
    raise NotImplementedError
