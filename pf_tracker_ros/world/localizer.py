"""Position of a target from its box, by ground, height and depth."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.world.camera_model import CameraModel
from pf_tracker_ros.world.ground_plane import GroundPlane
from pf_tracker_ros.world.place import Place

METHODS = ("ground", "height", "depth")


class Localizer:
    """Positions of targets before one camera.

    Args:
        camera: Its calibration.
        camera_height: Height above the ground, meters; None where the ground is unknown.
        camera_pitch: Radians; positive looks down.
        camera_roll: Radians; positive lowers the right side.
        target_height: Expected height of a target, meters.
        target_height_sd: Standard deviation of that among targets, meters.
        tilt_sd: Standard deviation of pitch and roll against the ground, radians; None means a value
            for the camera's height: a vehicle below 3 m, a fixed camera above.
        plane: The ground in place of `camera_height`, `camera_pitch`, `camera_roll` and `tilt_sd`.

    Raises:
        ValueError: A number is not finite or out of its range.
    """

    def __init__(
        self,
        camera: CameraModel,
        camera_height: float | None = 1.65,
        camera_pitch: float = 0.0,
        camera_roll: float = 0.0,
        target_height: float = 1.75,
        target_height_sd: float = 0.1,
        *,
        tilt_sd: float | None = None,
        plane: GroundPlane | None = None,
    ) -> None:
        self.camera = camera
        self.plane = plane or GroundPlane.from_angles(
            camera_height, camera_pitch, camera_roll, tilt_sd
        )
        self.target_height, self.target_height_sd = target_height, target_height_sd

    def locate(
        self,
        box: ArrayLike,
        box_covariance: ArrayLike | None = None,
        image: NDArray[np.generic] | None = None,
        depth: NDArray[np.generic] | None = None,
        *,
        target_probability: NDArray[np.generic] | None = None,
        predicted_range: tuple[float, float] | None = None,
        methods: Collection[str] = METHODS,
        plane: GroundPlane | None = None,
    ) -> Place | None:
        """The place of a target in one frame.

        Args:
            box: (x, y, width, height) in pixels, (x, y) the top-left corner counted from 0.
            box_covariance: (4, 4) of center x, center y, width and height, or (2, 2) of the center,
                px^2; None means that of a good detector.
            image: (H, W, 3) uint8 BGR, for the colors of the target; used only with depth and
                without `target_probability`.
            depth: (H, W) float in meters or uint16 in millimeters along the optical axis, registered
                to the image, of the same field of view in any resolution. 0, NaN and infinity are
                holes.
            target_probability: (rows, columns) probability, 0 to 1, of a pixel to be the target's,
                over the box in any resolution.
            predicted_range: Predicted distance from the camera and its standard deviation, meters:
                chooses between modes of the depth.
            methods: What to use of `METHODS`.
            plane: The ground in this frame, in place of the constructor's.

        Returns:
            None where nothing can be said of the position.

        Raises:
            ValueError: An argument has a wrong type, shape or range.
        """
        raise NotImplementedError
