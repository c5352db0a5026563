"""What the sensors beside the tracker say at a stamp: calibration, depth, odometry and gravity.

Each store takes the messages of one topic, of rclpy or of a bag, and finds what belongs to an
image by its stamp. The latest message never stands for the right one.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.decoding.depth_decoding import decode_depth
from pf_tracker_ros.decoding.image_decoding import decode_raw
from pf_tracker_ros.localization.rigid_pose import RigidPose
from pf_tracker_ros.localization.stamped_buffer import StampedBuffer
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.world import CameraModel

# Nanoseconds of messages that are kept.
_KEPT = 2 * NANOSECONDS
_MAX_DEPTHS, _MAX_POSES = 30, 2000
# Bytes of the depth images that are kept.
_MAX_DEPTH_BYTES = 2**27
# Longest gap between two poses to interpolate in, seconds.
_MAX_POSE_GAP = 0.5
_MAX_PIXELS, _MAX_PROBABILITIES = 2**24, 2**16
# Standard gravity, and how far the acceleration of a robot may be from it, m/s^2.
_GRAVITY, _GRAVITY_TOLERANCE = 9.81, 1.0
# Time constant of the low-pass filter of gravity, and least time between two samples, seconds.
_GRAVITY_TIME, _GRAVITY_INTERVAL = 0.5, 0.01
# Longest time between the last measurement of gravity and an image, seconds.
_MAX_GRAVITY_AGE = 2.0
_OPTICAL = "optical_frame"


class NotYetError(ValueError):
    """What an image needs has not arrived, but may still."""


class Feed(Protocol):
    """Where the messages of a sensor come from."""

    @property
    def topic(self) -> str:
        """Full name of the topic."""

    @property
    def is_used(self) -> bool:
        """Whether the topic has a publisher, or had messages."""

    @property
    def is_silent(self) -> bool:
        """Whether no further message is to be expected."""


class TransformSource(Protocol):
    """Transforms between frames, as tf2 has them."""

    @property
    def are_published(self) -> bool:
        """Whether there are any."""

    def lookup(self, parent: str, child: str, stamp: int) -> RigidPose:
        """The pose of the frame `child` in `parent`; stamp 0 for one that does not change.

        Raises:
            NotYetError: It may still arrive.
            ValueError: There is none.
        """

    def clear(self) -> None:
        """Forget all, after a jump of the time."""


class Store:
    """The messages of one sensor.

    Attributes:
        name: Name of the topic in the parameters of a launch file or command, of the class.

    Args:
        feed: Where they come from.
    """

    name: str

    def __init__(self, feed: Feed) -> None:
        self._feed = feed
        self.forget()

    @property
    def is_used(self) -> bool:
        """Whether the topic has a publisher, or had messages."""
        return self._feed.is_used

    def forget(self) -> None:
        """Forget all messages."""
        raise NotImplementedError

    def is_needless(self, stamp: int) -> bool:
        """Whether a message need not even be read."""
        return False

    def take(self, stamp: int, frame_id: str, message: Any) -> None:
        """Store a message.

        Args:
            stamp: Of its header, nanoseconds.
            frame_id: Of its header.
            message: With the fields of its ROS type.

        Raises:
            ValueError: It cannot be used.
        """
        if stamp <= 0:
            raise ValueError("its messages have no stamps")
        self._take(stamp, frame_id, message)

    def _take(self, stamp: int, frame_id: str, message: Any) -> None:
        raise NotImplementedError


class CameraCalibration(Store):
    """The calibration on `camera_info`."""

    name = "camera_info"

    def forget(self) -> None:
        """Forget all messages."""
        self._latest: Any = None
        self._frame_id = ""
        self._key: Any = None
        self._model: CameraModel | ValueError | None = None

    def model(self, image_size: tuple[int, int] | None, *, rectified: bool) -> CameraModel:
        """The camera of images of a size.

        Args:
            image_size: (width, height), pixels; None checks nothing.
            rectified: Whether the images are rectified.

        Raises:
            NotYetError: There is none, but it may still arrive.
            ValueError: There is none, or it is invalid.
        """
        latest = self._latest
        if latest is None:
            topic = self._feed.topic
            reason = f"no CameraInfo on {topic}; remap camera_info, or let the camera publish it"
            raise (NotYetError if self.is_used else ValueError)(reason)
        key = (*_numbers(latest), image_size, rectified)
        if key != self._key:
            self._key = key
            try:
                self._model = _camera_model(latest, image_size, rectified=rectified)
            except ValueError as error:
                self._model = ValueError(
                    f"the CameraInfo on {self._feed.topic} is not usable: {error}"
                )
        if isinstance(self._model, CameraModel):
            return self._model
        raise self._model or ValueError(f"no CameraInfo on {self._feed.topic}")

    def difference(self, camera_frame: str) -> str:
        """Why it may be the calibration of another camera; empty if nothing says so.

        Args:
            camera_frame: `frame_id` of the images.
        """
        own, images = self._frame_id.lstrip("/"), camera_frame.lstrip("/")
        if not own or not images or own == images:
            return ""
        return (
            f"the CameraInfo on {self._feed.topic} is of the frame '{own}', but the images are of "
            f"'{images}'; if it is of another camera, positions are wrong: remap camera_info"
        )

    def take(self, stamp: int, frame_id: str, message: Any) -> None:
        """Store a message; a calibration needs no stamp."""
        self._latest, self._frame_id = message, frame_id


class DepthImages(Store):
    """Depth images on `depth`, found by stamp."""

    name = "depth"

    def forget(self) -> None:
        """Forget all messages."""
        self._buffer: StampedBuffer[Any] = StampedBuffer(_KEPT, _MAX_DEPTHS)
        self._decoded: tuple[int, NDArray[Any]] | None = None

    def find(self, stamp: int, tolerance: float) -> tuple[float, NDArray[Any]]:
        """The depth image nearest to a stamp, and its stamp relative to that, seconds.

        Args:
            stamp: Of the image, nanoseconds.
            tolerance: Largest difference, seconds.

        Raises:
            NotYetError: It may still arrive.
            ValueError: There is none within the tolerance, or it is invalid.
        """
        nearest = self._buffer.nearest(stamp)
        if nearest is None:
            reason = f"no depth image on {self._feed.topic}"
            raise (ValueError if self._feed.is_silent else NotYetError)(reason)
        offset = (nearest[0] - stamp) / NANOSECONDS
        if abs(offset) > tolerance:
            reason = (
                f"the nearest depth image is {abs(offset):.3f} s {_side(offset)} the image, more "
                f"than depth_tolerance ({tolerance:g} s)"
            )
            raise (NotYetError if offset < 0 and not self._feed.is_silent else ValueError)(reason)
        if self._decoded is None or self._decoded[0] != nearest[0]:
            try:
                self._decoded = nearest[0], decode_depth(nearest[1], _MAX_PIXELS)
            except ValueError as error:
                raise ValueError(f"depth {error}") from None
        return offset, self._decoded[1]

    def _take(self, stamp: int, frame_id: str, message: Any) -> None:
        if len(message.data) > _MAX_DEPTH_BYTES:
            raise ValueError(f"it has {len(message.data)} bytes; allowed: {_MAX_DEPTH_BYTES}")
        # A recording that starts again may have other images under the same stamps.
        self._decoded = None
        self._buffer.limit(max(2, min(_MAX_DEPTHS, _MAX_DEPTH_BYTES // (len(message.data) + 1))))
        self._buffer.add(stamp, message)


class Probabilities(Store):
    """Which pixels of the selected target's box are its own, from the tracker.

    The tracker computes it only for a subscriber.
    """

    name = "pf_tracker/target_probability"

    def forget(self) -> None:
        """Forget all messages."""
        self._buffer: StampedBuffer[NDArray[np.float64]] = StampedBuffer(_KEPT, _MAX_DEPTHS)

    def find(self, stamp: int) -> NDArray[np.float64] | None:
        """(rows, columns) probabilities, 0 to 1, over the box at a stamp; None without."""
        found = self._buffer.nearest(stamp)
        return found[1] if found and found[0] == stamp else None

    def _take(self, stamp: int, frame_id: str, message: Any) -> None:
        pixels = decode_raw(message)
        if pixels.ndim != 2 or pixels.dtype != np.uint8 or pixels.size > _MAX_PROBABILITIES:
            raise ValueError("it is no small image of the encoding mono8")
        self._buffer.add(stamp, pixels / 255.0)


class BasePoses(Store):
    """Poses of the robot's base on `odom`, interpolated at a stamp."""

    name = "odom"

    def forget(self) -> None:
        """Forget all messages."""
        self._frame_id = ""
        self._buffer: StampedBuffer[RigidPose] = StampedBuffer(_KEPT, _MAX_POSES)

    def pose_at(self, stamp: int, fixed_frame: str) -> RigidPose:
        """The base's pose at a stamp.

        Args:
            stamp: Nanoseconds.
            fixed_frame: Frame in which the pose is wanted.

        Raises:
            NotYetError: The pose after the stamp may still arrive.
            ValueError: There is none at the stamp, or it is in another frame.
        """
        before, after = self._buffer.around(stamp)
        if before is None and after is None:
            reason = f"{self._feed.topic} has a publisher, but no odometry has arrived"
            raise (ValueError if self._feed.is_silent else NotYetError)(reason)
        if self._frame_id.lstrip("/") != fixed_frame.lstrip("/"):
            raise ValueError(
                f"odometry is in the frame '{self._frame_id}', but fixed_frame is '{fixed_frame}'; "
                "set fixed_frame to that frame"
            )
        if after is None:
            ends = (stamp - before[0]) / NANOSECONDS if before else 0.0
            reason = f"odometry ends {ends:.3f} s before the image"
            raise (ValueError if self._feed.is_silent else NotYetError)(reason)
        if before is None:
            begins = (after[0] - stamp) / NANOSECONDS
            raise ValueError(f"odometry begins {begins:.3f} s after the image")
        gap = after[0] - before[0]
        if gap > _MAX_POSE_GAP * NANOSECONDS:
            raise ValueError(
                f"odometry has a gap of {gap / NANOSECONDS:.3f} s around the image; allowed: "
                f"{_MAX_POSE_GAP:g} s"
            )
        return before[1].interpolate(after[1], (stamp - before[0]) / gap if gap else 0.0)

    def _take(self, stamp: int, frame_id: str, message: Any) -> None:
        pose = message.pose.pose
        self._buffer.add(stamp, RigidPose.of_message(pose.position, pose.orientation))
        self._frame_id = frame_id


