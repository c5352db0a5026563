"""The tracker and the localizer through the library, fed as their nodes are.

The poses and bearings are the messages that the node `localizer` would publish.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from follow_parts.rendering import CAMERA, CAMERA_HEIGHT, CAMERA_PITCH
from follow_parts.scenarios import Scenario
from follow_parts.world import Motion
from pf_tracker_ros import Detections
from pf_tracker_ros.boxes import Box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.localization.frame_localizer import FrameLocalizer, Sensors
from pf_tracker_ros.localization.localizer_parameters import (
    CameraParameters,
    LocalizerParameters,
)
from pf_tracker_ros.localization.located_frame import LocatedFrame
from pf_tracker_ros.localization.position_topics import POSITION_TOPICS, Headers
from pf_tracker_ros.localization.problems import Problems
from pf_tracker_ros.localization.sensors import (
    BasePoses,
    CameraCalibration,
    DepthImages,
    Gravity,
)
from pf_tracker_ros.localization.tracker_frame import ReportedTarget, TrackerFrame
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.topics import FrameResult, target_probability
from pf_tracker_ros.tracking.presets import preset_parameters

# The clock of the robot does not begin at 0, which means no stamp.
_EPOCH = 1000 * NANOSECONDS
_BUILDERS = {topic.name: topic.build for topic in POSITION_TOPICS}


@dataclass(frozen=True, eq=False)
class Report:
    """What tracker and localizer publish of an image."""

    state: str  # of the selected target, `idle` without
    confidence: float  # of the selected target; NaN without
    box: Box | None  # of the selected target; None without, or while it is lost
    targets: dict[int, Box]  # id of each target that is not lost, to its box
    # (2,) of the pose in the frame of the odometry; None without
    position: NDArray[np.float64] | None = None
    covariance: NDArray[np.float64] | None = None  # (2, 2) of the position; None without
    velocity: NDArray[np.float64] | None = None  # (2,) of the odometry topic; None without
    # (2,) unfiltered position in the frame of the odometry; None without
    measured: NDArray[np.float64] | None = None
    bearing: float | None = None  # angle to the left of the camera's axis, radians; None without


def stamp_at(time: float) -> int:
    """The stamp of a time in seconds."""
    return _EPOCH + round(time * NANOSECONDS)


def camera_parameters(*, has_imu: bool) -> dict[str, float]:
    """As a user sets them: height and tilt of the camera by its drawing, or tilt by the IMU."""
    return {"height": CAMERA_HEIGHT, "pitch": 0.0 if has_imu else CAMERA_PITCH}


def session(max_targets: int, seed: int) -> Session:
    """A session with the preset `default`, set as that of the node."""
    made, node = Session(preset_parameters("default", max_targets), seed), NodeParameters()
    made.frozen_after = node.frozen_after
    made.frame_buffer.limit(node.frame_buffer_length, node.frame_buffer_megabytes)
    return made


def camera_info() -> Any:
    """The fields of sensor_msgs/CameraInfo."""
    fx, fy, cx, cy = CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy
    return SimpleNamespace(
        width=CAMERA.width,
        height=CAMERA.height,
        distortion_model="plumb_bob",
        d=(0.0,) * 5,
        k=(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0),
        p=(fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0),
        binning_x=0,
        binning_y=0,
        roi=SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0),
    )


class _Feed:
    """A topic that has messages, or none."""

    def __init__(self, *, is_used: bool) -> None:
        self.topic, self.is_used, self.is_silent = "", is_used, True


class LibraryChain:
    """`Session` and `FrameLocalizer`, in lockstep.

    Args:
        scenario: What there is to be fed.
        seed: Of the tracker.
        has_imu: Whether there is an accelerometer.
    """

    def __init__(self, scenario: Scenario, seed: int, *, has_imu: bool) -> None:
        self._session = session(scenario.max_targets, seed)
        self._max_targets = scenario.max_targets
        self._parameters = LocalizerParameters(
            camera=CameraParameters(**camera_parameters(has_imu=has_imu))
        )
        self._calibration = CameraCalibration(_Feed(is_used=True))
        self._calibration.take(1, "camera", camera_info())
        self._depth = DepthImages(_Feed(is_used=scenario.has_depth))
        self._base = BasePoses(_Feed(is_used=True))
        self._gravity = Gravity(_Feed(is_used=has_imu))
        self._has_imu = has_imu
        self._problems = Problems(lambda sentence: None, math.inf)
        self._localizer = FrameLocalizer(
            Sensors(self._calibration, self._depth, self._base, self._gravity), self._problems
        )

    def take_motion(self, motion: Motion) -> None:
        """Take a message of the topic odom, and one of the topic imu where there is one."""
        pose, stamp = motion.odometry, stamp_at(motion.time)
        half = pose.yaw / 2.0
        orientation = SimpleNamespace(x=0.0, y=0.0, z=math.sin(half), w=math.cos(half))
        position = SimpleNamespace(x=pose.x, y=pose.y, z=0.0)
        pose_message = SimpleNamespace(position=position, orientation=orientation)
        message = SimpleNamespace(pose=SimpleNamespace(pose=pose_message))
        self._base.take(stamp, "odom", message)
        if self._has_imu and not self._gravity.is_needless(stamp):
            x, y, z = motion.acceleration.tolist()
            acceleration = SimpleNamespace(x=x, y=y, z=z)
            imu = SimpleNamespace(
                linear_acceleration=acceleration, linear_acceleration_covariance=[0.0] * 9
            )
            self._gravity.take(stamp, "camera", imu)

    def take_detections(self, detections: Detections, time: float) -> None:
        """Take the detections of the image of a time."""
        self._session.add_detections(detections, stamp_at(time))

    def request(self, box: Box, time: float) -> None:
        """Draw a box on the image of a time."""
        self._session.request(box, stamp_at(time))

    def select(self, id: int) -> None:
        """Select a target."""
        self._session.select(id)

    def process(
        self, image: NDArray[np.uint8], depth: NDArray[np.uint16] | None, time: float
    ) -> Report:
        """Process an image; odometry up to its time, and after it, has been taken."""
        stamp, session = stamp_at(time), self._session
        if depth is not None:
            self._depth.take(stamp, "camera", _depth_message(depth))
        outcome = session.process(Frame(image, stamp))
        result = FrameResult(
            targets=outcome.targets,
            selected=outcome.selected,
            max_targets=self._max_targets,
            detector_runs=session.detector_runs,
            image=image,
        )
        located = self._localizer.locate(
            _tracker_frame(result, stamp),
            self._parameters,
            lambda: _probability(result),
            is_last_chance=True,
        )
        session.set_hints(located.hints, stamp)
        return _report(result, located)

    def close(self) -> None:
        """Nothing has to be ended."""


def _depth_message(depth: NDArray[np.uint16]) -> Any:
    rows, columns = depth.shape
    return SimpleNamespace(
        height=rows,
        width=columns,
        encoding="16UC1",
        is_bigendian=0,
        step=2 * columns,
        data=depth.tobytes(),
    )


def _probability(result: FrameResult) -> NDArray[np.float64] | None:
    probability = target_probability(result)
    return None if probability is None else probability / 255.0


def _tracker_frame(result: FrameResult, stamp: int) -> TrackerFrame:
    """The result as the tracker reports it on `~/status`."""
    return TrackerFrame(
        stamp=stamp,
        frame_id="camera",
        is_skipped=False,
        state=result.state,
        selected=result.selected,
        image_size=(CAMERA.width, CAMERA.height),
        targets=tuple(map(ReportedTarget.of, result.targets)),
    )


def _new(message_type: str, **fields: Any) -> Any:
    """A message with the given fields."""
    return SimpleNamespace(**fields)


def _published(name: str, located: LocatedFrame) -> Any:
    """The message of a topic of the localizer, None without."""
    headers = Headers(SimpleNamespace(), SimpleNamespace())
    return _BUILDERS[name](_new, headers, located)


def _report(result: FrameResult, located: LocatedFrame) -> Report:
    estimate = result.estimate
    boxes: dict[int, Box] = {one.id: one.estimate.box for one in result.present}
    values: dict[str, Any] = {}
    odometry = _published("odometry", located)
    if odometry:
        values = odometry_values(odometry)
    target = located.selected
    if target and target.place and located.sensed:
        pose = located.sensed.pose.pose
        values["measured"] = (pose.rotation @ target.place.position + pose.translation)[:2]
    bearing = _published("bearing", located)
    if bearing:
        values["bearing"] = math.atan2(-bearing.vector.x, bearing.vector.z)
    return Report(
        state=result.state,
        confidence=float(estimate.confidence) if estimate else math.nan,
        box=boxes.get(result.selected),
        targets=boxes,
        **values,
    )


def odometry_values(message: Any) -> dict[str, Any]:
    """Position, covariance and velocity of the localizer's odometry message.

    Its twist is in the frame of the target.
    """
    pose, twist = message.pose.pose, message.twist.twist
    covariance: Sequence[float] = message.pose.covariance
    yaw = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
    cosine, sine = math.cos(yaw), math.sin(yaw)
    x, y = twist.linear.x, twist.linear.y
    return {
        "position": np.array([pose.position.x, pose.position.y]),
        "covariance": np.reshape(covariance, (6, 6))[:2, :2],
        "velocity": np.array([cosine * x - sine * y, sine * x + cosine * y]),
    }
