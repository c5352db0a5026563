"""The tracker and the localizer through the library, fed as their nodes are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from follow_parts.messages import (
    camera_info_message,
    imu_message,
    odometry_message,
    plain,
    pose_message,
)
from follow_parts.rendering import CAMERA, CAMERA_HEIGHT, CAMERA_PITCH
from follow_parts.scenarios import Scenario
from follow_parts.world import ACCELERATION_NOISE, Motion
from pf_tracker_ros.boxes import Box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.localization.frame_localizer import FrameLocalizer, Sensors
from pf_tracker_ros.localization.localizer_parameters import (
    CameraParameters,
    LocalizerParameters,
)
from pf_tracker_ros.localization.located_frame import LocatedFrame
from pf_tracker_ros.localization.position_topics import certain_target
from pf_tracker_ros.localization.problems import Problems
from pf_tracker_ros.localization.sensors import (
    BasePoses,
    CameraCalibration,
    DepthImages,
    Gravity,
)
from pf_tracker_ros.localization.tracker_frame import ReportedTarget, TrackerFrame
from pf_tracker_ros.messages import image_message
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.topics import FrameResult, target_probability
from pf_tracker_ros.tracking.presets import preset_parameters

# The clock of the robot does not begin at 0, which means no stamp.
_EPOCH = 1000 * NANOSECONDS


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
    velocity: NDArray[np.float64] | None = None  # (2,) of the position, m/s; None without
    # (2,) unfiltered position in the frame of the odometry; None without
    measured: NDArray[np.float64] | None = None
    bearing: float | None = None  # angle to the left of the camera's axis, radians; None without


def stamp_at(time: float) -> int:
    """The stamp of a time in seconds."""
    return _EPOCH + round(time * NANOSECONDS)


def camera_parameters(*, has_imu: bool) -> CameraParameters:
    """As a user sets them: height and tilt of the camera by its drawing, or tilt by the IMU."""
    return CameraParameters(height=CAMERA_HEIGHT, pitch=0.0 if has_imu else CAMERA_PITCH)


class _Feed:
    """A topic that has messages, or none."""

    def __init__(self, *, is_used: bool) -> None:
        self.topic, self.is_used, self.is_silent = "", is_used, True


class LibraryChain:
    """`Session` with the preset `default`, set as that of the node, and `FrameLocalizer`."""

    def __init__(self, scenario: Scenario, seed: int, *, has_imu: bool) -> None:
        self.session = Session(preset_parameters("default", scenario.max_targets), seed)
        node = NodeParameters()
        self.session.frozen_after = node.frozen_after
        self.session.frame_buffer.limit(node.frame_buffer_length, node.frame_buffer_megabytes)
        self._max_targets = scenario.max_targets
        self._parameters = LocalizerParameters(camera=camera_parameters(has_imu=has_imu))
        calibration = CameraCalibration(_Feed(is_used=True))
        calibration.take(1, "camera", camera_info_message(plain, None, CAMERA))
        self._depth = DepthImages(_Feed(is_used=scenario.has_depth))
        self._base = BasePoses(_Feed(is_used=True))
        self._gravity = Gravity(_Feed(is_used=has_imu))
        self._has_imu = has_imu
        sensors = Sensors(calibration, self._depth, self._base, self._gravity)
        self._localizer = FrameLocalizer(sensors, Problems(lambda sentence: None, math.inf))

    def close(self) -> None:
        """Nothing has to be ended."""

    def take_motion(self, motion: Motion) -> None:
        """Take a message of the topic odom, and one of the topic imu where there is one."""
        pose, stamp = motion.odometry, stamp_at(motion.time)
        base = pose_message(plain, pose.x, pose.y, pose.yaw)
        self._base.take(stamp, "odom", odometry_message(plain, None, base))
        if self._has_imu and not self._gravity.is_needless(stamp):
            imu = imu_message(plain, None, motion.acceleration, ACCELERATION_NOISE)
            self._gravity.take(stamp, "camera", imu)

    def process(
        self, image: NDArray[np.uint8], depth: NDArray[np.uint16] | None, time: float
    ) -> Report:
        """Process an image; odometry up to its time, and after it, has been taken."""
        stamp, session = stamp_at(time), self.session
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


def _depth_message(depth: NDArray[np.uint16]) -> Any:
    message = image_message(plain, None, depth)
    message.is_bigendian = 0
    return message


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


def _report(result: FrameResult, located: LocatedFrame) -> Report:
    estimate, target = result.estimate, located.selected
    boxes: dict[int, Box] = {one.id: one.estimate.box for one in result.present}
    values: dict[str, Any] = {}
    if certain := certain_target(located):
        filtered = certain.filtered
        values["position"], values["velocity"] = filtered.position, filtered.velocity
        values["covariance"] = filtered.covariance[:2, :2]
    if target and target.place and located.sensed:
        pose = located.sensed.pose.pose
        values["measured"] = (pose.rotation @ target.place.position + pose.translation)[:2]
    if target and target.bearing and target.has_bearing:
        x, _, z = target.bearing.direction.tolist()
        values["bearing"] = math.atan2(-x, z)
    return Report(
        state=result.state,
        confidence=float(estimate.confidence) if estimate else math.nan,
        box=boxes.get(result.selected),
        targets=boxes,
        **values,
    )
