"""The robot's sensors as ROS messages, for bags, and for the library where there is no ROS.

`new` creates a message from the name of its type and from fields, as in `pf_tracker_ros.messages`.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pf_tracker_ros.messages import MessageFactory
from pf_tracker_ros.world import CameraModel

BASE_FRAME = "base_link"


def plain(message_type: str, /, **fields: Any) -> SimpleNamespace:
    """A `new` without ROS: a message has the given fields alone."""
    return SimpleNamespace(**fields)


def pose_message(new: MessageFactory, x: float, y: float, yaw: float = 0.0) -> Any:
    """A pose on the ground as geometry_msgs/Pose."""
    turn = {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2.0), "w": math.cos(yaw / 2.0)}
    return new(
        "geometry_msgs/msg/Pose",
        position=new("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
        orientation=new("geometry_msgs/msg/Quaternion", **turn),
    )


def odometry_message(new: MessageFactory, header: Any, pose: Any) -> Any:
    """A pose of the robot's base as nav_msgs/Odometry, without covariances."""
    kinds = {"pose": {"pose": pose}, "twist": {}}
    parts = {
        name: new(
            f"geometry_msgs/msg/{name.title()}WithCovariance", covariance=np.zeros(36), **given
        )
        for name, given in kinds.items()
    }
    return new("nav_msgs/msg/Odometry", header=header, child_frame_id=BASE_FRAME, **parts)


def imu_message(new: MessageFactory, header: Any, acceleration: ArrayLike, std: float) -> Any:
    """A (3,) acceleration in m/s^2, and its standard deviation, as sensor_msgs/Imu."""
    x, y, z = np.asarray(acceleration).tolist()
    zeros = np.zeros(9)
    return new(
        "sensor_msgs/msg/Imu",
        header=header,
        orientation_covariance=np.array([-1.0, *zeros[1:]]),
        angular_velocity_covariance=zeros,
        linear_acceleration=new("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
        linear_acceleration_covariance=std**2 * np.eye(3).ravel(),
    )


def camera_info_message(new: MessageFactory, header: Any, camera: CameraModel) -> Any:
    """A calibration as sensor_msgs/CameraInfo."""
    k = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    whole = dict.fromkeys(("x_offset", "y_offset", "width", "height"), 0)
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
        binning_x=0,
        binning_y=0,
        roi=new("sensor_msgs/msg/RegionOfInterest", **whole),
    )
