"""The ROS node `localizer`: the tracker's boxes in, positions in meters out.

Each `~/status` of the tracker is one frame. It waits shortly for the depth and the odometry of its
stamp, and is then located.
"""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from pf_tracker_ros.localization.frame_localizer import FrameLocalizer, Sensors
from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.localization.located_frame import LocatedFrame
from pf_tracker_ros.localization.problems import Problems
from pf_tracker_ros.localization.sensors import NotYetError
from pf_tracker_ros.localization.tracker_frame import TrackerFrame
from pf_tracker_ros.messages import ERROR, OK, STATUS_TYPE, WARN
from pf_tracker_ros.node.graph_monitor import GraphMonitor, surplus_publishers
from pf_tracker_ros.node.health_topic import HealthTopic
from pf_tracker_ros.node.localizer.inputs import Arrivals, Inputs
from pf_tracker_ros.node.localizer.outputs import Outputs
from pf_tracker_ros.node.localizer.tracker_status import read_status
from pf_tracker_ros.node.localizer.transforms import Transforms
from pf_tracker_ros.node.managed_node import ManagedNode
from pf_tracker_ros.node.parameter_binding import ParameterBinding
from pf_tracker_ros.node.parameter_group import ParameterValues
from pf_tracker_ros.node.qos import DEFAULT_QOS, subscribe
from pf_tracker_ros.node.running import run
from pf_tracker_ros.parameters import build
from pf_tracker_ros.topics import StatusValues

