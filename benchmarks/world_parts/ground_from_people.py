"""The ground learned from the people of PETS 2009."""

from __future__ import annotations

import numpy as np
from tables import Table

from pf_tracker_ros.progress import OnProgress
from pf_tracker_ros.world import GroundPlane, fit_ground_plane
from world_parts.errors import Array
from world_parts.pets import FixedCamera, GroundTracks

# Numbers of boxes of a fit, the height that is told, meters, and the number of fits.
BOXES, HEIGHT, RUNS = (50, 200), 1.7, 300


def plane_table(camera: FixedCamera, tracks: GroundTracks, on_progress: OnProgress) -> Table:
    """The ground learned from random boxes: errors of the positions on it after alignment."""
    generator = np.random.default_rng(0)
    true = GroundPlane.from_pose(camera.rotation, camera.translation)
    level = np.column_stack([tracks.positions, np.zeros(len(tracks.positions))])
    expected = on_ground(true, (level - camera.translation) @ camera.rotation)
    foot = tracks.boxes[:, :2] + tracks.boxes[:, 2:] * (0.5, 1.0) - 0.5
    rays = camera.model.rays(foot)
    size = (camera.model.width, camera.model.height)
    ends = tracks.boxes[:, :2] + tracks.boxes[:, 2:]
    inside = ((tracks.boxes[:, :2] > 10) & (ends < np.array(size) - 10)).all(axis=1)
    rows = []
    for boxes in BOXES:
        errors = []
        for _ in range(RUNS):
            chosen = generator.choice(np.flatnonzero(inside), boxes, replace=False)
            on_progress("plane from people", 1)
            plane = fit_ground_plane(camera.model, tracks.boxes[chosen], HEIGHT).plane
            places = on_ground(plane, rays * plane.distances(rays)[:, None])
            moved = aligned(places[inside], expected[inside])
            errors.append(np.median(np.linalg.norm(moved - expected[inside], axis=1)))
        rows.append([str(boxes), f"{np.median(errors):.2f}"])
    title = f"The ground from people of a known height (median of {RUNS} draws)"
    return Table(title, ("boxes", "median error, m"), rows)


def on_ground(plane: GroundPlane, points: Array) -> Array:
    """(N, 2) coordinates along the ground, forward and right of the camera, of (N, 3) points."""
    forward = np.array([0.0, 0.0, 1.0]) - plane.down[2] * plane.down
    forward /= np.linalg.norm(forward)
    return points @ np.column_stack([forward, np.cross(plane.down, forward)])


def aligned(points: Array, targets: Array) -> Array:
    """(N, 2) points after the rotation and translation that bring them nearest to the targets.

    A plane before a camera has no place in the world: without it, only the shape counts.
    """
    middle, target_middle = points.mean(axis=0), targets.mean(axis=0)
    left, _, right = np.linalg.svd((points - middle).T @ (targets - target_middle))
    sign = np.sign(np.linalg.det(left @ right))
    rotated: Array = (points - middle) @ left @ np.diag([1.0, sign]) @ right
    return rotated + target_middle
