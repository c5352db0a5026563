"""The sensors beside the tracker: calibration, depth, odometry and gravity, each by stamp."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu

from pf_tracker_ros.decoding.depth_decoding import decode_depth
from pf_tracker_ros.decoding.image_decoding import decode_raw
from pf_tracker_ros.node.localizer.problems import Problems
from pf_tracker_ros.node.localizer.rigid_pose import RigidPose
from pf_tracker_ros.node.localizer.stamped_buffer import StampedBuffer
from pf_tracker_ros.node.localizer.transforms import NotYetError, Transforms
from pf_tracker_ros.node.qos import subscribe
from pf_tracker_ros.node.tracker.image_subscription import ImageSubscription
from pf_tracker_ros.stamps import NANOSECONDS, stamp_of
from pf_tracker_ros.world import CameraModel

# Matches reliable and best-effort publishers.
_SENSOR_QOS = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
# Seconds since the last message after which none is waited for.
_SILENT_AFTER = 0.5
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
_OPTICAL = "optical_frame"


class Arrivals:
    """Counts the messages of an input.

    Attributes:
        count: Number of messages.
        last_at: Time of the last one, by `time.monotonic`; -inf before the first.
    """

    def __init__(self) -> None:
        self.count = 0
        self.last_at = float("-inf")

    def add(self) -> None:
        """Count a message."""
        self.count += 1
        self.last_at = time.monotonic()

    @property
    def silent_for(self) -> float:
        """Seconds since the last message; infinite before the first."""
        return time.monotonic() - self.last_at


class _Input:
    """A subscription with its arrivals and problems.

    Attributes:
        name: Name of the topic, of the class.
        arrivals: The messages since it was opened.

    Args:
        node: The subscribing node.
        problems: Where it tells its problems, under its name.
        arrived: Called after each message.
    """

    name: str

    def __init__(self, node: Node, problems: Problems, arrived: Callable[[], None]) -> None:
        self.arrivals = Arrivals()
        self._node = node
        self._problems = problems
        self._arrived = arrived
        self._subscription: Subscription | None = None
        self._forget()

    @property
    def topic(self) -> str:
        """Full name of the topic."""
        return str(self._node.resolve_topic_name(self.name))

    @property
    def is_used(self) -> bool:
        """Whether somebody publishes it, or has done so."""
        return bool(self.arrivals.count or self._node.count_publishers(self.topic))

    def close(self) -> None:
        """Unsubscribe."""
        if self._subscription:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _open(self, message_type: Any) -> None:
        self.arrivals = Arrivals()
        self._forget()
        self._subscription = subscribe(
            self._node,
            message_type,
            self.name,
            self._receive,
            profile=_SENSOR_QOS,
            report=lambda sentence: self._problems.tell(self.name, sentence),
        )

    def _receive(self, message: Any) -> None:
        self.arrivals.add()
        try:
            self._take(message)
        except ValueError as error:
            self._problems.set(self.name, f"{self.name} refused: {error}")
        else:
            self._problems.set(self.name, "")
        self._arrived()

    def _forget(self) -> None:
        """Forget all messages."""
        raise NotImplementedError

    def _take(self, message: Any) -> None:
        """Store a message, or raise ValueError."""
        raise NotImplementedError

    def _is_silent(self) -> bool:
        return self.arrivals.silent_for > _SILENT_AFTER

    def _stamp(self, message: Any) -> int:
        stamp = stamp_of(message.header)
        if stamp <= 0:
            raise ValueError("its messages have no stamps")
        return stamp


class CameraInfoInput(_Input):
    """The calibration on `camera_info`."""

    name = "camera_info"

    def _forget(self) -> None:
        self._latest: CameraInfo | None = None
        self._key: Any = None
        self._model: CameraModel | ValueError | None = None

    def open(self) -> None:
        """Subscribe."""
        self._open(CameraInfo)

    def model(self, image_size: tuple[int, int] | None, *, rectified: bool) -> CameraModel:
        """The camera of images of a size.

        Args:
            image_size: (width, height), pixels; None checks nothing.
            rectified: Whether the images are rectified.

        Raises:
            ValueError: There is none, or it is invalid.
        """
        latest = self._latest
        if latest is None:
            raise ValueError(f"no CameraInfo on {self.topic}; remap camera_info")
        key = (*_numbers(latest), image_size, rectified)
        if key != self._key:
            self._key = key
            try:
                self._model = _camera_model(latest, image_size, rectified=rectified)
            except ValueError as error:
                self._model = ValueError(f"the CameraInfo on {self.topic} is not usable: {error}")
        if isinstance(self._model, CameraModel):
            return self._model
        raise self._model or ValueError(f"no CameraInfo on {self.topic}")

    def _take(self, message: CameraInfo) -> None:
        self._latest = message


class DepthInput(_Input):
    """Depth images on `depth`, found by stamp."""

    name = "depth"
    _transport = "raw"
    _images: ImageSubscription | None = None

    def _forget(self) -> None:
        self._buffer: StampedBuffer[Image | CompressedImage] = StampedBuffer(_KEPT, _MAX_DEPTHS)
        self._decoded: tuple[int, NDArray[Any]] | None = None

    @property
    def topic(self) -> str:
        """Full name of the topic."""
        suffix = "" if self._transport == "raw" else f"/{self._transport}"
        return f"{self._node.resolve_topic_name(self.name)}{suffix}"

    def open(self, transport: str) -> None:
        """Subscribe, in place of an earlier subscription.

        Args:
            transport: `raw`, `compressed` or `compressedDepth`.
        """
        self.close()
        self.arrivals = Arrivals()
        self._forget()
        self._transport = transport
        self._images = ImageSubscription(
            self._node,
            self._receive,
            lambda sentence: self._problems.tell(self.name, sentence),
            self.topic,
        )
        self._images.open("raw" if transport == "raw" else "compressed", "auto")

    def close(self) -> None:
        """Unsubscribe."""
        if self._images:
            self._images.close()
            self._images = None

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
            raise ValueError(f"no depth image on {self.topic}")
        offset = (nearest[0] - stamp) / NANOSECONDS
        if abs(offset) > tolerance:
            reason = (
                f"the nearest depth image is {abs(offset):.3f} s {_side(offset)} the image, more "
                f"than depth_tolerance ({tolerance:g} s)"
            )
            raise (NotYetError if offset < 0 and not self._is_silent() else ValueError)(reason)
        if self._decoded is None or self._decoded[0] != nearest[0]:
            self._decoded = nearest[0], decode_depth(nearest[1], _MAX_PIXELS)
        return offset, self._decoded[1]

    def _take(self, message: Image | CompressedImage) -> None:
        if len(message.data) > _MAX_DEPTH_BYTES:
            raise ValueError(f"it has {len(message.data)} bytes; allowed: {_MAX_DEPTH_BYTES}")
        stamp = self._stamp(message)
        # A recording that starts again may have other images under the same stamps.
        self._decoded = None
        self._buffer.limit(max(2, min(_MAX_DEPTHS, _MAX_DEPTH_BYTES // (len(message.data) + 1))))
        self._buffer.add(stamp, message)


class ProbabilityInput(_Input):
    """Which pixels of the selected target's box are its own, from the tracker.

    The tracker computes it only for a subscriber.
    """

    name = "pf_tracker/target_probability"

    def _forget(self) -> None:
        self._buffer: StampedBuffer[NDArray[np.float64]] = StampedBuffer(_KEPT, _MAX_DEPTHS)

    def open(self) -> None:
        """Subscribe, unless it is subscribed."""
        if self._subscription is None:
            self._open(Image)

    def find(self, stamp: int) -> NDArray[np.float64] | None:
        """(rows, columns) probabilities, 0 to 1, over the box at a stamp; None without."""
        found = self._buffer.nearest(stamp)
        return found[1] if found and found[0] == stamp else None

    def _take(self, message: Image) -> None:
        pixels = decode_raw(message)
        if pixels.ndim != 2 or pixels.dtype != np.uint8 or pixels.size > _MAX_PROBABILITIES:
            raise ValueError("it is no small image of the encoding mono8")
        self._buffer.add(self._stamp(message), pixels / 255.0)


class OdometryInput(_Input):
    """Poses of the robot's base on `odom`, interpolated at a stamp."""

    name = "odom"

    def _forget(self) -> None:
        self._frame_id = ""
        self._buffer: StampedBuffer[RigidPose] = StampedBuffer(_KEPT, _MAX_POSES)

    def open(self) -> None:
        """Subscribe."""
        self._open(Odometry)

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
            raise ValueError(f"{self.topic} has a publisher, but no odometry has arrived")
        if self._frame_id.lstrip("/") != fixed_frame.lstrip("/"):
            raise ValueError(
                f"odometry is in the frame '{self._frame_id}', but fixed_frame is '{fixed_frame}'; "
                "set fixed_frame to that frame"
            )
        if after is None:
            ends = (stamp - before[0]) / NANOSECONDS if before else 0.0
            reason = f"odometry ends {ends:.3f} s before the image"
            raise (ValueError if self._is_silent() else NotYetError)(reason)
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

    def _take(self, message: Odometry) -> None:
        stamp = self._stamp(message)
        pose = message.pose.pose
        self._buffer.add(stamp, RigidPose.of_message(pose.position, pose.orientation))
        self._frame_id = message.header.frame_id


