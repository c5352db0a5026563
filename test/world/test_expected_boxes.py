"""Boxes of targets at known positions, by the pinhole camera."""

import math

import numpy as np
import pytest

from pf_tracker_ros.localization.camera_pose import CameraPose, mounted_pose
from pf_tracker_ros.localization.expected_boxes import expected_box, standing
from pf_tracker_ros.world import CameraModel, FilteredPosition, GroundPlane

# 1.5 m above the ground; the horizon is at row 240.
CAMERA = CameraModel(500.0, 500.0, 320.0, 240.0, 640, 480)


def pose(height=1.5, pitch=0.0):
    plane = GroundPlane.from_angles(height, pitch)
    return CameraPose(mounted_pose(plane), plane, "parameters", "still")


def at(x, y, variance=0.0):
    covariance = np.diag([9.0, variance, 1.0, 1.0])
    return FilteredPosition(0, np.array([x, y]), np.zeros(2), covariance)


def test_the_box_of_a_person_ahead():
    """1.75 m at 5 m: 175 px, with the foot 150 px below the horizon; 1 m is 100 px."""
    box, center_std = expected_box(CAMERA, pose(), at(5.0, 1.0, 0.04), 1.75, 0.4)
    middle = 320.5 - 100.0
    assert box == pytest.approx((middle - 35.0, 215.5, 70.0, 175.0), abs=0.6)
    # The uncertainty along the line of sight moves nothing.
    assert center_std == pytest.approx(20.0)
    for behind_or_at_the_camera in ((-3.0, 0.0), (0.2, 0.0)):
        assert expected_box(CAMERA, pose(), at(*behind_or_at_the_camera), 1.75, 0.4) is None


def test_heights_of_boxes_over_the_ground():
    found = standing(CAMERA, pose(), 1.75)
    assert found.horizon == pytest.approx(240.0, abs=0.6)
    assert found.slope == pytest.approx(1.75 / 1.5)
    box, _ = expected_box(CAMERA, pose(), at(7.0, 0.0), 1.75, 0.4)
    assert found.lower_edge(box[3]) == pytest.approx(box[1] + box[3])
    # The horizon rises as the camera looks down.
    found = standing(CAMERA, pose(pitch=0.1), 1.75)
    assert found.horizon == pytest.approx(240.0 - 500.0 * math.tan(0.1), abs=15.0)
    # Without a ground ahead, nothing is said.
    for unknown in (pose(height=None), pose(pitch=math.pi / 2)):
        assert standing(CAMERA, unknown, 1.75) is None
