"""The parameters of the localizer."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pf_tracker_ros.parameters import declared, group
from pf_tracker_ros.world import METHODS

DEPTH_TRANSPORTS = ("raw", "compressed", "compressedDepth")


@dataclass(frozen=True)
class CameraParameters:
    """Where the camera is mounted."""

    height: float = declared(
        0.0,
        "Height of the camera above the ground. 0 takes height and angles from tf2 where it is "
        "installed and has the camera's frame; else the height is learned from 50 boxes of targets "
        "of 'target.height'.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )
    pitch: float = declared(
        0.0,
        "Angle by which the camera looks down. If both angles are 0, gravity on the topic imu "
        "replaces them.",
        unit="rad",
        minimum=-math.pi / 2,
        maximum=math.pi / 2,
    )
    roll: float = declared(
        0.0,
        "Angle by which the camera's right side is lowered.",
        unit="rad",
        minimum=-math.pi,
        maximum=math.pi,
    )


@dataclass(frozen=True)
class TargetParameters:
    """Size of the targets."""

    height: float = declared(
        1.75,
        "Mean height of the targets, as of people who walk.",
        unit="m",
        minimum=0.01,
        maximum=100.0,
    )
    height_sd: float = declared(
        0.1,
        "Standard deviation of their heights.",
        unit="m",
        minimum=0.0,
        maximum=100.0,
    )


@dataclass(frozen=True)
class LocalizerParameters:
    """Camera, targets and method of the localizer."""

    method: str = declared(
        "auto",
        "Source of the range: the depth image, the box's foot on the ground, or its height. auto "
        "fuses all that there are by their variances.",
        choices=("auto", *METHODS),
    )
    fixed_frame: str = declared(
        "odom",
        "Frame of the positions, with z up and the ground at 0. Without tf2 and odometry, its "
        "origin is the ground below the camera, with x forward.",
        allows_empty=False,
    )
    camera: CameraParameters = group(CameraParameters)
    rectified: bool = declared(
        False,
        "Whether the tracker's images are rectified, as image_rect is: the calibration is then the "
        "matrix p of CameraInfo, without distortion.",
    )
    target: TargetParameters = group(TargetParameters)
    depth_transport: str = declared(
        "raw",
        "Transport of the depth images: raw on the topic depth, or PNG on depth/compressed or "
        "depth/compressedDepth.",
        choices=DEPTH_TRANSPORTS,
    )
    depth_tolerance: float = declared(
        0.03,
        "Largest difference between the stamps of image and depth; other depth is not used.",
        unit="s",
        minimum=0.0,
        maximum=10.0,
    )
    min_confidence: float = declared(
        0.7,
        "Confidence of the tracker below which a box is no measurement, and the selected target "
        "has no pose.",
        minimum=0.0,
        maximum=1.0,
    )
    coast: float = declared(
        0.5,
        "Longest time for which the selected target has a predicted pose, with a growing "
        "covariance, while it is hidden or in doubt. 0 asks for a measurement in each image.",
        unit="s",
        minimum=0.0,
        maximum=60.0,
    )
    hold: float = declared(
        3.0,
        "Time without a pose after the position of a target that was out of sight contradicts the "
        "one from before, as on somebody else. It is shorter where position and confidence agree "
        "more, down to 0.",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    autostart: bool = declared(
        True,
        "Configure and activate the node at start-up; false waits for a lifecycle manager.",
        read_only=True,
    )
