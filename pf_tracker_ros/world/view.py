"""A box as a camera above a plane sees it: rays, and their slopes against the horizon."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.world.box_edges import BoxEdges
from pf_tracker_ros.world.camera_model import CameraModel
from pf_tracker_ros.world.ground_plane import GroundPlane

# Least horizontal part of a ray, of 1: 3 degrees from straight down.
_LEAST_HORIZONTAL = 0.05


@dataclass(frozen=True, eq=False)
class View:
    """Foot, head and center of a box, in this order, as seen by a camera.

    The slope of a ray is the tangent of its angle below the horizon.

    Attributes:
        edges: Of the box.
        plane: The ground; without a height, its direction down.
        rays: (3, 3) unit vectors; NaN where the camera model has none.
        jacobians: (3, 3, 2) of the rays by the pixel.
        sines: (3,) of the angles below the horizon.
        horizontals: (3,) lengths of the rays' horizontal parts, the cosines.
        slopes: (3,) of the rays.
        slope_gradients: (3, 2) of the slopes by the pixel.
    """

    edges: BoxEdges
    plane: GroundPlane
    rays: NDArray[np.float64]
    jacobians: NDArray[np.float64]
    sines: NDArray[np.float64]
    horizontals: NDArray[np.float64]
    slopes: NDArray[np.float64]
    slope_gradients: NDArray[np.float64]

    @classmethod
    def of(cls, camera: CameraModel, edges: BoxEdges, plane: GroundPlane) -> View:
        """The view of a box."""
        rays, jacobians = camera.rays_with_jacobians(edges.points())
        sines = rays @ plane.down
        horizontals = np.sqrt(np.maximum(1.0 - sines * sines, _LEAST_HORIZONTAL**2))
        gradients = (plane.down @ jacobians) / horizontals[:, None] ** 3
        return cls(
            edges, plane, rays, jacobians, sines, horizontals, sines / horizontals, gradients
        )

    @property
    def has_foot(self) -> bool:
        """Whether the box shows where the target stands."""
        return self.edges.has_lower and not np.isnan(self.sines[0])

    @property
    def has_head(self) -> bool:
        """Whether the box shows the target's upper end."""
        return self.edges.has_upper and not np.isnan(self.sines[1])