class Gravity(Store):
    """The direction of gravity in camera coordinates, from the accelerometer on `imu`.

    An accelerometer at rest measures an acceleration upward (REP 145).
    """

    name = "imu"

    def forget(self) -> None:
        """Forget all messages."""
        self._stamp_of_last = self._measured_at = 0
        self._down: NDArray[np.float64] | None = None
        self._frame_id = ""

    def down(
        self, stamp: int, camera_frame: str, transforms: TransformSource | None
    ) -> NDArray[np.float64] | None:
        """(3,) vector down in camera coordinates; None without measurements.

        Args:
            stamp: Of the image, nanoseconds.
            camera_frame: Optical frame of the camera.
            transforms: Of tf2; without, the frame of the messages must be optical, too.

        Raises:
            ValueError: The last measurement is too far from the stamp, or the rotation between
                sensor and camera is unknown.
        """
        if self._down is None:
            return None
        offset = (self._measured_at - stamp) / NANOSECONDS
        if abs(offset) > _MAX_GRAVITY_AGE:
            raise ValueError(
                f"gravity on {self._feed.topic} was last measured {abs(offset):.3f} s "
                f"{_side(offset)} the image; allowed: {_MAX_GRAVITY_AGE:g} s; let the sensor "
                "publish, or set camera.pitch and camera.roll"
            )
        frame = self._frame_id
        if frame == camera_frame or (frame.endswith(_OPTICAL) and camera_frame.endswith(_OPTICAL)):
            return self._down
        if transforms is None:
            raise ValueError(
                f"gravity is in the frame '{frame}', whose rotation to the camera's frame "
                f"'{camera_frame}' is unknown without tf2_ros; set camera.pitch and camera.roll"
            )
        return transforms.lookup(camera_frame, frame, 0).rotation @ self._down

    def is_needless(self, stamp: int) -> bool:
        """Whether a message need not be read, as most at hundreds a second."""
        last = self._stamp_of_last
        return bool(last) and 0 <= stamp - last < _GRAVITY_INTERVAL * NANOSECONDS

    def _take(self, stamp: int, frame_id: str, message: Any) -> None:
        if message.linear_acceleration_covariance[0] == -1.0:
            raise ValueError("it has no linear acceleration (its covariance begins with -1)")
        acceleration = message.linear_acceleration
        down = -np.array([acceleration.x, acceleration.y, acceleration.z])
        size = float(np.linalg.norm(down))
        if not np.isfinite(size) or size < _GRAVITY / 10:
            raise ValueError(
                f"its linear acceleration is {size:.3g} m/s^2; expected gravity, {_GRAVITY} m/s^2 "
                "upward at rest (REP 145)"
            )
        elapsed = (stamp - self._stamp_of_last) / NANOSECONDS
        self._stamp_of_last = stamp
        if frame_id != self._frame_id or not 0.0 <= elapsed <= 1.0:
            self._frame_id, self._down = frame_id, None
        if abs(size - _GRAVITY) > _GRAVITY_TOLERANCE:
            # The robot accelerates.
            return
        self._measured_at = stamp
        if self._down is None:
            self._down = down
        else:
            self._down = self._down + (1.0 - np.exp(-elapsed / _GRAVITY_TIME)) * (down - self._down)


def _side(offset: float) -> str:
    return "before" if offset < 0 else "after"


def _numbers(info: Any) -> tuple[Any, ...]:
    """All that the camera model depends on."""
    region = info.roi
    return (
        info.width,
        info.height,
        info.distortion_model,
        *info.d,
        *info.k,
        *info.p,
        info.binning_x,
        info.binning_y,
        region.x_offset,
        region.y_offset,
        region.width,
        region.height,
    )


def _camera_model(info: Any, image_size: tuple[int, int] | None, *, rectified: bool) -> CameraModel:
    region = info.roi
    return CameraModel.from_calibration(
        info.width,
        info.height,
        info.distortion_model,
        tuple(info.d),
        tuple(info.k),
        projection=tuple(info.p) if rectified else None,
        binning=(info.binning_x, info.binning_y),
        region=(region.x_offset, region.y_offset, region.width, region.height),
        image_size=image_size,
    )
