"""The ROS node `localizer`: the tracker's boxes in, positions in meters out.

Each `~/status` of the tracker is one frame. It waits shortly for the depth and the odometry of its
stamp, and is then located.
"""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Sequence
from typing import Any

import cv2
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from std_msgs.msg import Header

from pf_tracker_ros.messages import ERROR, OK, WARN
from pf_tracker_ros.node.graph_monitor import GraphMonitor
from pf_tracker_ros.node.localizer.camera_pose import CameraPoses
from pf_tracker_ros.node.localizer.ground_learning import GroundLearning
from pf_tracker_ros.node.localizer.inputs import (
    Arrivals,
    CameraInfoInput,
    DepthInput,
    GravityInput,
    OdometryInput,
    ProbabilityInput,
)
from pf_tracker_ros.node.localizer.localizer_parameters import LocalizerParameters
from pf_tracker_ros.node.localizer.localizer_status import (
    LocalizerDiagnostics,
    LocalizerStatus,
    Rate,
    StatusPublisher,
)
from pf_tracker_ros.node.localizer.outputs import Outputs
from pf_tracker_ros.node.localizer.problems import Problems
from pf_tracker_ros.node.localizer.tracker_status import TrackerFrame, read_status
from pf_tracker_ros.node.localizer.transforms import NotYetError, Transforms
from pf_tracker_ros.node.localizer.world_tracks import (
    LocatedTarget,
    Sensed,
    WorldTracks,
    distrust,
)
from pf_tracker_ros.node.managed_node import ManagedNode
from pf_tracker_ros.node.parameter_binding import ParameterBinding
from pf_tracker_ros.node.parameter_group import ParameterValues
from pf_tracker_ros.node.parameter_requests import serve_atomic_requests
from pf_tracker_ros.node.qos import DEFAULT_QOS, subscribe
from pf_tracker_ros.node.running import run
from pf_tracker_ros.parameters import build
from pf_tracker_ros.stamps import NANOSECONDS, set_stamp
from pf_tracker_ros.topics import StatusValues

_STATUS_TOPIC = "pf_tracker/status"
# Seconds that a frame waits for other inputs, and between two looks at them.
_MAX_WAIT, _WAIT_PERIOD = 0.15, 0.02
_MAX_WAITING = 50
# Nanoseconds from which an older frame is the first after a jump of the time.
_JUMP = NANOSECONDS
# Seconds without a status of the tracker before a warning.
_STATUS_TIMEOUT = 2.0
_SKIPPED = "the tracker skipped the image"


