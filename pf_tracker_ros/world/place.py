"""Where a target is, in camera coordinates and in a fixed frame.

Camera coordinates are x right, y down, z forward, in meters: the optical frame of REP 103.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.filter.gaussian import Gaussian


@dataclass(frozen=True, eq=False)
class Bearing:
    """Direction of a box's center.

    Attributes:
        direction: (3,) unit vector.
        covariance: (2, 2), rad^2: of the angle along the camera's x axis (right), and of that
            across it (down).

    Example:
        The direction of a box in the middle of the image:

        >>> from pf_tracker_ros.world import CameraModel, Localizer
        >>> localizer = Localizer(CameraModel(500.0, 500.0, 320.0, 240.0, 640, 480))
        >>> bearing = localizer.bearing((300, 220, 40, 40))
        >>> (bearing.direction.round(2) + 0.0).tolist(), bearing.covariance.shape
        ([0.0, 0.0, 1.0], (2, 2))
    """

    direction: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        ray: NDArray[np.float64],
        jacobian: NDArray[np.float64],
        covariance: NDArray[np.float64],
    ) -> Bearing | None:
        """The bearing of a pixel; None where it has no ray.

        Args:
            ray: (3,) unit vector.
            jacobian: (3, 2) of the ray by the pixel.
            covariance: (2, 2) of the pixel, px^2.
        """
        x, y, z = ray.tolist()
        if not x * x + y * y + z * z > 0.0:
            return None
        # Of the x axis and the ray, the part across the ray; any axis where they are parallel.
        length = max((y * y + z * z) ** 0.5, 1e-9)
        right = length, -x * y / length, -x * z / length
        down = 0.0, z / length, -y / length
        angles = np.array([right, down]) @ jacobian
        return cls(ray, angles @ covariance @ angles.T)


@dataclass(frozen=True, eq=False)
class Place:
    """Direction and position of a target in one frame, unfiltered.

    Attributes:
        position: (3,) lower center of the target in camera coordinates, meters.
        covariance: (3, 3) of the position, m^2.
        method: `ground`, `height`, `depth`, or several joined by `+`.
        bearing: (3,) unit vector to the center of the box.
        bearing_covariance: (2, 2) of the bearing, rad^2; see `Bearing`.
        occlusion: Share, 0 to 1, of the box's depth pixels that are nearer than the target; None
            without depth.
        is_unseen: Whether depth shows in the box only what is before or behind the predicted
            target: it is hidden, or the box on something else.

    Example:
        >>> from pf_tracker_ros.world import CameraModel, Localizer
        >>> camera = CameraModel(500.0, 500.0, 320.0, 240.0, 640, 480)
        >>> place = Localizer(camera, camera_height=1.5).locate((300, 215, 40, 175))
        >>> place.position.shape, place.covariance.shape, place.occlusion
        ((3,), (3, 3), None)
    """

    position: NDArray[np.float64]
    covariance: NDArray[np.float64]
    method: str
    bearing: NDArray[np.float64]
    bearing_covariance: NDArray[np.float64]
    occlusion: float | None = None
    is_unseen: bool = False

    @property
    def range(self) -> float:
        """Distance of the lower center from the camera, meters."""
        return float(np.linalg.norm(self.position))


def in_fixed_frame(place: Place, rotation: ArrayLike, translation: ArrayLike) -> Gaussian:
    """The position in a fixed frame: mean (3,) in meters and covariance (3, 3) in m^2.

    Args:
        place: In camera coordinates.
        rotation: (3, 3) from the camera's optical frame to the fixed frame.
        translation: (3,) position of the camera in the fixed frame, meters.

    Example:
        A fixed frame with x forward, y to the left, z up, and the camera 1.5 m above its origin:

        >>> from pf_tracker_ros.world import CameraModel, Localizer, in_fixed_frame
        >>> camera = CameraModel(500.0, 500.0, 320.0, 240.0, 640, 480)
        >>> place = Localizer(camera, camera_height=1.5).locate((300, 215, 40, 175))
        >>> rotation = [(0, 0, 1), (-1, 0, 0), (0, -1, 0)]
        >>> fixed = in_fixed_frame(place, rotation, (0.0, 0.0, 1.5))
        >>> bool(abs(fixed.mean - (5.0, 0.0, 0.0)).max() < 0.2), fixed.covariance.shape
        (True, (3, 3))
    """
    matrix = np.asarray(rotation, dtype=np.float64)
    return Gaussian(
        matrix @ place.position + np.asarray(translation, dtype=np.float64),
        matrix @ place.covariance @ matrix.T,
    )
