"""What the localizer makes of messages of any kind, order and time."""

import math
import struct
from array import array

import cv2
import numpy as np
import pytest
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CompressedImage, Image, Imu

from pf_tracker_ros.decoding.depth_decoding import decode_depth
from pf_tracker_ros.decoding.image_decoding import ImageError
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


def depth_image(pixels, encoding):
    height, width = pixels.shape
    data = array("B", pixels.tobytes())
    return Image(height=height, width=width, encoding=encoding, step=pixels[0].nbytes, data=data)


def compressed(image_format, data):
    return CompressedImage(format=image_format, data=array("B", data))


def png(pixels):
    return cv2.imencode(".png", pixels)[1].tobytes()


MILLIMETERS = np.array([[0, 800, 65535], [1, 2, 3]], np.uint16)


def test_depth_of_each_transport_is_decoded():
    meters = np.array([[np.nan, 0.8, np.inf]], np.float32)
    assert np.array_equal(decode_depth(depth_image(MILLIMETERS, "16UC1"), 100), MILLIMETERS)
    decoded = decode_depth(depth_image(meters, "32FC1"), 100)
    assert np.array_equal(decoded, meters, equal_nan=True)
    plain = compressed("16UC1; png compressed ", png(MILLIMETERS))
    assert np.array_equal(decode_depth(plain, 100), MILLIMETERS)
    headed = compressed("16UC1; compressedDepth png", bytes(12) + png(MILLIMETERS))
    assert np.array_equal(decode_depth(headed, 100), MILLIMETERS)


def test_quantized_inverse_depth_is_as_its_definition_says():
    numerator, offset = 1000.0, -5.0
    header = struct.pack("<Iff", 0, numerator, offset)
    values = np.array([[0, 95, 495]], np.uint16)
    message = compressed("32FC1; compressedDepth png", header + png(values))
    decoded = decode_depth(message, 100)
    assert decoded.dtype == np.float32
    assert np.allclose(decoded, [[np.nan, 1000 / 100, 1000 / 500]], equal_nan=True)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (depth_image(MILLIMETERS.astype(np.uint8), "mono8"), "16UC1 in millimeters"),
        (compressed("16UC1; compressedDepth rvl", bytes(40)), "format:=png"),
        (compressed("16UC1; compressedDepth png", bytes(4)), "with 4 bytes"),
        (compressed("png", png(MILLIMETERS.astype(np.uint8))), "16 bits a pixel"),
        (compressed("png", png(np.zeros((20, 20), np.uint16))), "100"),
    ],
)
def test_other_depth_is_refused_with_the_reason(message, reason):
    with pytest.raises(ImageError, match=reason):
        decode_depth(message, 100)


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


def random_message(generator, given, sensor):
    """A message of a sensor with a stamp, size and numbers of any kind."""
    stamp = given.start + int(generator.integers(-3, 60)) * given.frame
    if generator.random() < 0.1:
        stamp = int(generator.choice([0, 1, 2**31 * SECOND - 1, given.start + 86_400 * SECOND]))
    odd = float(generator.choice([1.0, 1.0, 0.0, math.nan, math.inf, -1e30]))
    if sensor == "camera_info":
        size = generator.choice([given.width, given.width, 0, 33])
        return given.camera_info(int(size), given.height, 500.0 * odd)
    if sensor == "depth":
        shape = generator.integers(1, 60, 2)
        message = given.depth(stamp, np.full(shape, odd, np.float32))
        if generator.random() < 0.2:
            message.step += 1
        return message
    if sensor == "odom":
        message = given.odometry(stamp, odd, frame="odom" if generator.random() < 0.8 else "")
        message.pose.pose.orientation.z = odd - 1.0
        return message
    return given.imu(stamp, (0.0, -odd, 0.1))


@pytest.mark.slow
def test_it_survives_any_mixture_and_then_goes_on(scene, make_localizer, given):
    generator = np.random.default_rng(7)
    for sensor, message_type in (("depth", Image), ("odom", Odometry), ("imu", Imu)):
        scene.add_sensor(message_type, sensor)
    localizer = make_localizer(camera__height=1.5)
    scene.meet(localizer)
    sent = 0
    for _ in range(300):
        sensor = str(generator.choice(["camera_info", "depth", "odom", "imu", "tracker"]))
        if sensor != "tracker":
            scene.send(sensor, random_message(generator, given, sensor))
            continue
        sent += 1
        sides = generator.choice([-50.0, 0.0, 10.0, 300.0, 2000.0, 1e30, math.nan], 4)
        target = given.target(
            id=int(generator.integers(1, 4)),
            box=tuple(map(float, sides)),
            state=str(generator.choice(["tracking", "tracking", "occluded", "lost"])),
            confidence=float(generator.choice([0.9, 0.1, math.nan])),
        )
        stamp = given.start + int(generator.integers(-3, 60)) * given.frame
        scene.publish(stamp, [target], image_width=int(generator.choice([640, 0, 31])))
        scene.wait_for(lambda sent=sent: localizer._arrivals.count == sent, "status")

    # With sound messages of a later time, all is well again.
    start = given.start + 10**6 * SECOND
    scene.calibrate()
    scene.wait_for(lambda: not localizer._waiting, "end of waiting")
    for index in range(10):
        stamp = start + index * given.frame
        for later in (-SECOND // 100, SECOND // 100):
            scene.send("odom", given.odometry(stamp + later))
        scene.send("depth", given.depth(stamp, np.full((48, 64), 6.0, np.float32)))
        scene.send("imu", given.imu(stamp, (0.0, -1.0, 0.0)))
        status = scene.show(stamp, [given.target(box=given.box_at(6.0, 0.0))])
    assert status.values["pose"] == "published", status.message
    assert float(status.targets[1]["x"]) == pytest.approx(6.0, abs=0.3)
    assert status.values["camera_mounting"] == "imu"
