"""The ground plane: angles against rotation matrices, intersections, wrong input."""

import math

import numpy as np
import pytest

from pf_tracker_ros.world import GroundPlane

# Optical axes (x right, y down, z forward) in the body's (x forward, y left, z up), REP 103.
OPTICAL_IN_BODY = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def camera_to_world(pitch, roll, yaw=0.7):
    """Rz(yaw) Ry(pitch) Rx(roll), from optical axes."""
    c, s = math.cos, math.sin
    rz = np.array([[c(yaw), -s(yaw), 0], [s(yaw), c(yaw), 0], [0, 0, 1]])
    ry = np.array([[c(pitch), 0, s(pitch)], [0, 1, 0], [-s(pitch), 0, c(pitch)]])
    rx = np.array([[1, 0, 0], [0, c(roll), -s(roll)], [0, s(roll), c(roll)]])
    return rz @ ry @ rx @ OPTICAL_IN_BODY


@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (0.3, 0.0), (-0.1, 0.2), (0.6, -0.15)])
def test_angles_are_those_of_rep_103(pitch, roll):
    rotation = camera_to_world(pitch, roll)
    plane = GroundPlane.from_angles(2.0, pitch, roll)
    np.testing.assert_allclose(plane.down, rotation.T @ [0.0, 0.0, -1.0], atol=1e-12)
    assert (plane.pitch, plane.roll) == pytest.approx((pitch, roll))
    from_pose = GroundPlane.from_pose(rotation, (5.0, 6.0, 2.5), ground_level=0.5)
    np.testing.assert_allclose(from_pose.down, plane.down, atol=1e-12)
    assert from_pose.height == pytest.approx(2.0)
    from_gravity = GroundPlane.from_gravity(2.0, 9.81 * plane.down)
    np.testing.assert_allclose(from_gravity.down, plane.down, atol=1e-12)


def test_distances_along_rays():
    # 45 degrees down from 2 m: the optical axis meets the ground after sqrt(8) m.
    plane = GroundPlane.from_angles(2.0, math.pi / 4.0)
    assert plane.distances([[0.0, 0.0, 1.0]])[0] == pytest.approx(math.sqrt(8.0))
    # A ray at or above the horizon misses the ground.
    plane = GroundPlane.from_angles(2.0)
    distances = plane.distances([[0.0, 0.0, 1.0], [0.0, -0.6, 0.8], [0.0, 0.6, 0.8]])
    assert np.isnan(distances[:2]).all()
    assert distances[2] == pytest.approx(2.0 / 0.6)
    assert np.isnan(GroundPlane.from_angles(None).distances([[0.0, 0.6, 0.8]])).all()


@pytest.mark.parametrize(
    "arguments",
    [
        (np.zeros(3), 1.0, 0.0),
        (np.array([0.0, np.nan, 1.0]), 1.0, 0.0),
        (np.ones(2), 1.0, 0.0),
        (np.ones(3), 0.0, 0.0),
        (np.ones(3), math.inf, 0.0),
        (np.ones(3), math.nan, 0.0),
        (np.ones(3), 1e200, 0.0),
        (np.ones(3), 1.0, -0.1),
        (np.ones(3), 1.0, 1e200),
        (np.ones(3), 1.0, 0.1, math.nan),
    ],
)
def test_what_is_no_plane_is_rejected(arguments):
    with pytest.raises(ValueError, match="expected"):
        GroundPlane(*arguments)


@pytest.mark.parametrize("length", [1e200, 1e-320])
def test_gravity_has_any_length(length):
    plane = GroundPlane.from_gravity(1.0, (0.0, length, length))
    np.testing.assert_allclose(plane.down, (0.0, 0.5**0.5, 0.5**0.5))
    with pytest.raises(ValueError, match="finite"):
        GroundPlane.from_angles(1.0, math.nan)
