"""The ground as a plane before a camera.

In camera coordinates (x right, y down, z forward) the ground is the points P with n P = h: n is the
unit vector down, h the height of the camera above the ground.

Pitch and roll are those of REP 103: the camera's body axes are x forward, y left, z up, and are
rotated by Rz(yaw) Ry(pitch) Rx(roll). A positive pitch looks down, a positive roll lowers the right
side. Then n = (cos(pitch) sin(roll), cos(pitch) cos(roll), sin(pitch)).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Height in meters from which a camera counts as mounted on something that does not move.
_FIXED_ABOVE = 3.0
# Standard deviation of the tilt between ground and camera, radians: of a vehicle that pitches on a
# road that is not flat, and of a mounted camera.
_TILT_SD_VEHICLE, _TILT_SD_FIXED = 0.01, 0.003
# Least and largest height of a camera, meters; the largest is also that of its standard deviation.
_LEAST_HEIGHT, _LARGEST_HEIGHT = 1e-3, 1e4


@dataclass(frozen=True, eq=False)
class GroundPlane:
    """The ground in camera coordinates.

    Attributes:
        down: (3,) unit vector down, orthogonal to the ground.
        height: Of the camera above the ground, meters; None where it is unknown.
        tilt_sd: Standard deviation of the angle between `down` and the ground's true normal, about
            each horizontal axis, radians. It contains unevenness of the ground.
        height_sd: Standard deviation of the height, meters.

    Raises:
        ValueError: A number is out of its range (heights 0.001 to 10,000 m, their standard
            deviation up to that, tilt_sd 0 to pi), or `down` has no direction.

    Example:
        Distances along rays from a level camera, 1.5 m above the ground:

        >>> from pf_tracker_ros.world import GroundPlane
        >>> plane = GroundPlane.from_angles(1.5)
        >>> plane.distances([(0.0, 0.3, 1.0), (0.0, 0.15, 1.0)]).round(3).tolist()
        [5.0, 10.0]
    """

    down: NDArray[np.float64]
    height: float | None
    tilt_sd: float
    height_sd: float = 0.0

    def __post_init__(self) -> None:
        down = np.array(self.down, dtype=np.float64)
        if down.shape != (3,) or not np.isfinite(down).all() or not down.any():
            raise ValueError(f"the direction down is {self.down!r}; expected three finite numbers")
        if self.height is not None and not _LEAST_HEIGHT <= self.height <= _LARGEST_HEIGHT:
            raise ValueError(
                f"the camera's height is {self.height!r}; expected {_LEAST_HEIGHT:g} to "
                f"{_LARGEST_HEIGHT:g} meters, or None where it is unknown"
            )
        if not (0.0 <= self.tilt_sd <= math.pi and 0.0 <= self.height_sd <= _LARGEST_HEIGHT):
            raise ValueError(
                f"tilt_sd is {self.tilt_sd!r} and height_sd {self.height_sd!r}; expected 0 to pi "
                f"radians, and 0 to {_LARGEST_HEIGHT:g} meters"
            )
        # The squares of large and small numbers are not finite or 0.
        down /= np.abs(down).max()
        down /= np.linalg.norm(down)
        down.setflags(write=False)
        object.__setattr__(self, "down", down)

    @classmethod
    def from_angles(
        cls,
        height: float | None,
        pitch: float = 0.0,
        roll: float = 0.0,
        tilt_sd: float | None = None,
    ) -> GroundPlane:
        """The ground below a camera with a pitch (positive looks down) and roll, radians.

        Args:
            height: Of the camera above the ground, meters; None where it is unknown.
            pitch: Radians.
            roll: Radians.
            tilt_sd: See the class; None means `default_tilt_sd`.
        """
        if not (math.isfinite(pitch) and math.isfinite(roll)):
            raise ValueError(f"pitch {pitch!r} and roll {roll!r} must be finite, in radians")
        down = (
            math.cos(pitch) * math.sin(roll),
            math.cos(pitch) * math.cos(roll),
            math.sin(pitch),
        )
        return cls(np.array(down), height, default_tilt_sd(height) if tilt_sd is None else tilt_sd)

    @classmethod
    def from_gravity(
        cls, height: float | None, gravity: ArrayLike, tilt_sd: float | None = None
    ) -> GroundPlane:
        """The ground orthogonal to gravity.

        Args:
            height: Of the camera above the ground, meters; None where it is unknown.
            gravity: (3,) vector down in camera coordinates, of any length. An accelerometer at rest
                measures the opposite, see REP 145.
            tilt_sd: See the class; None means `default_tilt_sd`.
        """
        down = np.asarray(gravity, dtype=np.float64)
        return cls(down, height, default_tilt_sd(height) if tilt_sd is None else tilt_sd)

    @classmethod
    def from_pose(
        cls,
        rotation: ArrayLike,
        translation: ArrayLike,
        ground_level: float = 0.0,
        tilt_sd: float | None = None,
    ) -> GroundPlane:
        """The ground of a frame whose z axis points up.

        Args:
            rotation: (3, 3) from the camera's optical frame to the fixed frame.
            translation: (3,) position of the camera in the fixed frame, meters.
            ground_level: z of the ground in the fixed frame, meters.
            tilt_sd: See the class; None means `default_tilt_sd`.
        """
        height = float(np.asarray(translation, dtype=np.float64)[2]) - ground_level
        down = -np.asarray(rotation, dtype=np.float64)[2]
        return cls(down, height, default_tilt_sd(height) if tilt_sd is None else tilt_sd)

    @property
    def pitch(self) -> float:
        """Angle by which the camera looks down, radians."""
        return math.asin(min(max(float(self.down[2]), -1.0), 1.0))

    @property
    def roll(self) -> float:
        """Angle by which the camera's right side is lowered, radians."""
        return math.atan2(float(self.down[0]), float(self.down[1]))

    def distances(self, rays: ArrayLike) -> NDArray[np.float64]:
        """(N,) distances in meters along (N, 3) unit vectors to the ground; NaN if they miss it."""
        if self.height is None:
            return np.full(len(np.asarray(rays)), np.nan)
        slopes = np.asarray(rays, dtype=np.float64) @ self.down
        return self.height / np.where(slopes > 1e-9, slopes, np.nan)


def default_tilt_sd(height: float | None) -> float:
    """Standard deviation of the tilt for a camera's height: a vehicle below 3 m, fixed above."""
    is_fixed = height is not None and height > _FIXED_ABOVE
    return _TILT_SD_FIXED if is_fixed else _TILT_SD_VEHICLE
