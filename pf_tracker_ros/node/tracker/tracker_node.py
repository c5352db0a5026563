"""The ROS node `pf_tracker`: images and targets in, boxes and what the tracker knows out."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, TypeVar

import cv2
from numpy.typing import NDArray
from sensor_msgs.msg import CompressedImage, Image

from pf_tracker_ros.decoding.decoder import ImageDecoder
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.messages import ERROR, OK, WARN
from pf_tracker_ros.node.graph_monitor import GraphMonitor
from pf_tracker_ros.node.managed_node import ManagedNode
from pf_tracker_ros.node.override_sources import parameters_superseded_by
from pf_tracker_ros.node.parameter_binding import ParameterBinding
from pf_tracker_ros.node.parameter_group import Values
from pf_tracker_ros.node.parameter_requests import serve_atomic_requests
from pf_tracker_ros.node.qos import given_overrides, is_overridden
from pf_tracker_ros.node.real_time import RealTimePriority
from pf_tracker_ros.node.running import run
from pf_tracker_ros.node.tracker.diagnostics import Diagnostics, Health
from pf_tracker_ros.node.tracker.image_subscription import RELIABILITY_CURE, ImageSubscription
from pf_tracker_ros.node.tracker.publishers import FramePublishers
from pf_tracker_ros.node.tracker.reporter import LOG_INTERVAL, Reporter, Throttle
from pf_tracker_ros.node.tracker.services import Services
from pf_tracker_ros.node.tracker.session_manager import SessionManager
from pf_tracker_ros.node.tracker.status import (
    PAUSED,
    SKIPPED,
    NodeStatus,
    SkippedFrames,
    StateLog,
    StatusOutput,
    TargetsLog,
    format_stamp,
)
from pf_tracker_ros.node.tracker.target_subscriptions import (
    DETECTIONS_CLASS,
    DETECTIONS_TOPIC,
    VISION_MSGS_MISSING,
    TargetSubscriptions,
)
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.stamps import stamp_of
from pf_tracker_ros.targets.session import DROPPED_ARRIVALS, Outcome, Session
from pf_tracker_ros.topics import FrameResult
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import ActivePreset, preset_parameters

Given = TypeVar("Given")


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
        self._tracking = SessionManager()
        self._result = FrameResult()
        self._states, self._listed = StateLog(self._log), TargetsLog(self._log)
        self._throttle = Throttle()
        self._status: StatusOutput | None = None
        self._outputs: FramePublishers | None = None
        self._offered: Services | None = None
        self._inputs: TargetSubscriptions | None = None
        self._unused_overrides: set[str] = set()

        self._binding = ParameterBinding(self, report=self._reporter.report)
        self._binding.declare(NodeParameters)
        self._binding.declare(
            TrackerParameters,
            defaults=lambda values: preset_parameters(values["preset"], values["max_targets"]),
            reset_by={
                "preset": lambda before, after: True,
                "max_targets": lambda before, after: (before > 1) != (after > 1),
            },
            # They tell of the detector that there is, and not of how it is made use of.
            kept=[name for name in declarations(TrackerParameters) if name.startswith("detector.")],
            superseded=parameters_superseded_by(
                "preset",
                self.get_fully_qualified_name(),
                [*command_line, *(options.get("cli_args") or ())],
            ),
            # The session learns the targets again, where that is needed.
            keeps_read_only=False,
        )
        self._binding.listen(check=self._check, apply=self._apply)
        serve_atomic_requests(self, self._binding)
        self._real_time: RealTimePriority | None = None
        if has_process:
            self._real_time = RealTimePriority(self._reporter.report)
            self._real_time.request_priority(self._values["realtime_priority"])
        self._take_preset()
        self._decoder = ImageDecoder(self._values["max_image_pixels"])
        self._images = ImageSubscription(self, self._on_image, self._reporter.report)
        self._diagnostics = Diagnostics(
            self, self._health, lambda: self._values["image_timeout"], self._reporter.report
        )
        self._errors_in_health = 0
        self._graph = GraphMonitor(self, self._reporter.report, self._cure)
        if self._values["autostart"]:
            self.start()
        else:
            self._log.info("waiting to be configured and activated, because autostart is false")

    @property
    def _values(self) -> Values:
        return self._binding.values

    def _take_preset(self) -> None:
        """Compare the values in force with their preset."""
        self._preset = ActivePreset.of(self._values)
        self._summary = self._preset.summary

    # Transitions

    def configure(self) -> None:
        """Take a tracker, the publishers and the services."""
        self._make_session()
        if self._obstacle and not self._values["autostart"]:
            raise ValueError(self._obstacle)
        report = self._reporter.report
        self._status = StatusOutput(self, report)
        self._outputs = FramePublishers(self, report)
        self._offered = Services(self, self._stop, self._enable)

    def activate(self) -> None:
        """Subscribe to what is said of targets, and to images."""
        # Before the images: the executor serves what waits in the order of subscriptions.
        self._inputs = TargetSubscriptions(
            self, self._session, lambda: self._values["click_size"], self._reporter.report
        )
        self._subscribe()
        self._diagnostics.restart()
        self._skipped.forget()
        self._report_unused_overrides()
        name = self.get_fully_qualified_name()
        topics = f"images on {self._images.topic}, targets on {name}/target"
        if DETECTIONS_CLASS:
            topics += f", detections on {self.resolve_topic_name(DETECTIONS_TOPIC)}"
        elif _has_several(self._values) and self._values["built_in_detector"] == "none":
            self._log.warning(VISION_MSGS_MISSING)
        if self._obstacle:
            self._log.warning(f"not tracking until what is wrong is set rightly; {topics}")
        else:
            self._log.info(f"preset {self._preset.description}; {topics}")

    def deactivate(self) -> None:
        """Give the subscriptions up; the targets are kept."""
        self._images.close()
        if self._inputs:
            self._inputs.close()
            self._inputs = None

    def clean_up(self) -> None:
        """Give all that was taken back."""
        self.deactivate()
        for taken in (self._offered, self._status, self._outputs):
            if taken:
                taken.close()
        self._offered = self._status = self._outputs = None
        self._tracking.forget()
        self._result = FrameResult()
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
        if self._tracking.session or not (self._obstacle or self._binding.refused):
            self._tracking.check(values)

    def _apply(self, changes: Values) -> None:
        self._take_preset()
        if changes.keys() & {"preset", "max_targets"}:
            self._log.info(f"preset {self._preset.description}")
        if self._real_time and "realtime_priority" in changes:
            self._real_time.request_priority(self._values["realtime_priority"])
        self._decoder.max_pixels = self._values["max_image_pixels"]
        if self._images.topic and changes.keys() & {"image_reliability", "image_transport"}:
            self._subscribe()
        if self._tracking.session is None:
            if self._status:
                self._make_session()
            return
        self._tracking.configure(self._values)
        if "target_box" in changes:
            self._request_target_box()

    def _make_session(self) -> None:
        """Make the session, unless a parameter is in the way."""
        self._obstacle = "; ".join(self._binding.refused.values())
        if self._obstacle:
            return
        try:
            self._tracking.configure(self._values)
        except ValueError as error:
            self._obstacle = str(error)
            self._reporter.report(self._obstacle)
            return
        self._request_target_box()

    def _session(self) -> Session:
        """The session.

        Raises:
            ValueError: There is none, for the reason that it gives.
        """
        if self._tracking.session is None:
            raise ValueError(f"not tracking, because {self._obstacle}")
        return self._tracking.session

    def _request_target_box(self) -> None:
        box, session = self._values["target_box"], self._session()
        if not box:
            session.cancel_requests()
            return
        try:
            session.request(box)
        except ValueError as error:
            self._reporter.report(f"target refused: {error}")

    # Services

    def _stop(self) -> str:
        self._has_target = False
        outcome = self._tracking.stop()
        self._result = self._known()
        self._listed.update(())
        return self._told(outcome)

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
        if self._inputs:
            self._inputs.take_pending()
        result = self._try(partial(self._process, message))
        if result is None:
            if not self.context.ok():
                return
            result = _Result("refused")
        elapsed = time.perf_counter() - began
        frame, stamp = result.frame, stamp_of(message.header)
        if frame in SKIPPED:
            self._skipped.skip(frame, self._why_skipped(frame, stamp))
        else:
            self._skipped.mark_processed(stamp)
        if self._status:
            status = self._current_status(frame)
            self._status.publish(message.header, status, self._reporter, elapsed)
            self._has_target = status.last_state != "idle"
        if self._outputs and result.known and frame not in SKIPPED:
            self._try(partial(self._outputs.publish_visualizations, message.header, result.known))
        # What was only of this frame.
        self._result = replace(self._result, image=None, likelihood=None)
        self._diagnostics.count(frame, stamp, time.perf_counter() - began)

    def _try(self, step: Callable[[], Given]) -> Given | None:
        """What a step gives; None where it fails, which is told, or the context is gone."""
        try:
            return step()
        except Exception as error:
            if self.context.ok():
                self._reporter.report_failure(error)
            return None

    def _process(self, message: Image | CompressedImage) -> _Result:
        """Track into a frame, and publish what others act on.

        Raises:
            ValueError: The image cannot be used.
        """
        stamp = stamp_of(message.header)
        if not self._enabled:
            self._tracking.skip(stamp)
            return _Result("paused")
        session = self._tracking.session
        if session is None:
            self._decoder.decode(message)
            return _Result("waiting")
        for error in self._throttle.unrepeated(self._tracking.take_detections()):
            self._reporter.report(error)
        arrival = session.classify(stamp)
        if arrival in DROPPED_ARRIVALS:
            return _Result(session.drop(arrival).frame)
        frame = Frame(self._decoder.decode(message), stamp)
        outcome = session.process(frame, arrival)
        self._tracking.offer(frame.image, stamp, jumped_back=bool(outcome.jumped_back))
        result = self._known(frame.image)
        for error in (
            *outcome.refused,
            *outcome.ended,
            *self._throttle.unrepeated(outcome.rejected_detections),
        ):
            self._reporter.report(error)
        self._log_progress(outcome)
        # A duplicate that a target could have started on says nothing new.
        if self._outputs and outcome.frame not in SKIPPED:
            self._outputs.publish(message.header, result)
            if self._outputs.has_subscribers("likelihood"):
                result = replace(result, likelihood=session.map_likelihood())
                self._outputs.publish(message.header, result, ("likelihood",))
        self._result = result
        return _Result(outcome.frame, result)

    def _known(self, image: NDArray[Any] | None = None) -> FrameResult:
        """What is known after a frame that was looked at, of which there may be the image."""
        session = self._tracking.session
        if session is None:
            return FrameResult()
        targets = session.targets
        return FrameResult(
            targets=targets,
            selected=session.selected,
            max_targets=max(self._values["max_targets"], len(targets)),
            detector_runs=session.detector_runs,
            image=image,
        )

    def _log_progress(self, outcome: Outcome) -> None:
        """Log which targets there are, and how the selected one is."""
        if outcome.jumped_back:
            self._diagnostics.time_jumps += 1
            self._tell_of_jump(outcome)
        for target in outcome.targets:
            if target.id in outcome.started:
                box = ", ".join(f"{value:g}" for value in target.estimate.box)
                self._log.info(f"tracking target {target.id} from the box ({box}) on")
        self._listed.update(outcome.targets)
        if outcome.estimate:
            self._states.update(outcome.selected, outcome.estimate)

    def _tell_of_jump(self, outcome: Outcome) -> None:
        """Log that time went back: whoever lost no target by it needs no advice."""
        said = f"time went back by {outcome.jumped_back:.3f} s"
        if outcome.frame == "started" or not self._has_target:
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
                f"the stamp {format_stamp(stamp)} s is that of the frame before, and a frame is "
                f"tracked once: let whoever publishes {topic} stamp each image with the time at "
                "which it was taken, or none of them (0)"
            )
        return (
            f"the stamp {format_stamp(stamp)} s is before that of the last frame: let one camera "
            f"alone publish {topic}, with one clock, or lower 'time_jump_threshold' for a "
            "recording that begins again"
        )

    def _current_status(self, frame: str) -> NodeStatus:
        session = self._tracking.session
        return NodeStatus(
            frame=frame,
            result=self._result,
            requested_stamp=session.requested_stamp if session else None,
            skipped=self._skipped.last,
            configuration_error=self._obstacle,
            enabled=self._enabled,
            preset=self._summary,
            frame_loss_rate=self._diagnostics.frame_loss_rate,
        )

    def _health(self) -> Health:
        status = self._current_status("")
        level, message = status.level, status.description
        active = bool(self._images.topic)
        if not active:
            level, message = OK, f"{self.lifecycle_state}, not tracking"
            if self._binding.refused:
                level = ERROR
                message += f": {'; '.join(self._binding.refused.values())}"
        for fault in self._graph.lasting:
            level, message = max(level, WARN), f"{fault}; {message}"
        errors = self._reporter.count - self._errors_in_health
        self._errors_in_health = self._reporter.count
        if errors and level == OK:
            level, message = WARN, self._reporter.last_error
        values: dict[str, str | float | int] = {
            f"refused_{cause}": count for cause, count in self._reporter.failures.items()
        }
        values |= {
            "lifecycle": self.lifecycle_state,
            "image_topic": self._images.topic,
            "image_reliability": self._images.reliability,
            "preset": status.preset,
            "realtime_priority": self._real_time.granted if self._real_time else 0,
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


class _Result(NamedTuple):
    """What became of one frame.

    Attributes:
        frame: As in the status.
        known: What is known after it; None where it was not looked at.
    """

    frame: str
    known: FrameResult | None = None


def _has_several(values: Values) -> bool:
    """Whether there may be several targets."""
    return bool(values["max_targets"] > 1)


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
