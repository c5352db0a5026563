"""What a localizer keeps of its sensors: items by their stamps, and poses."""

import math

import numpy as np
import pytest

from pf_tracker_ros.localization.camera_pose import mounted_pose
from pf_tracker_ros.localization.rigid_pose import RigidPose
from pf_tracker_ros.localization.stamped_buffer import StampedBuffer
from pf_tracker_ros.world import GroundPlane

SECOND = 10**9


def test_the_nearest_item_is_found_in_any_order_of_arrival():
    buffer = StampedBuffer(2 * SECOND, 10)
    for stamp in (30, 10, 20, 40, 20):
        assert not buffer.add(stamp, str(stamp))
    assert len(buffer) == 4
    assert [buffer.nearest(stamp)[0] for stamp in (0, 14, 16, 31, 99)] == [10, 10, 20, 30, 40]
    assert buffer.around(25) == ((20, "20"), (30, "30"))
    assert buffer.around(20) == ((20, "20"), (20, "20"))
    assert buffer.around(5) == (None, (10, "10"))
    assert buffer.around(41) == ((40, "40"), None)


def test_old_and_surplus_items_are_dropped_and_a_jump_back_drops_all():
    buffer = StampedBuffer(2 * SECOND, 3)
    for stamp in (1, 2, 3, 4):
        buffer.add(stamp * SECOND, stamp)
    assert buffer.nearest(0)[1] == 2
    assert buffer.add(2 * SECOND, "again")
    assert len(buffer) == 1
    assert buffer.newest == 2 * SECOND
    # A single stamp of another clock does not stay.
    buffer.add(10**6 * SECOND, "odd")
    assert buffer.add(3 * SECOND, "next")
    assert buffer.nearest(0) == (3 * SECOND, "next")


@pytest.mark.parametrize("pitch", [0.0, 0.3, -0.2, math.pi / 2])
@pytest.mark.parametrize("roll", [0.0, 0.1])
def test_a_mounted_camera_is_above_the_origin_and_looks_forward(pitch, roll):
    plane = GroundPlane.from_angles(1.5, pitch, roll)
    pose = mounted_pose(plane)
    assert np.allclose(pose.rotation @ pose.rotation.T, np.eye(3))
    assert np.linalg.det(pose.rotation) == pytest.approx(1.0)
    # The point of the ground below the camera is the origin.
    assert np.allclose(pose.rotation @ (1.5 * plane.down) + pose.translation, 0.0)
    axis = pose.rotation @ [0.0, 0.0, 1.0]
    assert axis[2] == pytest.approx(-math.sin(pitch))
    assert axis[1] == pytest.approx(0.0, abs=1e-9)
    assert axis[0] >= -1e-9


def test_a_pose_is_interpolated_along_the_shorter_turn():
    def pose(yaw, x):
        rotation = np.eye(3)
        rotation[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
        return RigidPose(rotation, np.array([x, 0.0, 0.0]))

    middle = pose(math.radians(170), 1.0).interpolate(pose(math.radians(-170), 3.0), 0.25)
    expected = pose(math.radians(175), 1.5)
    assert np.allclose(middle.rotation, expected.rotation)
    assert np.allclose(middle.translation, expected.translation)