class LocalizerNode(ManagedNode):
    """Locates the targets of one tracker.

    Configured, it has publishers; active, it subscribes. With an invalid parameter at start-up it
    runs, but locates nothing until the parameter is corrected.

    Args:
        **options: Keyword arguments of `rclpy.node.Node`.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("localizer", **options)
        log = self.get_logger()  # type: ignore[no-untyped-call]
        self._log = log
        self._problems = Problems(log)
        self._binding = ParameterBinding(self)
        self._binding.declare(LocalizerParameters)
        self._binding.listen(apply=self._apply)
        serve_atomic_requests(self, self._binding)
        self._settings = build(LocalizerParameters, self._binding.values)
        self._transforms: Transforms | None = None
        self._outputs: Outputs | None = None
        self._status_publisher: StatusPublisher | None = None
        inputs = self, self._problems, self._locate_waiting
        self._camera_info = CameraInfoInput(*inputs)
        self._depth = DepthInput(*inputs)
        self._odometry = OdometryInput(*inputs)
        self._gravity = GravityInput(*inputs)
        self._probability = ProbabilityInput(*inputs)
        self._statuses: Subscription | None = None
        self._arrivals = Arrivals()
        self._forget()
        self._time_jumps = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer: Timer = self.create_timer(_WAIT_PERIOD, self._locate_waiting, clock=steady)
        self._timer.cancel()
        self._graph = GraphMonitor(self, self._tell)
        self._rates = {one.name: Rate() for one in self._inputs} | {_STATUS_TOPIC: Rate()}
        self._diagnostics = LocalizerDiagnostics(self, self._health, self._tell)
        if self._settings.autostart:
            self.start()
        else:
            log.info("waiting to be configured and activated, as 'autostart' is false")

    # Transitions

    def configure(self) -> None:
        """Create the publishers, and listen to transforms."""
        if self._binding.refused and not self._settings.autostart:
            raise ValueError("; ".join(self._binding.refused.values()))
        if Transforms.are_installed():
            self._transforms = Transforms(self)
        self._outputs = Outputs(self, self._transforms, self._tell)
        self._status_publisher = StatusPublisher(self, self._tell)

    def activate(self) -> None:
        """Subscribe to the tracker and the sensors."""
        self._forget()
        self._camera_poses = CameraPoses(self._odometry, self._gravity, self._transforms)
        self._camera_info.open()
        self._depth.open(self._settings.depth_transport)
        self._odometry.open()
        self._gravity.open()
        self._arrivals = Arrivals()
        self._statuses = subscribe(
            self,
            DiagnosticArray,
            _STATUS_TOPIC,
            self._on_status,
            profile=DEFAULT_QOS,
            report=self._tell,
        )
        topics = ", ".join(f"{one.name} on {one.topic}" for one in self._inputs)
        with_tf2 = "" if self._transforms else ", without tf2_ros"
        self._log.info(f"targets on {self._statuses.topic_name}, {topics}{with_tf2}")

    def deactivate(self) -> None:
        """Unsubscribe."""
        self._timer.cancel()
        for one in (*self._inputs, self._probability):
            one.close()
        if self._statuses:
            self.destroy_subscription(self._statuses)
            self._statuses = None
        self._problems.clear()

    def clean_up(self) -> None:
        """Remove subscriptions and publishers."""
        self.deactivate()
        for interface in (self._outputs, self._status_publisher, self._transforms):
            if interface:
                interface.close()
        self._outputs = self._status_publisher = self._transforms = None
        self._forget()

    def _forget(self) -> None:
        """Forget all targets and waiting frames."""
        self._tracks = WorldTracks()
        self._learning = GroundLearning()
        # Each with its arrival, by `time.monotonic`.
        self._waiting: deque[tuple[TrackerFrame, float]] = deque()
        self._last_stamp = 0
        self._silent_since: int | None = None
        self._last_status: LocalizerStatus | None = None

    @property
    def _inputs(self) -> tuple[CameraInfoInput, DepthInput, OdometryInput, GravityInput]:
        return self._camera_info, self._depth, self._odometry, self._gravity

    def _tell(self, sentence: str) -> None:
        self._problems.tell("node", sentence)

    def _apply(self, changes: ParameterValues) -> None:
        self._settings = build(LocalizerParameters, self._binding.values)
        if "depth_transport" in changes and self._statuses:
            self._depth.open(self._settings.depth_transport)
        if any(name == "fixed_frame" or name.startswith("camera.") for name in changes):
            self._tracks.clear()
        if any(name.startswith(("camera.", "target.", "rectified")) for name in changes):
            self._learning = GroundLearning()

    # Frames

    def _on_status(self, message: DiagnosticArray) -> None:
        self._arrivals.add()
        try:
            frame = read_status(message)
            if frame.stamp <= 0:
                raise ValueError(
                    "the images have no stamps, which positions and other sensors need; stamp them"
                )
        except ValueError as error:
            self._problems.set("status", str(error))
            return
        self._problems.set("status", "")
        self._waiting.append((frame, time.monotonic()))
        self._locate_waiting()

    def _locate_waiting(self) -> None:
        """Locate the waiting frames in order, as far as all that they need is there."""
        while self._waiting and self._statuses:
            frame, arrival = self._waiting[0]
            waited = time.monotonic() - arrival
            is_last_chance = waited >= _MAX_WAIT or len(self._waiting) > _MAX_WAITING
            try:
                status = self._locate(frame, waited, is_last_chance=is_last_chance)
            except NotYetError:
                self._timer.reset()
                return
            except Exception as error:
                self._log.error(
                    f"unexpected error, continuing: {traceback.format_exc()[-5000:]}",
                    throttle_duration_sec=5.0,
                )
                reason = f"unexpected {type(error).__name__}: {error}"
                status = self._status(frame, reason, waited)
            self._last_stamp = frame.stamp
            self._waiting.popleft()
            self._last_status = status
            if self._status_publisher:
                header = Header(frame_id=frame.frame_id)
                set_stamp(header, frame.stamp)
                self._status_publisher.publish(header, status)
        self._timer.cancel()

    def _locate(
        self, frame: TrackerFrame, waited: float, *, is_last_chance: bool
    ) -> LocalizerStatus:
        """Locate the targets of a frame, and publish them.

        Raises:
            NotYetError: Something may still arrive, and it is not the last chance.
        """
        sensed: Sensed | None = None
        targets: tuple[LocatedTarget, ...] = ()
        silence = self._skip_reason(frame)
        if not silence:
            try:
                sensed = self._sense(frame, is_last_chance=is_last_chance)
                targets = self._tracks.advance(frame, sensed, self._settings)
            except NotYetError:
                raise
            except ValueError as error:
                silence = str(error)
            self._problems.set("frame", silence)
        if sensed and not silence:
            silence = self._publish(frame, targets)
            if silence and frame.selected:
                self._problems.tell("pose", f"no pose: {silence}")
        return self._status(frame, silence, waited, sensed, targets)

    def _status(
        self,
        frame: TrackerFrame,
        silence: str,
        waited: float,
        sensed: Sensed | None = None,
        targets: Sequence[LocatedTarget] = (),
    ) -> LocalizerStatus:
        """The status of a frame, and whether there is a pose from now on."""
        if not silence:
            self._silent_since = None
        elif self._silent_since is None:
            self._silent_since = frame.stamp
        return LocalizerStatus(
            selected=frame.selected,
            silence=silence,
            silent_since=self._silent_since or 0,
            stamp=frame.stamp,
            problems=self._problems.sentences,
            camera=sensed.pose if sensed else None,
            learned_boxes=self._learning.boxes,
            depth_offset=sensed.depth_offset if sensed else None,
            targets=targets,
            waited=waited,
        )

    def _skip_reason(self, frame: TrackerFrame) -> str:
        """Why a frame is not located; empty if it is. A jump back in time forgets all targets."""
        if self._binding.refused:
            return "; ".join(self._binding.refused.values())
        if frame.stamp < self._last_stamp - _JUMP:
            seconds = (self._last_stamp - frame.stamp) / NANOSECONDS
            self._problems.tell("time", f"time went back by {seconds:.3f} s; positions start anew")
            self._time_jumps += 1
            self._last_stamp, self._silent_since = 0, None
            self._tracks.clear()
            if self._transforms:
                self._transforms.clear()
        if frame.is_skipped:
            return _SKIPPED
        if frame.stamp <= self._last_stamp:
            return "the image is not newer than the last one"
        return ""

    def _sense(self, frame: TrackerFrame, *, is_last_chance: bool) -> Sensed:
        """The calibration, the camera's pose and the depth at a frame.

        Raises:
            NotYetError: Something may still arrive, and it is not the last chance.
            ValueError: Something that is needed is missing.
        """
        parameters = self._settings
        camera = self._camera_info.model(frame.image_size, rectified=parameters.rectified)
        if not parameters.camera.height:
            self._learning.add(frame, camera, parameters)
            self._problems.set("ground", self._learning.problem)
        try:
            pose = self._camera_poses.at(
                frame.stamp, frame.frame_id, parameters, self._learning.plane
            )
        except NotYetError as error:
            if not is_last_chance:
                raise
            raise ValueError(str(error)) from None
        sensed = Sensed(camera, pose)
        if parameters.method in ("auto", "depth") and self._depth.is_used:
            try:
                offset, depth = self._depth.find(frame.stamp, parameters.depth_tolerance)
            except NotYetError as error:
                if not is_last_chance:
                    raise
                self._problems.set("depth image", str(error))
            except ValueError as error:
                self._problems.set("depth image", str(error))
            else:
                self._problems.set("depth image", "")
                # Which pixels are the target matters with depth alone.
                self._probability.open()
                probability = self._probability.find(frame.stamp)
                sensed = Sensed(camera, pose, depth, offset, probability)
        return sensed

    def _publish(self, frame: TrackerFrame, targets: Sequence[LocatedTarget]) -> str:
        """Publish the targets; why the selected one has no pose, empty if it has."""
        if self._outputs is None:
            return f"{self.lifecycle_state}, not locating"
        header = Header(frame_id=self._settings.fixed_frame)
        set_stamp(header, frame.stamp)
        selected = next((one for one in targets if one.reported.id == frame.selected), None)
        silence = self._silence(frame, selected)
        if selected:
            if not silence and selected.world:
                self._outputs.publish_selected(header, selected.world)
            is_trusted = not distrust(selected.reported, self._settings.min_confidence)
            if is_trusted and selected.bearing:
                image_header = Header(stamp=header.stamp, frame_id=frame.frame_id)
                self._outputs.publish_bearing(image_header, selected.bearing)
        located = [one.world for one in targets if one.world]
        self._outputs.publish_all(header, located, frame.selected)
        return silence

    def _silence(self, frame: TrackerFrame, selected: LocatedTarget | None) -> str:
        """Why the selected target has no pose; empty if it has."""
        if not frame.selected:
            return "no target is selected" if frame.targets else "the tracker has no target"
        if selected is None:
            return f"target {frame.selected} has ended"
        return selected.silence

    # Health

    def _health(self) -> tuple[int, str, StatusValues]:
        """Level, sentence and values of `/diagnostics`."""
        last = self._last_status
        level, message = OK, f"{self.lifecycle_state}, not locating"
        if self._statuses:
            level, message = (last.level, last.message) if last else (OK, "waiting for the tracker")
            silent = self._arrivals.silent_for
            if silent > _STATUS_TIMEOUT:
                level = WARN
                message = f"no status of the tracker on {self._statuses.topic_name}"
        if self._binding.refused:
            level, message = ERROR, "; ".join(self._binding.refused.values())
        for fault in self._graph.lasting:
            level, message = max(level, WARN), f"{fault}; {message}"
        values: StatusValues = {
            "lifecycle": self.lifecycle_state,
            "method": self._settings.method,
            "fixed_frame": self._settings.fixed_frame,
            "tf2": "used" if self._transforms else "not installed",
            "time_jumps": self._time_jumps,
            "status_rate": self._rates[_STATUS_TOPIC].update(self._arrivals.count),
        }
        for one in self._inputs:
            values[f"{one.name}_rate"] = self._rates[one.name].update(one.arrivals.count)
            if one.arrivals.count:
                values[f"seconds_since_{one.name}"] = one.arrivals.silent_for
        return level, message, values | (last.values if last else {})


def main(arguments: list[str] | None = None) -> None:
    """Run the localizer until SIGINT or SIGTERM.

    Args:
        arguments: The command line with the program's name, by default that of the process.
    """
    # The tracker keeps the other cores.
    cv2.setNumThreads(1)
    run(LocalizerNode, arguments)


if __name__ == "__main__":
    main()
