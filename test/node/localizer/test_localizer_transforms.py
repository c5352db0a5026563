"""The camera's pose from tf2, and the targets' frames in it; needs the real tf2_ros."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from rclpy.time import Time

tf2_ros = pytest.importorskip("tf2_ros", reason="comes with a ROS from apt, and PyPI has none")


def transform(stamp, names, place, quaternion):
    parent, child = names
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    moved, turned = message.transform.translation, message.transform.rotation
    moved.x, moved.y, moved.z = place
    turned.x, turned.y, turned.z, turned.w = quaternion
    return message


@pytest.fixture
def move(scene, make_localizer, given):
    """A function that moves the base of a robot, whose localizer takes the camera from tf2."""
    broadcaster, static = (
        kind(scene) for kind in (tf2_ros.TransformBroadcaster, tf2_ros.StaticTransformBroadcaster)
    )
    localizer = make_localizer(method="ground", fixed_frame="map")
    scene.meet(localizer)
    scene.calibrate()
    # The optical frame of REP 103: z forward, x right, in a body 0.3 m before the base.
    optical = (-0.5, 0.5, -0.5, 0.5)
    static.sendTransform(
        transform(given.start, ("base_link", given.optical), (0.3, 0.0, 1.5), optical)
    )

    def move_base(stamp, x, yaw):
        turn = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        broadcaster.sendTransform(transform(stamp, ("map", "base_link"), (x, 0.0, 0.0), turn))
        scene.wait_for(
            lambda: localizer._transforms._buffer.can_transform(
                "map", given.optical, Time(nanoseconds=stamp)
            ),
            "transform",
        )

    return move_base


def test_the_camera_moves_as_tf2_says_at_the_stamp_of_the_image(scene, move, given):
    buffer = tf2_ros.Buffer()
    listener = tf2_ros.TransformListener(buffer, scene)
    target = np.array([9.0, 1.0])
    move(given.start - 10**9, -2.0, -0.3)
    for index in range(25):
        stamp = given.start + index * given.frame
        # Images are halfway between two transforms.
        seconds, half = index * 0.04, 0.02
        move(stamp + given.frame // 2, 2.0 * (seconds + half), 0.3 * (seconds + half))
        yaw = 0.3 * seconds
        rotation = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
        camera = np.array([2.0 * seconds, 0.0]) + rotation @ [0.3, 0.0]
        forward, left = rotation.T @ (target - camera)
        status = scene.show(stamp, [given.target(box=given.box_at(forward, left))])
        if index:
            assert status.values["pose"] == "published", status.message
    assert status.values["camera_mounting"] == status.values["camera_motion"] == "tf2"
    assert float(status.values["camera_height"]) == pytest.approx(1.5)
    found = [float(status.targets[1][key]) for key in "xy"]
    assert found == pytest.approx(target, abs=0.1)

    def placed():
        names = "target", "target_1"
        if not all(buffer.can_transform("map", one, Time(nanoseconds=stamp)) for one in names):
            return None
        return [buffer.lookup_transform("map", one, Time(nanoseconds=stamp)) for one in names]

    for one in scene.wait_for(placed, "frames of the target"):
        place = one.transform.translation
        assert [place.x, place.y, place.z] == pytest.approx([*found, 0.0])
    listener.unregister()


def test_it_is_silent_beyond_the_last_transform(scene, move, given):
    move(given.start, 0.0, 0.0)
    box = given.box_at(6.0, 0.0)
    assert scene.show(given.start, [given.target(box=box)]).values["pose"] == "published"
    late = scene.show(given.start + 5 * given.frame, [given.target(box=box)])
    assert late.values["pose"] == "silent"
    assert "no transform from camera_optical_frame to map" in late.values["reason"]
    assert float(late.values["waited_ms"]) >= 150.0
