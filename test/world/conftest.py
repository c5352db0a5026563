"""Cameras and people whose boxes are known exactly."""

import numpy as np
import pytest

from pf_tracker_ros.world import CameraModel, GroundPlane


@pytest.fixture
def camera():
    return CameraModel(600.0, 610.0, 319.5, 239.5, 640, 480)


@pytest.fixture
def box_of():
    """A function from a foot's horizontal distance and bearing to the box of a flat person.

    The foot is where the box ends; the edges are half a pixel more than in a CameraInfo.
    """

    def box(camera, plane, distance, bearing=0.0, height=1.75, width=0.4):  # noqa: PLR0917
        down = plane.down
        forward = np.array([0.0, 0.0, 1.0]) - down[2] * down
        forward /= np.linalg.norm(forward)
        right = np.cross(down, forward)
        direction = np.cos(bearing) * forward + np.sin(bearing) * right
        foot = distance * direction + plane.height * down
        head = foot - height * down
        (u, lower), (_, upper) = camera.project([foot, head])
        half = width / height * (lower - upper) / 2.0
        return (u + 0.5 - half, upper + 0.5, 2.0 * half, lower - upper), foot

    return box


@pytest.fixture
def level():
    return GroundPlane.from_angles(1.2, 0.0, 0.0)
