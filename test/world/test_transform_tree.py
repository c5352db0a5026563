"""Transforms of a recording against products of homogeneous matrices."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from pf_tracker_ros.localization.sensors import NotYetError
from pf_tracker_ros.localization.transform_tree import TransformTree

SECOND = 1_000_000_000


class Feed:
    topic, is_used, is_silent = "/tf", True, False


def quaternion(turn):
    """x, y, z, w of a rotation vector."""
    angle = np.linalg.norm(turn)
    axis = np.asarray(turn) / (angle or 1.0)
    return (*(np.sin(angle / 2) * axis), np.cos(angle / 2))


def message(stamp, parent, child, place, turn):
    x, y, z, w = quaternion(turn)
    transform = SimpleNamespace(
        stamp=stamp,
        frame_id=parent,
        child_frame_id=child,
        translation=SimpleNamespace(**dict(zip("xyz", place, strict=True))),
        rotation=SimpleNamespace(x=x, y=y, z=z, w=w),
    )
    return SimpleNamespace(stamp=stamp, frame_id="", transforms=[transform])


def matrix(place, turn):
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = cv2.Rodrigues(np.array(turn, float))[0], place
    return made


MAP, BASE, CAMERA, ARM = (
    ((1.0, 2.0, 0.0), (0.0, 0.0, 0.4)),
    ((0.5, 0.0, 0.0), (0.0, 0.0, -0.2)),
    ((0.2, 0.0, 1.1), (0.3, -0.2, 0.1)),
    ((0.0, 0.3, 0.9), (0.0, 0.5, 0.0)),
)


@pytest.fixture
def tree():
    """Map to odometry to base, and camera and arm on the base."""
    made = TransformTree(Feed())
    for stamp in (SECOND, 2 * SECOND):
        made.take(0, "", message(stamp, "map", "odom", *MAP))
    made.take(0, "", message(SECOND, "/odom", "base", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    made.take(0, "", message(2 * SECOND, "odom", "base", *BASE))
    made.take_static(0, "", message(0, "base", "camera", *CAMERA))
    made.take_static(0, "", message(0, "base", "arm", *ARM))
    return made


def found(tree, parent, child, stamp):
    pose, made = tree.lookup(parent, child, stamp), np.eye(4)
    made[:3, :3], made[:3, 3] = pose
    return made


def test_poses_are_products_of_the_transforms_between(tree):
    at_end = matrix(*MAP) @ matrix(*BASE) @ matrix(*CAMERA)
    np.testing.assert_allclose(found(tree, "map", "/camera", 2 * SECOND), at_end, atol=1e-12)
    # Halfway, half of the motion; downward and across, the inverse.
    half = matrix((0.25, 0.0, 0.0), (0.0, 0.0, -0.1)) @ matrix(*CAMERA)
    middle = 3 * SECOND // 2
    np.testing.assert_allclose(found(tree, "odom", "camera", middle), half, atol=1e-12)
    np.testing.assert_allclose(
        found(tree, "camera", "odom", middle), np.linalg.inv(half), atol=1e-12
    )
    across = np.linalg.inv(matrix(*ARM)) @ matrix(*CAMERA)
    # The base's motion does not matter, at any time.
    for stamp in (0, 9 * SECOND):
        np.testing.assert_allclose(found(tree, "arm", "camera", stamp), across, atol=1e-12)
    np.testing.assert_allclose(found(tree, "odom", "base", 0), matrix(*BASE), atol=1e-12)
    np.testing.assert_array_equal(found(tree, "map", "map", SECOND), np.eye(4))


def test_what_may_still_arrive_is_waited_for(tree):
    for frames in (("odom", "base"), ("odom", "lidar")):
        with pytest.raises(NotYetError):
            tree.lookup(*frames, 3 * SECOND)
    tree._feed.is_silent = True
    try:
        with pytest.raises(ValueError, match=r"ends 1\.000 s before the image") as raised:
            tree.lookup("odom", "base", 3 * SECOND)
        assert not isinstance(raised.value, NotYetError)
        with pytest.raises(ValueError, match="no transform from lidar to odom; record it"):
            tree.lookup("odom", "lidar", SECOND)
    finally:
        tree._feed.is_silent = False
    with pytest.raises(ValueError, match=r"begins 0\.500 s after the image") as raised:
        tree.lookup("odom", "base", SECOND // 2)
    assert not isinstance(raised.value, NotYetError)
    with pytest.raises(ValueError, match="no frame_id"):
        tree.lookup("odom", "", SECOND)


def test_a_frame_with_another_parent_starts_anew_and_a_circle_is_told(tree):
    tree.take(0, "", message(2 * SECOND, "world", "base", *BASE))
    np.testing.assert_allclose(found(tree, "world", "base", 2 * SECOND), matrix(*BASE), atol=1e-12)
    with pytest.raises(NotYetError, match="no transform from camera to odom"):
        tree.lookup("odom", "camera", 2 * SECOND)
    tree.take_static(0, "", message(0, "camera", "world", *ARM))
    with pytest.raises(ValueError, match="a circle: arm, base, world, camera"):
        tree.lookup("map", "arm", 2 * SECOND)


def test_frames_of_targets_are_no_robot():
    tree = TransformTree(Feed())
    assert not tree.are_published
    for child in ("target", "target_12"):
        tree.take(0, "", message(SECOND, "odom", child, *BASE))
    assert not tree.are_published
    tree.take_static(0, "", message(0, "base", "target_camera", *CAMERA))
    assert tree.are_published


@pytest.mark.parametrize("take", ["take", "take_static"])
def test_an_invalid_transform_leaves_the_others_of_its_message(take):
    made = TransformTree(Feed())
    both = message(0, "base", "wheel", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    if take == "take":
        both.transforms[0].rotation.w = np.nan
    else:
        both.transforms[0].translation.y = np.nan
    both.transforms += message(0, "base", "camera", *CAMERA).transforms
    with pytest.raises(ValueError, match="the transform from wheel to base is invalid"):
        getattr(made, take)(0, "", both)
    np.testing.assert_allclose(made.lookup("base", "camera", 0).translation, CAMERA[0])
    with pytest.raises(NotYetError):
        made.lookup("base", "wheel", 0)
