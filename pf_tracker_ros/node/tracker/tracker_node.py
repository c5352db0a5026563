"""The ROS node `pf_tracker`: images and targets in, boxes and what the tracker knows out."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any, TypeVar

import cv2
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.decoding.decoder import ImageDecoder
from pf_tracker_ros.node.graph_watch import GraphWatch
from pf_tracker_ros.node.managed_node import ManagedNode
from pf_tracker_ros.node.message_building import TargetError
from pf_tracker_ros.node.override_sources import files_superseded_by
from pf_tracker_ros.node.parameter_binding import ParameterBinding
from pf_tracker_ros.node.parameter_group import Values
from pf_tracker_ros.node.parameter_requests import take_whole_requests
from pf_tracker_ros.node.qos import given_overrides, is_overridden
from pf_tracker_ros.node.real_time import RealTimePriority
from pf_tracker_ros.node.running import run
from pf_tracker_ros.node.tracker.diagnostics import Diagnostics, Health
from pf_tracker_ros.node.tracker.following import Followed, Following
from pf_tracker_ros.node.tracker.image_input import RELIABILITY_CURE, ImageInput
from pf_tracker_ros.node.tracker.one_target import OneTarget
from pf_tracker_ros.node.tracker.reporter import LOG_INTERVAL, Reporter
from pf_tracker_ros.node.tracker.services import Services
from pf_tracker_ros.node.tracker.skipped_frames import SKIPPED, SkippedFrames
from pf_tracker_ros.node.tracker.status import PAUSED, Status, StatusOutput, stamp_text
from pf_tracker_ros.node.tracker.target_input import TargetInput
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.stamps import stamp_of

Outcome = TypeVar("Outcome")


class TrackerNode(ManagedNode):
    """Tracks one target, or several, through the images of one topic.

    Configured, it has a tracker, publishers and services; active, it subscribes. Every image is
    answered by one status with its header, whatever became of it. A wrong parameter at start-up
    keeps the node from tracking until it is set rightly; it stays up.

    Args:
        command_line: Of the process; it tells in which order parameters were given, which those
            that reach the node do not.
        has_process: Whether the process is the node's alone, so that it may set its priority.
        **options: Of `rclpy.node.Node`.
    """

    def __init__(
        self, command_line: Sequence[str] = (), *, has_process: bool = False, **options: Any
    ) -> None:
        super().__init__("pf_tracker", **options)
        self._log = self.get_logger()  # type: ignore[no-untyped-call]
        self._reporter = Reporter(self._log)
        self._skipped = SkippedFrames(self._log)
        self._obstacle = ""
        self._enabled = True
        self._has_target = False
        self._status: StatusOutput | None = None
        self._offered: Services | None = None
        self._targets: TargetInput | None = None
        self._unused_overrides: set[str] = set()

        self._binding = ParameterBinding(self, report=self._reporter.report)
        self._binding.declare(NodeParameters)
        self._following, self._missing = self._chosen_following()
        self._binding.declare(
            self._following.tunables,
            usual=lambda values: self._following.usual(values["preset"]),
            renewed_by="preset",
            kept=self._following.kept,
            superseded=files_superseded_by(
                "preset",
                self.get_fully_qualified_name(),
                [*command_line, *(options.get("cli_args") or ())],
            ),
            # The session can change what the library alone fixes while it tracks.
            keeps_read_only=False,
        )
        self._binding.listen(check=self._check, apply=self._apply)
        take_whole_requests(self, self._binding)
        self._real_time: RealTimePriority | None = None
        if has_process:
            self._real_time = RealTimePriority(self._reporter.report)
            self._real_time.ask(self._values["realtime_priority"])
        self._preset = self._following.preset(self._values)
        self._decoder = ImageDecoder(self._values["largest_image"])
        self._images = ImageInput(self, self._on_image, self._reporter.report)
        self._diagnostics = Diagnostics(
            self, self._health, lambda: self._values["stale_after"], self._reporter.report
        )
        self._errors_in_health = 0
        self._graph = GraphWatch(self, self._reporter.report, self._cure)
        if self._values["autostart"]:
            self.start()
        else:
            self._log.info("waiting to be configured and activated, because autostart is false")

    @property
    def _values(self) -> Values:
        return self._binding.values

    # Transitions

    def configure(self) -> None:
        """Take a tracker, the publishers and the services."""
        self._make_session()
        if self._obstacle and not self._values["autostart"]:
            raise ValueError(self._obstacle)
        report = self._reporter.report
        self._status = StatusOutput(self, report)
        self._following.advertise(self, report)
        self._offered = Services(self, self._stop, self._enable)

    def activate(self) -> None:
        """Subscribe to targets and images."""
        # The executor serves what waits in this order: room is made before a target comes, and that
        # before the image it came with.
        self._following.subscribe(self, self._reporter.report)
        self._targets = TargetInput(
            self, self._request, lambda: self._values["click_size"], self._reporter.report
        )
        self._subscribe()
        self._diagnostics.restart()
        self._skipped.forget()
        self._report_unused_overrides()
        name = self.get_fully_qualified_name()
        topics = f"images on {self._images.topic}, targets on {name}/target"
        if self._obstacle:
            self._log.warning(f"not tracking until what is wrong is set rightly; {topics}")
        else:
            self._log.info(f"preset {self._preset.described}; {topics}")

    def deactivate(self) -> None:
        """Give the subscriptions up; the target is kept."""
        self._images.close()
        self._following.unsubscribe()
        if self._targets:
            self._targets.close()
            self._targets = None

    def clean_up(self) -> None:
        """Give all that was taken back."""
        self.deactivate()
        for taken in (self._offered, self._status):
            if taken:
                taken.close()
        self._offered = self._status = None
        self._following.close()
        self._following.forget()
        self._obstacle = ""
        self._enabled = True

    def _subscribe(self) -> None:
        self._images.open(self._values["image_transport"], self._values["image_reliability"])

    def _report_unused_overrides(self) -> None:
        unused = {name for name in given_overrides(self) if not self.has_parameter(name)}
        for name in sorted(unused - self._unused_overrides):
            self._reporter.report(
                f"'{name}' has no effect: there is no such topic of this node, or no such policy"
            )
        self._unused_overrides |= unused

    # Parameters

    def _check(self, values: Values) -> None:
        if (values["max_targets"] > 1) != (self._values["max_targets"] > 1):
            raise ValueError(
                "parameter 'max_targets' decides at start-up whether there is one target or "
                "several; start the node again with it"
            )
        if self._following.is_ready or not (self._obstacle or self._binding.refused):
            self._following.check(values)

    def _apply(self, changes: Values) -> None:
        self._preset = self._following.preset(self._values)
        if "preset" in changes:
            self._log.info(f"preset {self._preset.described}")
        if self._real_time and "realtime_priority" in changes:
            self._real_time.ask(self._values["realtime_priority"])
        self._decoder.largest = self._values["largest_image"]
        if self._images.topic and changes.keys() & {"image_reliability", "image_transport"}:
            self._subscribe()
        if not self._following.is_ready:
            if self._status:
                self._make_session()
            return
        self._following.configure(self._values)
        if "target_box" in changes:
            self._request_target_box()

    def _make_session(self) -> None:
        """Make the session, unless a parameter is in the way."""
        self._obstacle = self._missing or "; ".join(self._binding.refused.values())
        if self._obstacle:
            return
        try:
            self._following.configure(self._values)
        except ValueError as error:
            self._obstacle = str(error)
            self._reporter.report(self._obstacle)
            return
        self._request_target_box()

    def _chosen_following(self) -> tuple[Following, str]:
        """What is followed, and what is missing for it."""
        if self._values["max_targets"] == 1:
            return OneTarget(self._log), ""
        try:
            # Only here, because a single target needs no SciPy.
            from pf_tracker_ros.node.tracker.several_targets import SeveralTargets
        except ModuleNotFoundError as error:
            if error.name != "scipy":
                raise
            self._reporter.report(str(error))
            return OneTarget(self._log), str(error)
        return SeveralTargets(self._log), ""

    def _request_target_box(self) -> None:
        box = self._values["target_box"]
        if not box:
            self._following.withdraw()
            return
        try:
            self._following.request(box, 0)
        except ValueError as error:
            self._reporter.report(f"target refused: {error}")

    # Targets

    def _request(self, box: Box, stamp: int) -> None:
        if not self._following.is_ready:
            raise TargetError(f"target refused: not tracking, because {self._obstacle}")
        try:
            self._following.request(box, stamp)
        except ValueError as error:
            raise TargetError(f"target refused: {error}") from error

    def _stop(self) -> str:
        self._has_target = False
        return self._told(self._following.stop())

    def _enable(self, enabled: bool) -> str:
        self._enabled = enabled
        return self._told("tracking goes on" if enabled else "paused; images are not looked at")

    def _told(self, outcome: str) -> str:
        """What came of a service call, which whoever reads the log wants to know as well."""
        self._log.info(outcome)
        return outcome

    # Images

    def _on_image(self, message: Image | CompressedImage) -> None:
        began = time.perf_counter()
        self._following.begin_frame()
        if self._targets and self._values["max_targets"] > 1:
            self._targets.take_waiting()
        followed = self._try(partial(self._process, message))
        if followed is None:
            if not self.context.ok():
                return
            followed = Followed("refused")
        elapsed = time.perf_counter() - began
        frame, stamp = followed.frame, stamp_of(message.header)
        if frame in SKIPPED:
            self._skipped.skip(frame, self._why_skipped(frame, stamp))
        else:
            self._skipped.look_at(stamp)
        if self._status:
            status = self._current_status(frame)
            self._status.publish(message.header, status, self._reporter, elapsed)
            self._has_target = status.last_state != "idle"
        self._try(followed.show)
        self._diagnostics.count(frame, stamp, time.perf_counter() - began)

    def _try(self, step: Callable[[], Outcome]) -> Outcome | None:
        """What a step gives; None where it fails, which is told, or the context is gone."""
        try:
            return step()
        except Exception as error:
            if self.context.ok():
                self._reporter.report_failure(error)
            return None

    def _process(self, message: Image | CompressedImage) -> Followed:
        if not self._enabled:
            self._following.pass_over(stamp_of(message.header))
            return Followed("paused")
        read = cache(partial(self._decoder.decode, message))
        followed = self._following.process(read, message.header)
        for error in followed.errors:
            self._reporter.report(error)
        if followed.jumped_back:
            self._diagnostics.jumps += 1
            self._tell_of_jump(followed)
        return followed

    def _tell_of_jump(self, followed: Followed) -> None:
        """Log that time went back: whoever lost no target by it needs no advice."""
        said = f"time went back by {followed.jumped_back:.3f} s"
        if followed.frame == "started" or not self._has_target:
            self._log.info(said, throttle_duration_sec=LOG_INTERVAL)
            return
        choice = self._values["time_jump"]
        cure = "; 'restart' is for recordings that begin again" if choice == "keep" else ""
        self._log.warning(
            f"{said}; 'time_jump' is '{choice}'{cure}", throttle_duration_sec=LOG_INTERVAL
        )

    # What the node tells of itself

    def _cure(self, topic: str, policy: str) -> str:
        """What to do about a publisher of images that offers too little."""
        is_of_images = topic == self._images.topic and policy == "reliability"
        is_free = is_of_images and not is_overridden(self, topic, "subscription", policy)
        return RELIABILITY_CURE if is_free else ""

    def _why_skipped(self, frame: str, stamp: int) -> str:
        """Why a frame is not looked at, and what to do."""
        if frame == "refused":
            return self._reporter.last_error
        if frame == "paused":
            return PAUSED
        topic = self._images.topic
        if frame == "duplicate":
            return (
                f"the stamp {stamp_text(stamp)} s is that of the frame before, and a frame is "
                f"tracked once: let whoever publishes {topic} stamp each image with the time at "
                "which it was taken, or none of them (0)"
            )
        return (
            f"the stamp {stamp_text(stamp)} s is before that of the last frame: let one camera "
            f"alone publish {topic}, with one clock, or lower 'time_jump_threshold' for a "
            "recording that begins again"
        )

    def _current_status(self, frame: str) -> Status:
        return Status(
            frame=frame,
            known=self._following.known,
            skipped=self._skipped.last,
            obstacle=self._obstacle,
            enabled=self._enabled,
            preset=self._preset.summary,
            lost_share=self._diagnostics.lost_share,
        )

    def _health(self) -> Health:
        status = self._current_status("")
        level, message = status.level, status.description
        active = bool(self._images.topic)
        if not active:
            level, message = DiagnosticStatus.OK, f"{self.lifecycle_state}, not tracking"
            if self._binding.refused:
                level = DiagnosticStatus.ERROR
                message += f": {'; '.join(self._binding.refused.values())}"
        for fault in self._graph.lasting:
            level, message = max(level, DiagnosticStatus.WARN), f"{fault}; {message}"
        errors = self._reporter.count - self._errors_in_health
        self._errors_in_health = self._reporter.count
        if errors and level == DiagnosticStatus.OK:
            level, message = DiagnosticStatus.WARN, self._reporter.last_error
        values: dict[str, str | float | int] = {
            f"refused_{cause}": count for cause, count in self._reporter.failures.items()
        }
        values |= {
            "lifecycle": self.lifecycle_state,
            "image_topic": self._images.topic,
            "image_reliability": self._images.reliability,
            "preset": status.preset,
            "realtime_priority": self._real_time.in_force if self._real_time else 0,
        }
        values |= status.values
        values |= self._reporter.values()
        return Health(
            level,
            message,
            expects_images=active and self._enabled,
            image_topic=self._images.topic,
            image_reliability=self._images.reliability,
            is_compressed=self._values["image_transport"] == "compressed",
            values=values,
        )


def main(arguments: list[str] | None = None) -> None:
    """Run the tracker node until it is told to stop.

    Args:
        arguments: The command line with the program's name, by default that of the process.
    """
    # The tracker looks at small regions: more threads make it no faster and keep other cores busy.
    cv2.setNumThreads(1)
    command_line = sys.argv if arguments is None else arguments
    run(partial(TrackerNode, command_line, has_process=True), arguments)


if __name__ == "__main__":
    main()
