"""Writes bags of a drawn room with exact truth, to try positions in meters on.

| topic | content |
|---|---|
| /camera/image_raw, /camera/camera_info | images, and their calibration |
| /camera/depth/image | depth in millimeters, with holes and noise |
| /camera/imu | accelerometer in the camera's optical frame, 50 Hz |
| /odom | the robot's base, 50 Hz |
| /tf, /tf_static | the same, and the camera on it |
| /ground_truth | box of the first walker, also behind others |
| /truth/walker_N | where each walker is, geometry_msgs/PoseStamped |
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from follow_parts.messages import (
    BASE_FRAME,
    camera_info_message,
    imu_message,
    odometry_message,
    pose_message,
)
from follow_parts.rendering import CAMERA, CAMERA_HEIGHT, CAMERA_PITCH
from world_room import Room, RoomFrame

from pf_tracker_ros.footage.bag_writing import BagWriter
from pf_tracker_ros.messages import IMAGE_TYPE, POLYGON_TYPE, box_message, image_message
from pf_tracker_ros.recordings.target import Target
from pf_tracker_ros.stamps import NANOSECONDS

IMAGE_TOPIC, DEPTH_TOPIC = "/camera/image_raw", "/camera/depth/image"
CAMERA_INFO_TOPIC, IMU_TOPIC, ODOMETRY_TOPIC = "/camera/camera_info", "/camera/imu", "/odom"
TRUTH = "/ground_truth"
FRAME, FIXED_FRAME = "camera_optical_frame", "odom"
_START = 1_700_000_000 * NANOSECONDS
_SENSOR_RATE, _GRAVITY, _IMU_NOISE = 50.0, 9.81, 0.05
TRANSFORM_TOPIC, STATIC_TRANSFORM_TOPIC = "/tf", "/tf_static"
_POSE, _TRANSFORMS = "geometry_msgs/msg/PoseStamped", "tf2_msgs/msg/TFMessage"


def stamp_at(time: float) -> int:
    """The stamp of a time in seconds since the first frame, nanoseconds."""
    return _START + round(time * NANOSECONDS)


def write_room(room: Room, path: Path, count: int, latency: float = 0.0) -> list[RoomFrame]:
    """Write so many frames into a new bag, the images some seconds late; returns the frames.

    Raises:
        FootageError: The bag cannot be written.
    """
    frames = list(room.frames(count))
    late = round(latency * NANOSECONDS)
    with BagWriter(path) as writer:
        new = writer.new
        topics = {
            IMAGE_TOPIC: IMAGE_TYPE,
            DEPTH_TOPIC: IMAGE_TYPE,
            CAMERA_INFO_TOPIC: "sensor_msgs/msg/CameraInfo",
            IMU_TOPIC: "sensor_msgs/msg/Imu",
            ODOMETRY_TOPIC: "nav_msgs/msg/Odometry",
            TRANSFORM_TOPIC: _TRANSFORMS,
            STATIC_TRANSFORM_TOPIC: _TRANSFORMS,
            TRUTH: POLYGON_TYPE,
        }
        topics |= {f"/truth/walker_{one}": _POSE for one in range(1, len(room.walkers) + 1)}
        for topic, message_type in topics.items():
            writer.add_topic(topic, message_type)
        # (log time, topic, message)
        mounting = _transform(writer, stamp_at(0.0), (BASE_FRAME, FRAME), _MOUNTED)
        messages: list[tuple[int, str, Any]] = [(stamp_at(0.0), STATIC_TRANSFORM_TOPIC, mounting)]
        generator = np.random.default_rng(room.seed)
        # Upward at rest, in axes to the right, down and forward.
        gravity = -_GRAVITY * np.array([0.0, np.cos(CAMERA_PITCH), np.sin(CAMERA_PITCH)])
        # Past the last image, which is interpolated between two poses.
        for index in range(int((count / room.rate + 0.1) * _SENSOR_RATE) + 1):
            time = index / _SENSOR_RATE
            stamp = stamp_at(time)
            base = room.base(time)
            pose, header = (
                pose_message(new, base.x, base.y, base.yaw),
                writer.header(stamp, FIXED_FRAME),
            )
            messages.append((stamp, ODOMETRY_TOPIC, odometry_message(new, header, pose)))
            moved = (base.x, base.y, 0.0), (0.0, 0.0, np.sin(base.yaw / 2), np.cos(base.yaw / 2))
            transform = _transform(writer, stamp, (FIXED_FRAME, BASE_FRAME), moved)
            messages.append((stamp, TRANSFORM_TOPIC, transform))
            measured = gravity + generator.normal(0.0, _IMU_NOISE, 3)
            imu = imu_message(new, writer.header(stamp, FRAME), measured, _IMU_NOISE)
            messages.append((stamp, IMU_TOPIC, imu))
        for frame in frames:
            stamp = stamp_at(frame.time)
            header = writer.header(stamp, FRAME)
            messages += [
                (stamp + late, CAMERA_INFO_TOPIC, camera_info_message(new, header, CAMERA)),
                (stamp + late, IMAGE_TOPIC, image_message(new, header, frame.image)),
                (stamp + late, DEPTH_TOPIC, image_message(new, header, frame.depth)),
            ]
            if frame.boxes[0]:
                messages.append((stamp + late, TRUTH, box_message(new, header, frame.boxes[0])))
            for number, (x, y) in enumerate(frame.positions, start=1):
                pose = pose_message(new, float(x), float(y))
                message = new(_POSE, header=writer.header(stamp, FIXED_FRAME), pose=pose)
                messages.append((stamp, f"/truth/walker_{number}", message))
        for log_time, topic, message in sorted(messages, key=lambda one: one[0]):
            writer.write_message(topic, log_time, message)
    return frames


def first_targets(frame: RoomFrame, count: int) -> list[Target]:
    """The first walkers in sight in a frame, as targets of `track`."""
    size = frame.image.shape[1], frame.image.shape[0]
    return [
        Target(box, stamp=stamp_at(frame.time), frame=0, image_size=size, label=f"walker {number}")
        for number, box in enumerate(frame.boxes[:count], start=1)
        if box
    ]


# Of the camera on the base: the optical axes (right, down, forward), turned down by the pitch.
_MOUNTED = (
    (0.0, 0.0, CAMERA_HEIGHT),
    tuple(
        0.5
        * (
            np.cos(CAMERA_PITCH / 2) * np.array([-1, 1, -1, 1])
            + np.sin(CAMERA_PITCH / 2) * np.array([-1, 1, 1, -1])
        )
    ),
)


def _transform(
    writer: BagWriter,
    stamp: int,
    frames: tuple[str, str],
    pose: tuple[Sequence[float], Sequence[float]],
) -> Any:
    """A tf2_msgs/TFMessage of a frame in its parent, by translation and quaternion."""
    new = writer.new
    translation, rotation = (
        new(f"geometry_msgs/msg/{name}", **dict(zip("xyzw", map(float, values), strict=False)))
        for name, values in zip(("Vector3", "Quaternion"), pose, strict=True)
    )
    transform = new(
        "geometry_msgs/msg/TransformStamped",
        header=writer.header(stamp, frames[0]),
        child_frame_id=frames[1],
        transform=new("geometry_msgs/msg/Transform", translation=translation, rotation=rotation),
    )
    return new(_TRANSFORMS, transforms=[transform])