class GravityInput(_Input):
    """The direction of gravity in camera coordinates, from the accelerometer on `imu`.

    An accelerometer at rest measures an acceleration upward (REP 145).
    """

    name = "imu"

    def _forget(self) -> None:
        self._stamp_of_last = 0
        self._down: NDArray[np.float64] | None = None
        self._frame_id = ""

    def open(self) -> None:
        """Subscribe."""
        self._open(Imu)

    def down(self, camera_frame: str, transforms: Transforms | None) -> NDArray[np.float64] | None:
        """(3,) vector down in camera coordinates; None without measurements.

        Args:
            camera_frame: Optical frame of the camera.
            transforms: Of tf2; without, the frame of the messages must be optical, too.

        Raises:
            ValueError: The rotation between sensor and camera is unknown.
        """
        if self._down is None:
            return None
        frame = self._frame_id
        if frame == camera_frame or (frame.endswith(_OPTICAL) and camera_frame.endswith(_OPTICAL)):
            return self._down
        if transforms is None:
            raise ValueError(
                f"gravity is in the frame '{frame}', whose rotation to the camera's frame "
                f"'{camera_frame}' is unknown without tf2_ros; set camera.pitch and camera.roll"
            )
        return transforms.lookup(camera_frame, frame, 0).rotation @ self._down

    def _receive(self, message: Imu) -> None:
        # At hundreds of messages a second, most need not be read.
        stamp = stamp_of(message.header)
        last = self._stamp_of_last
        if last and 0 <= stamp - last < _GRAVITY_INTERVAL * NANOSECONDS:
            self.arrivals.add()
            return
        super()._receive(message)

    def _take(self, message: Imu) -> None:
        stamp = self._stamp(message)
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
        if message.header.frame_id != self._frame_id or not 0.0 <= elapsed <= 1.0:
            self._frame_id, self._down = message.header.frame_id, None
        if abs(size - _GRAVITY) > _GRAVITY_TOLERANCE:
            # The robot accelerates.
            return
        if self._down is None:
            self._down = down
        else:
            self._down = self._down + (1.0 - np.exp(-elapsed / _GRAVITY_TIME)) * (down - self._down)


def _side(offset: float) -> str:
    return "before" if offset < 0 else "after"


def _numbers(info: CameraInfo) -> tuple[Any, ...]:
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


def _camera_model(
    info: CameraInfo, image_size: tuple[int, int] | None, *, rectified: bool
) -> CameraModel:
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
