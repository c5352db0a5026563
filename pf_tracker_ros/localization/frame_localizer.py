"""Locates the targets of the tracker's frames with what the sensors say at their stamps.

A frame that needs a message which may still arrive raises `NotYetError`, and is tried again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.localization.camera_pose import CameraPoses
from pf_tracker_ros.localization.ground_learning import GroundLearning
from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.localization.located_frame import LocatedFrame
from pf_tracker_ros.localization.problems import Problems
from pf_tracker_ros.localization.sensors import (
    BasePoses,
    CameraCalibration,
    DepthImages,
    Gravity,
    NotYetError,
    TransformSource,
)
from pf_tracker_ros.localization.tracker_frame import TrackerFrame
from pf_tracker_ros.localization.world_tracks import LocatedTarget, Sensed, WorldTracks
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.world.depth import check_depth

# Nanoseconds from which an older frame is the first after a jump of the time.
_JUMP = NANOSECONDS
_SKIPPED = "the tracker skipped the image"


@dataclass(frozen=True, eq=False)
class Sensors:
    """The sensors beside the tracker, each found by stamp.

    Attributes:
        calibration: Of the camera.
        depth: Depth images.
        base: Poses of the robot's base.
        gravity: Direction of gravity.
        transforms: Of tf2; None without.
    """

    calibration: CameraCalibration
    depth: DepthImages
    base: BasePoses
    gravity: Gravity
    transforms: TransformSource | None = None


class FrameLocalizer:
    """Locates frames in order.

    Attributes:
        time_jumps: Number of jumps of the time back.

    Args:
        sensors: The sensors.
        problems: Where it tells what is wrong with them.
    """

    def __init__(self, sensors: Sensors, problems: Problems) -> None:
        self.time_jumps = 0
        self._sensors = sensors
        self._problems = problems
        self._poses = CameraPoses(sensors.base, sensors.gravity, sensors.transforms)
        self._tracks = WorldTracks()
        self._last_stamp = 0
        self._silent_since: int | None = None
        self.forget_ground()

    def forget_positions(self) -> None:
        """Start all positions anew."""
        self._tracks.clear()

    def forget_ground(self) -> None:
        """Learn the ground anew."""
        self._learning = GroundLearning()

    def locate(
        self,
        frame: TrackerFrame,
        parameters: LocalizerParameters,
        probability: Callable[[], NDArray[np.float64] | None],
        *,
        is_last_chance: bool,
        waited: float = 0.0,
    ) -> LocatedFrame:
        """Locate the targets of a frame.

        Args:
            frame: Of the tracker.
            parameters: Of the localizer.
            probability: Returns the probability of each pixel in the selected target's box to be
                its own, (rows, columns), or None; called only with depth.
            is_last_chance: Whether the frame is located without what has not arrived.
            waited: Seconds for which it waited.

        Raises:
            NotYetError: Something may still arrive, and it is not the last chance.
        """
        sensed: Sensed | None = None
        targets: tuple[LocatedTarget, ...] = ()
        silence = self._skip_reason(frame)
        if not silence:
            try:
                sensed = self._sense(frame, parameters, probability, is_last_chance=is_last_chance)
                targets = self._tracks.advance(frame, sensed, parameters)
            except ValueError as error:
                if isinstance(error, NotYetError) and not is_last_chance:
                    raise
                silence, sensed = str(error), None
                self._tracks.miss(frame, parameters)
            self._problems.set("frame", silence)
        if sensed:
            silence = _silence(frame, targets)
            if silence and frame.selected:
                since = frame.stamp / NANOSECONDS
                self._problems.tell(
                    "pose",
                    f"no pose from the image at {since:.3f} s on: {silence}; the status of the "
                    "localizer says so for each image",
                )
        return self.located(frame, silence, waited, sensed, targets)

    def located(
        self,
        frame: TrackerFrame,
        silence: str,
        waited: float = 0.0,
        sensed: Sensed | None = None,
        targets: tuple[LocatedTarget, ...] = (),
    ) -> LocatedFrame:
        """Finish a frame, here also one that is not located; arguments as of `LocatedFrame`."""
        if not frame.is_skipped:
            self._last_stamp = max(frame.stamp, self._last_stamp)
        if not silence:
            self._silent_since = None
        elif self._silent_since is None:
            self._silent_since = frame.stamp
        return LocatedFrame(
            frame=frame,
            silence=silence,
            silent_since=self._silent_since or 0,
            problems=self._problems.sentences,
            sensed=sensed,
            learned_boxes=self._learning.boxes,
            targets=targets,
            waited=waited,
        )

    def _skip_reason(self, frame: TrackerFrame) -> str:
        """Why a frame is not located; empty if it is. A jump back in time forgets all targets."""
        if frame.is_skipped:
            # Its stamp may be of another clock.
            return _SKIPPED
        if frame.stamp < self._last_stamp - _JUMP:
            seconds = (self._last_stamp - frame.stamp) / NANOSECONDS
            self._problems.tell("time", f"time went back by {seconds:.3f} s; positions start anew")
            self.time_jumps += 1
            self._last_stamp, self._silent_since = 0, None
            self.forget_positions()
            if self._sensors.transforms:
                self._sensors.transforms.clear()
        if frame.stamp <= self._last_stamp:
            return "the image is not newer than the last one"
        return ""

    def _sense(
        self,
        frame: TrackerFrame,
        parameters: LocalizerParameters,
        probability: Callable[[], NDArray[np.float64] | None],
        *,
        is_last_chance: bool,
    ) -> Sensed:
        """The calibration, the camera's pose and the depth at a frame.

        Raises:
            NotYetError: Something may still arrive, and it is not the last chance.
            ValueError: Something that is needed is missing.
        """
        sensors = self._sensors
        camera = sensors.calibration.model(frame.image_size, rectified=parameters.rectified)
        self._problems.set("camera frame", sensors.calibration.difference(frame.frame_id))
        pose, problem = None, ""
        try:
            pose = self._poses.at(frame.stamp, frame.frame_id, parameters, self._learning.plane)
        except NotYetError as error:
            if not is_last_chance:
                raise
            problem = str(error)
        except ValueError as error:
            problem = str(error)
        if not parameters.camera.height:
            down = pose.plane.down if pose and pose.has_known_tilt else None
            self._learning.add(frame, camera, parameters, down)
            self._problems.set("ground", self._learning.problem)
        if pose is None:
            raise ValueError(problem)
        sensed = Sensed(camera, pose)
        if parameters.method in ("auto", "depth") and sensors.depth.is_used:
            try:
                offset, depth = sensors.depth.find(frame.stamp, parameters.depth_tolerance)
                depth = check_depth(depth, (camera.width, camera.height))
            except NotYetError as error:
                if not is_last_chance:
                    raise
                self._problems.set("depth image", str(error))
            except ValueError as error:
                self._problems.set("depth image", str(error))
            else:
                self._problems.set("depth image", "")
                # Which pixels are the target matters with depth alone.
                sensed = Sensed(camera, pose, depth, offset, probability())
        return sensed


def _silence(frame: TrackerFrame, targets: Sequence[LocatedTarget]) -> str:
    """Why the selected target has no pose; empty if it has."""
    if not frame.selected and frame.targets:
        return "no target is selected; select one on the tracker's topic ~/select"
    if not frame.selected:
        return "the tracker has no target"
    selected = next((one for one in targets if one.reported.id == frame.selected), None)
    return (
        selected.silence if selected else f"target {frame.selected} is not in the tracker's status"
    )
