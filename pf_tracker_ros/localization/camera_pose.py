"""Pose of the camera in the fixed frame at an image's stamp, and the ground before it.

1. With `camera.height`, the camera is above the origin of the robot's base (x forward), by that
   height and tilted by `camera.pitch` and `camera.roll`; where both are 0, by gravity if the topic
   `imu` has it. The base moves as `odom` says, interpolated at the stamp. Without odometry the
   camera does not move, and the ground below it is the origin of the fixed frame.
2. Else, where somebody publishes transforms, the pose is that of tf2; the node needs tf2_ros.
3. Else the height is learned from people. The angles are those of the parameters or of gravity, or
   else learned, too. Until then there is no range from the ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.localization.rigid_pose import RigidPose
from pf_tracker_ros.localization.sensors import BasePoses, Gravity, TransformSource
from pf_tracker_ros.world import GroundPlane

# Least length of the horizontal part of a camera's axis to be the direction forward.
_MIN_HORIZONTAL = 0.1


@dataclass(frozen=True, eq=False)
class CameraPose:
    """Where the camera is.

    Attributes:
        pose: Of the camera's optical frame in the fixed frame.
        plane: The ground in camera coordinates.
        mounting: Source of the mounting: `parameters`, `imu`, `tf2`, `learned` or `assumed level`.
        motion: Source of the motion: `still`, `odometry` or `tf2`.
        has_known_tilt: Whether the direction down was neither learned nor assumed.
    """

    pose: RigidPose
    plane: GroundPlane
    mounting: str
    motion: str
    has_known_tilt: bool = True


def mounted_pose(plane: GroundPlane) -> RigidPose:
    """Pose of a camera in a frame on the ground below it, with z up and x forward.

    Forward is the horizontal part of the optical axis, or of the image's direction up where the
    camera looks straight down or up.
    """
    axis = np.array([0.0, 0.0, 1.0])
    forward = axis - (axis @ plane.down) * plane.down
    if np.linalg.norm(forward) < _MIN_HORIZONTAL:
        upward = np.array([0.0, -1.0, 0.0])
        forward = upward - (upward @ plane.down) * plane.down
    forward /= np.linalg.norm(forward)
    up = -plane.down
    rotation = np.array([forward, np.cross(up, forward), up])
    return RigidPose(rotation, np.array([0.0, 0.0, plane.height or 0.0]))


class CameraPoses:
    """Finds the pose of the camera.

    Args:
        odometry: Poses of the base.
        gravity: Direction of gravity.
        transforms: Of tf2; None where it is not installed.
    """

    def __init__(
        self, odometry: BasePoses, gravity: Gravity, transforms: TransformSource | None
    ) -> None:
        self._odometry = odometry
        self._gravity = gravity
        self._transforms = transforms

    def at(
        self,
        stamp: int,
        camera_frame: str,
        parameters: LocalizerParameters,
        learned: GroundPlane | None,
    ) -> CameraPose:
        """The camera at a stamp.

        Args:
            stamp: Of the image, nanoseconds.
            camera_frame: `frame_id` of the image.
            parameters: Of the localizer.
            learned: The ground learned from people, None without.

        Raises:
            NotYetError: What says so may still arrive.
            ValueError: It is unknown.
        """
        uses_transforms = (
            not parameters.camera.height
            and self._transforms is not None
            and self._transforms.are_published
        )
        if uses_transforms and self._transforms:
            pose = self._transforms.lookup(parameters.fixed_frame, camera_frame, stamp)
            if pose.translation[2] <= 0.0:
                raise ValueError(
                    f"the camera is {pose.translation[2]:.3g} m above the ground of the frame "
                    f"'{parameters.fixed_frame}'; set fixed_frame to one with the ground at z = 0"
                )
            return CameraPose(
                pose, GroundPlane.from_pose(pose.rotation, pose.translation), "tf2", "tf2"
            )
        try:
            down = self._known_down(stamp, camera_frame, parameters)
        except ValueError:
            if parameters.camera.height or learned is None:
                raise
            # The ground that was learned has a tilt, too.
            down = None
        plane, mounting = _mounting(parameters, down, learned)
        mounted = mounted_pose(plane)
        if not self._odometry.is_used:
            return CameraPose(mounted, plane, mounting, "still", down is not None)
        base = self._odometry.pose_at(stamp, parameters.fixed_frame)
        pose = base @ mounted
        if plane.height is not None:
            plane = GroundPlane.from_pose(
                pose.rotation, pose.translation, float(base.translation[2]), plane.tilt_sd
            )
        on_ground = pose.translation - [0.0, 0.0, base.translation[2]]
        return CameraPose(
            RigidPose(pose.rotation, on_ground), plane, mounting, "odometry", down is not None
        )

    def _known_down(
        self, stamp: int, camera_frame: str, parameters: LocalizerParameters
    ) -> NDArray[np.float64] | None:
        """(3,) direction down in camera coordinates by parameters or gravity; None if unknown."""
        camera = parameters.camera
        if not (camera.pitch or camera.roll):
            return self._gravity.down(stamp, camera_frame, self._transforms)
        return GroundPlane.from_angles(None, camera.pitch, camera.roll).down


def _mounting(
    parameters: LocalizerParameters,
    down: NDArray[np.float64] | None,
    learned: GroundPlane | None,
) -> tuple[GroundPlane, str]:
    """The ground before the camera on a level base, and where it is from."""
    camera = parameters.camera
    if not camera.height and learned is not None:
        if down is None:
            return learned, "learned"
        return GroundPlane(down, learned.height, learned.tilt_sd, learned.height_sd), "learned"
    height = camera.height or None
    if down is not None and not (camera.pitch or camera.roll):
        return GroundPlane.from_gravity(height, down), "imu"
    is_given = camera.height or down is not None
    plane = GroundPlane.from_angles(height, camera.pitch, camera.roll)
    return plane, "parameters" if is_given else "assumed level"
