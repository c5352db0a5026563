"""What the localizer makes of messages of any kind, order and time."""

import math

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image, Imu

SECOND = 10**9


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
