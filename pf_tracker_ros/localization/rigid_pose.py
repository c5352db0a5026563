"""Position and orientation of one frame in another."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray


class RigidPose(NamedTuple):
    """Maps points p of a frame to rotation p + translation in its parent.

    Attributes:
        rotation: (3, 3).
        translation: (3,), meters.
    """

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]

    @classmethod
    def identity(cls) -> RigidPose:
        """The pose of a frame in itself."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def of_message(cls, translation: Any, quaternion: Any) -> RigidPose:
        """From the fields x, y, z of a point or vector, and x, y, z, w of a quaternion.

        Raises:
            ValueError: A number is not finite, or the quaternion is not of unit length.
        """
        position = np.array([translation.x, translation.y, translation.z])
        turn = np.array([quaternion.x, quaternion.y, quaternion.z, quaternion.w])
        length = float(np.linalg.norm(turn))
        if not np.isfinite(position).all():
            raise ValueError("its position is not finite")
        # An unset quaternion has zeros.
        if not 0.9 < length < 1.1:
            raise ValueError(f"its quaternion has the length {length:.3g}; expected 1")
        x, y, z, w = turn / length
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        return cls(rotation, position)

    def __matmul__(self, other: RigidPose) -> RigidPose:
        """The pose of `other`'s frame, given in this one, in this one's parent."""
        return RigidPose(
            self.rotation @ other.rotation,
            self.rotation @ other.translation + self.translation,
        )

    def inverse(self) -> RigidPose:
        """The pose of the parent in the frame."""
        return RigidPose(self.rotation.T, -self.rotation.T @ self.translation)

    def interpolate(self, other: RigidPose, share: float) -> RigidPose:
        """The pose at a share, 0 to 1, of a motion with constant velocities to `other`."""
        turn, _ = cv2.Rodrigues(self.rotation.T @ other.rotation)
        part, _ = cv2.Rodrigues(share * turn)
        return RigidPose(
            self.rotation @ part,
            self.translation + share * (other.translation - self.translation),
        )
