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
# Edges of foot and head: middle and lower, middle and upper.
_EDGES_OF = np.array([[0, 1], [0, 2]])


@dataclass(frozen=True, eq=False)
class View:
    """Foot and head of a box as seen by a camera.

    The slope of a ray is the tangent of its angle below the horizon. Derivatives are by the
    errors of the box's edges, in three independent parts of variance 1 each.

    Attributes:
        plane: The ground; without a height, its direction down.
        edges: Of the box.
        rays: (3, 3) unit vectors to foot, head and center; NaN where the camera model has none.
        jacobians: (3, 3, 2) of these by the pixel.
        horizontal: (3,) lengths of the rays' horizontal parts, the cosines.
        slopes: Of the three rays.
        ray_errors: (2, 3, 3) derivatives of the rays to foot and head by the three errors.
        slope_errors: Derivatives of the slopes of foot and head by the three errors.
    """

    plane: GroundPlane
    edges: BoxEdges
    rays: NDArray[np.float64]
    jacobians: NDArray[np.float64]
    horizontal: NDArray[np.float64]
    slopes: list[float]
    ray_errors: NDArray[np.float64]
    slope_errors: list[list[float]]

    @classmethod
    def of(cls, camera: CameraModel, edges: BoxEdges, plane: GroundPlane) -> View:
        """The view of a box."""
        rays, jacobians = camera.rays_with_jacobians(edges.points())
        sines = rays @ plane.down
        horizontal = np.sqrt(np.maximum(1.0 - sines * sines, _LEAST_HORIZONTAL**2))
        ray_errors = jacobians[:2] @ edges.root[_EDGES_OF]
        # The slope is sine / cosine; its derivative by the sine is 1 / cosine^3.
        slope_errors = (plane.down @ ray_errors) / horizontal[:2, None] ** 3
        return cls(
            plane,
            edges,
            rays,
            jacobians,
            horizontal,
            (sines / horizontal).tolist(),
            ray_errors,
            slope_errors.tolist(),
        )

    @property
    def has_foot(self) -> bool:
        """Whether the box shows where the target stands."""
        return self.edges.has_lower and self.slopes[0] == self.slopes[0]

    @property
    def has_head(self) -> bool:
        """Whether the box shows the target's upper end."""
        return self.edges.has_upper and self.slopes[1] == self.slopes[1]