_STATUS_TOPIC = "pf_tracker/status"
# Seconds that a frame waits for other inputs, and between two looks at them.
_MAX_WAIT, _WAIT_PERIOD = 0.15, 0.02
_MAX_WAITING = 50
# Seconds without a status of the tracker before a warning.
_STATUS_TIMEOUT = 2.0


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
        self._problems = Problems(log.warning)
        self._binding = ParameterBinding(self)
        self._binding.declare(LocalizerParameters)
        self._binding.listen(apply=self._apply)
        self._settings = build(LocalizerParameters, self._binding.values)
        self._transforms: Transforms | None = None
        self._tf2 = ""
        self._outputs: Outputs | None = None
        self._inputs = Inputs(self, self._problems, self._locate_waiting)
        self._statuses: Subscription | None = None
        self._arrivals = Arrivals()
        self._forget()
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer: Timer = self.create_timer(_WAIT_PERIOD, self._locate_waiting, clock=steady)
        self._timer.cancel()
        self._graph = GraphMonitor(self, self._tell, further=self._surplus_trackers)
        self._health_topic = HealthTopic(self, "localizer", self._health, self._tell)
        if self._settings.autostart:
            self.start()
        else:
            log.info("waiting to be configured and activated, as 'autostart' is false")

    # Transitions

    def configure(self) -> None:
        """Create the publishers, and listen to transforms."""
        if self._binding.refused and not self._settings.autostart:
            raise ValueError("; ".join(self._binding.refused.values()))
        self._tf2 = "not installed"
        if Transforms.are_installed():
            try:
                self._transforms = Transforms(self)
                self._tf2 = "used"
            except ImportError as error:
                self._tf2 = "cannot be loaded"
                self._tell(str(error))
        self._outputs = Outputs(self, self._transforms, self._status_topic, self._tell)

    def activate(self) -> None:
        """Subscribe to the tracker and the sensors."""
        self._forget()
        self._inputs.open(self._settings.depth_transport)
        self._arrivals = Arrivals()
        self._statuses = subscribe(
            self,
            DiagnosticArray,
            _STATUS_TOPIC,
            self._on_status,
            profile=DEFAULT_QOS,
            report=self._tell,
        )
        topics = ", ".join(f"{one.name} on {one.topic}" for one in self._inputs.sensors)
        with_tf2 = "" if self._transforms else ", without tf2_ros"
        self._log.info(f"targets on {self._statuses.topic_name}, {topics}{with_tf2}")

    def deactivate(self) -> None:
        """Unsubscribe."""
        self._timer.cancel()
        self._inputs.close()
        if self._statuses:
            self.destroy_subscription(self._statuses)
            self._statuses = None
        self._problems.clear()

    def clean_up(self) -> None:
        """Remove subscriptions and publishers."""
        self.deactivate()
        for interface in (self._outputs, self._transforms):
            if interface:
                interface.close()
        self._outputs = self._transforms = None
        self._forget()

    def _forget(self) -> None:
        """Forget all targets and waiting frames."""
        inputs = self._inputs
        sensors = Sensors(
            inputs.camera_info.store,
            inputs.depth.store,
            inputs.odometry.store,
            inputs.gravity.store,
            self._transforms,
        )
        self._frames = FrameLocalizer(sensors, self._problems)
        # Each with its arrival, by `time.monotonic`.
        self._waiting: deque[tuple[TrackerFrame, float]] = deque()
        self._last: LocatedFrame | None = None

    def _tell(self, sentence: str) -> None:
        self._problems.tell("node", sentence)

    def _apply(self, changes: ParameterValues) -> None:
        self._settings = build(LocalizerParameters, self._binding.values)
        if "depth_transport" in changes and self._statuses:
            self._inputs.depth.open_transport(self._settings.depth_transport)
        if any(name == "fixed_frame" or name.startswith("camera.") for name in changes):
            self._frames.forget_positions()
        if any(name.startswith(("camera.", "target.", "rectified")) for name in changes):
            self._frames.forget_ground()

    # Frames

    @property
    def _status_topic(self) -> str:
        """Full name of the topic of the tracker's status."""
        return str(self.resolve_topic_name(_STATUS_TOPIC))

    def _on_status(self, message: DiagnosticArray) -> None:
        self._arrivals.add()
        try:
            frame, problem = read_status(message)
            if frame.stamp <= 0:
                raise ValueError(
                    "its images have no stamps, which positions and other sensors need; stamp them"
                )
        except ValueError as error:
            self._problems.set("status", f"the status on {self._status_topic} refused: {error}")
            return
        self._problems.set(
            "status", f"the status on {self._status_topic}: {problem}" if problem else ""
        )
        self._waiting.append((frame, time.monotonic()))
        self._locate_waiting()

    def _locate_waiting(self) -> None:
        """Locate the waiting frames in order, as far as all that they need is there."""
        while self._waiting and self._statuses:
            frame, arrival = self._waiting[0]
            waited = time.monotonic() - arrival
            is_last_chance = waited >= _MAX_WAIT or len(self._waiting) > _MAX_WAITING
            try:
                located = self._locate(frame, waited, is_last_chance=is_last_chance)
            except NotYetError:
                self._timer.reset()
                return
            except Exception as error:
                self._log.error(
                    f"unexpected error, continuing: {traceback.format_exc()[-5000:]}",
                    throttle_duration_sec=5.0,
                )
                reason = f"unexpected {type(error).__name__}: {error}"
                located = self._frames.located(frame, reason, waited)
            self._waiting.popleft()
            self._last = located
            if self._outputs:
                settings = self._settings
                self._outputs.publish(located, settings.fixed_frame)
        self._timer.cancel()

    def _locate(self, frame: TrackerFrame, waited: float, *, is_last_chance: bool) -> LocatedFrame:
        """Locate the targets of a frame.

        Raises:
            NotYetError: Something may still arrive, and it is not the last chance.
        """
        if self._binding.refused:
            return self._frames.located(frame, "; ".join(self._binding.refused.values()), waited)
        return self._frames.locate(
            frame,
            self._settings,
            lambda: self._probability_at(frame.stamp),
            is_last_chance=is_last_chance,
            waited=waited,
        )

    def _probability_at(self, stamp: int) -> NDArray[np.float64] | None:
        self._inputs.probability.open()
        return self._inputs.probability.store.find(stamp)

    # Health

    def _surplus_trackers(self) -> Iterator[tuple[str, int]]:
        """Several publishers of the status, as for `GraphMonitor`: their targets would mix."""
        if self._statuses:
            yield from surplus_publishers(self, self._status_topic, STATUS_TYPE)

    def _health(self) -> tuple[int, str, StatusValues]:
        """Level, sentence and values of `/diagnostics`."""
        last = self._last
        level, message = OK, f"{self.lifecycle_state}, not locating"
        if self._statuses:
            level, message = (last.level, last.message) if last else (OK, "waiting for the tracker")
            silent = self._arrivals.silent_for
            if silent > _STATUS_TIMEOUT:
                level = WARN
                message = f"no status of the tracker on {self._status_topic}"
        if self._binding.refused:
            level, message = ERROR, "; ".join(self._binding.refused.values())
        for fault in self._graph.lasting:
            level, message = max(level, WARN), f"{fault}; {message}"
        values: StatusValues = {
            "lifecycle": self.lifecycle_state,
            "method": self._settings.method,
            "fixed_frame": self._settings.fixed_frame,
            "tf2": self._tf2,
            "time_jumps": self._frames.time_jumps,
            "status_rate": self._arrivals.rate(),
        }
        for one in self._inputs.sensors:
            values[f"{one.name}_rate"] = one.arrivals.rate()
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
