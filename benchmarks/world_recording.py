r"""Writes a bag of a rendered room with exact truth, to try positions in meters on.

    python benchmarks/world_recording.py room.mcap
    track room.mcap --bag-topic /camera/image_raw --world --output room --bag --report \
        --parameter camera.height=0.8 --parameter camera.pitch=0.03

| topic | content |
|---|---|
| /camera/image_raw, /camera/camera_info | images, and their calibration |
| /camera/depth/image | depth in millimeters, with holes and noise |
| /camera/imu | accelerometer in the camera's optical frame, 50 Hz |
| /odom | the robot's base, 50 Hz |
| /tf, /tf_static | the same, and the camera on it |
| /ground_truth | box of the first walker, also behind others |
| /truth/walker_N | where each walker is, geometry_msgs/PoseStamped |

room.target.yaml beside it has the boxes of the people in the first frame.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from follow_parts.rendering import CAMERA, CAMERA_HEIGHT, CAMERA_PITCH
from world_room import PILLAR, WALKERS, Room, RoomFrame

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.bag_writing import BagWriter
from pf_tracker_ros.messages import (
    IMAGE_TYPE,
    POLYGON_TYPE,
    MessageFactory,
    box_message,
    image_message,
)
from pf_tracker_ros.recordings.sidecar_files import target_file
from pf_tracker_ros.recordings.target import Target, file_text
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.world import CameraModel

IMAGE_TOPIC, DEPTH_TOPIC = "/camera/image_raw", "/camera/depth/image"
CAMERA_INFO_TOPIC, IMU_TOPIC, ODOMETRY_TOPIC = "/camera/camera_info", "/camera/imu", "/odom"
TRUTH = "/ground_truth"
FRAME, FIXED_FRAME = "camera_optical_frame", "odom"
_START = 1_700_000_000 * NANOSECONDS
_SENSOR_RATE, _GRAVITY, _IMU_NOISE = 50.0, 9.81, 0.05
TRANSFORM_TOPIC, STATIC_TRANSFORM_TOPIC = "/tf", "/tf_static"
_POSE, _TRANSFORMS = "geometry_msgs/msg/PoseStamped", "tf2_msgs/msg/TFMessage"
_BASE_FRAME = "base_link"


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
        mounting = _transform(writer, stamp_at(0.0), (_BASE_FRAME, FRAME), _MOUNTED)
        messages: list[tuple[int, str, Any]] = [(stamp_at(0.0), STATIC_TRANSFORM_TOPIC, mounting)]
        generator = np.random.default_rng(room.seed)
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
            transform = _transform(writer, stamp, (FIXED_FRAME, _BASE_FRAME), moved)
            messages.append((stamp, TRANSFORM_TOPIC, transform))
            messages.append((stamp, IMU_TOPIC, _imu(writer, stamp, generator)))
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


def pose_message(new: MessageFactory, x: float, y: float, yaw: float = 0.0) -> Any:
    """A pose on the ground as geometry_msgs/Pose."""
    turn = {"z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}
    return new(
        "geometry_msgs/msg/Pose",
        position=new("geometry_msgs/msg/Point", x=x, y=y),
        orientation=new("geometry_msgs/msg/Quaternion", **turn),
    )


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


def odometry_message(new: MessageFactory, header: Any, pose: Any) -> Any:
    """A pose of the robot's base as nav_msgs/Odometry, without covariances."""
    kinds = {"pose": {"pose": pose}, "twist": {}}
    parts = {
        name: new(
            f"geometry_msgs/msg/{name.title()}WithCovariance", covariance=np.zeros(36), **given
        )
        for name, given in kinds.items()
    }
    return new("nav_msgs/msg/Odometry", header=header, child_frame_id=_BASE_FRAME, **parts)


def _imu(writer: BagWriter, stamp: int, generator: np.random.Generator) -> Any:
    # Upward at rest, in axes to the right, down and forward.
    up = -np.array([0.0, np.cos(CAMERA_PITCH), np.sin(CAMERA_PITCH)])
    x, y, z = (_GRAVITY * up + generator.normal(0.0, _IMU_NOISE, 3)).tolist()
    zeros = np.zeros(9)
    return writer.new(
        "sensor_msgs/msg/Imu",
        header=writer.header(stamp, FRAME),
        orientation_covariance=np.array([-1.0, *zeros[1:]]),
        angular_velocity_covariance=zeros,
        linear_acceleration=writer.new("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
        linear_acceleration_covariance=_IMU_NOISE**2 * np.eye(3).ravel(),
    )


def camera_info_message(new: MessageFactory, header: Any, camera: CameraModel) -> Any:
    """A calibration as sensor_msgs/CameraInfo."""
    k = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    return new(
        "sensor_msgs/msg/CameraInfo",
        header=header,
        height=camera.height,
        width=camera.width,
        distortion_model=camera.model,
        d=np.array(camera.distortion, dtype=float),
        k=k.ravel(),
        r=np.eye(3).ravel(),
        p=np.column_stack([k, np.zeros(3)]).ravel(),
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Write the bag."""
    parser = argparse.ArgumentParser(
        description=str(__doc__), formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bag", type=Path, help="the new bag, such as room.mcap")
    parser.add_argument("--frames", type=int, default=80, help="(default: %(default)s)")
    parser.add_argument(
        "--rate", type=float, default=10.0, metavar="HZ", help="of frames (default: %(default)s)"
    )
    options = parser.parse_args(argv)
    if options.frames < 1 or not options.rate > 0.0:
        parser.error("--frames is at least 1, --rate above 0")
    room = Room(rate=options.rate, pillars=(PILLAR,))
    try:
        frames = write_room(room, options.bag, options.frames)
        targets = first_targets(frames[0], len(WALKERS))
        text = file_text(targets, options.bag, "as they were rendered")
        target_file(options.bag).write_text(text, encoding="utf-8")
    except (FootageError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
