"""Rendered depth images of people with exact positions.

A person is an elliptic cylinder: as wide and as thick as a body, and turned at random. The ground
and a wall behind are planes. Noise grows with the square of the depth as that of a structured-light
camera, and holes are squares.

Source of the noise: Khoshelham and Elberink 2012, "Accuracy and Resolution of Kinect Depth Data".
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.world import CameraModel, GroundPlane

Array = NDArray[np.float64]

# Half the width and half the thickness of a body, meters.
_HALF_WIDTH, _HALF_THICKNESS = 0.22, 0.12
# Standard deviation of the depth at 1 m, meters.
_NOISE = 0.0015
# Side of a hole, pixels.
_HOLE = 8


@dataclass(frozen=True)
class Person:
    """Where a person stands.

    Attributes:
        distance: Horizontal distance of the middle, meters.
        bearing: To the right, radians.
        height: Meters.
        turn: Angle between the body's wide side and the image plane, radians.
    """

    distance: float
    bearing: float
    height: float
    turn: float


@dataclass(frozen=True, eq=False)
class Renderer:
    """Depth images of one camera above a ground.

    Attributes:
        camera: Its calibration.
        plane: The ground.
        wall: Distance of the wall, meters.
    """

    camera: CameraModel
    plane: GroundPlane
    wall: float

    def axes(self) -> Array:
        """(3, 3) columns: horizontally forward, right, and down, in camera coordinates."""
        down = self.plane.down
        forward = np.array([0.0, 0.0, 1.0]) - down[2] * down
        forward /= np.linalg.norm(forward)
        return np.column_stack([forward, np.cross(down, forward), down])

    def position(self, person: Person) -> Array:
        """(3,) lower center in camera coordinates, meters."""
        offsets = (np.cos(person.bearing), np.sin(person.bearing))
        height = self.plane.height or 0.0
        return self.axes() @ [*(person.distance * np.array(offsets)), height]

    def background(self) -> tuple[Array, Array]:
        """(H, W, 3) rays in horizontal axes, z forward 1 in the camera, and (H, W) depth."""
        width, height = self.camera.width, self.camera.height
        columns, rows = np.meshgrid(np.arange(width), np.arange(height))
        rays = self.camera.rays(np.column_stack([columns.ravel(), rows.ravel()]))
        rays = (rays / rays[:, 2:]) @ self.axes()
        with np.errstate(divide="ignore"):
            ground = np.where(rays[:, 2] > 0.0, (self.plane.height or 0.0) / rays[:, 2], np.inf)
        depth = np.minimum(ground, self.wall / rays[:, 0])
        return rays.reshape(height, width, 3), depth.reshape(height, width)

    def add(self, rays: Array, depth: Array, person: Person) -> NDArray[np.bool_]:
        """Put a person into a depth image; returns the (H, W) mask of the person's pixels."""
        middle = person.distance * np.array([np.cos(person.bearing), np.sin(person.bearing)])
        # Axes of the ellipse: thickness along the line of sight, turned.
        angle = person.bearing + person.turn
        thick = np.array([np.cos(angle), np.sin(angle)]) / _HALF_THICKNESS
        wide = np.array([-np.sin(angle), np.cos(angle)]) / _HALF_WIDTH
        to_ellipse = np.array([thick, wide])
        direction = rays[..., :2] @ to_ellipse.T
        center = to_ellipse @ middle
        # |t direction - center|^2 = 1.
        square = np.square(direction).sum(axis=-1)
        half = direction @ center
        discriminant = half**2 - square * (center @ center - 1.0)
        hit = discriminant > 0.0
        reached = np.where(hit, (half - np.sqrt(np.maximum(discriminant, 0.0))) / square, np.inf)
        with np.errstate(invalid="ignore"):
            level = reached * rays[..., 2]
        ground = self.plane.height or 0.0
        mask = hit & (level < ground) & (level > ground - person.height) & (reached < depth)
        depth[mask] = reached[mask]
        return mask


def corrupted(depth: Array, holes: float, generator: np.random.Generator) -> NDArray[np.float32]:
    """A depth image with noise, and with a share of holes."""
    noisy = depth + generator.normal(0.0, 1.0, depth.shape) * _NOISE * depth**2
    rows, columns = (side // _HOLE + 1 for side in depth.shape)
    coarse = (generator.random((rows, columns)) < holes).astype(np.uint8)
    large = cv2.resize(coarse, (columns * _HOLE, rows * _HOLE), interpolation=cv2.INTER_NEAREST)
    noisy[large[: depth.shape[0], : depth.shape[1]] > 0] = np.nan
    return noisy.astype(np.float32)


def box_around(mask: NDArray[np.bool_]) -> tuple[float, float, float, float]:
    """The smallest box around a mask with pixels."""
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    return float(x), float(y), float(width), float(height)
