"""The ROS node `pf_tracker`: images, target requests and detections in, tracks out."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, TypeVar

import cv2
from numpy.typing import NDArray
from rclpy.service import Service
from sensor_msgs.msg import CompressedImage, Image
from std_srvs.srv import SetBool, Trigger

from pf_tracker_ros.decoding.image_decoding import decode_image
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.messages import ERROR, OK, WARN
from pf_tracker_ros.node.graph_monitor import GraphMonitor
from pf_tracker_ros.node.managed_node import ManagedNode
from pf_tracker_ros.node.override_sources import parameters_superseded_by
from pf_tracker_ros.node.parameter_binding import ParameterBinding
from pf_tracker_ros.node.parameter_group import ParameterValues
from pf_tracker_ros.node.qos import given_overrides, is_overridden
from pf_tracker_ros.node.real_time import RealTimePriority
from pf_tracker_ros.node.running import run
from pf_tracker_ros.node.tracker.diagnostics import Diagnostics, Health
from pf_tracker_ros.node.tracker.image_subscription import RELIABILITY_REMEDY, ImageSubscription
from pf_tracker_ros.node.tracker.outcome_log import OutcomeLog
from pf_tracker_ros.node.tracker.publishers import FramePublishers
from pf_tracker_ros.node.tracker.reporter import Reporter
from pf_tracker_ros.node.tracker.session_manager import SessionManager
from pf_tracker_ros.node.tracker.status import (
    NodeStatus,
    SkippedFrames,
    StatusOutput,
    skip_cause,
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
from pf_tracker_ros.targets.session import DROPPED_ARRIVALS, Session
from pf_tracker_ros.topics import SKIPPED, FrameResult, StatusValues
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import ActivePreset, preset_parameters

Value = TypeVar("Value")


class TrackerNode(ManagedNode):
    """Tracks one or more targets through the images of one topic.

    Configured, it has a session, publishers and services; active, it subscribes. Each image yields
    one status with its header, also if it is skipped. After an invalid parameter at start-up the
    node runs, but does not track until the parameter is corrected.

    Args:
        command_line: Command line of the process, for the order of parameters and parameter files;
            the node's overrides have no order.
        has_process: Whether the node owns the process, and may set its priority.
        **options: Keyword arguments of `rclpy.node.Node`.
    """

    def __init__(
        self, command_line: Sequence[str] = (), *, has_process: bool = False, **options: Any
    ) -> None:
        super().__init__("pf_tracker", **options)
        self._log = self.get_logger()  # type: ignore[no-untyped-call]
        self._reporter = Reporter(self._log)
        self._skipped = SkippedFrames(self._log)
        self._configuration_error = ""
        self._enabled = True
        self._has_target = False
        self._manager = SessionManager()
        self._result = FrameResult()
        self._outcome_log = OutcomeLog(self._log, self._reporter.report)
        self._status_output: StatusOutput | None = None
        self._frame_publishers: FramePublishers | None = None
        self._trigger_services: list[Service] = []
        self._target_subscriptions: TargetSubscriptions | None = None
        self._unused_overrides: set[str] = set()

        self._binding = ParameterBinding(self, report=self._reporter.report)
        self._declare_parameters([*command_line, *(options.get("cli_args") or ())])
        self._binding.listen(check=self._check, apply=self._apply)
        self._real_time: RealTimePriority | None = None
        if has_process:
            self._real_time = RealTimePriority(self._reporter.report)
            self._real_time.request_priority(self._values["realtime_priority"])
        self._update_preset()
        self._diagnostics = Diagnostics(
            self, self._health, lambda: self._values["image_timeout"], self._reporter.report
        )
        self._image_subscription = ImageSubscription(
            self, self._on_image, self._reporter.report, on_lost=self._diagnostics.count_lost
        )
        self._errors_in_health = 0
        self._graph = GraphMonitor(
            self, self._reporter.report, self._remedy, self._image_subscription.conflicts
        )
        if self._values["autostart"]:
            self.start()
        else:
            self._log.info("waiting to be configured and activated, as 'autostart' is false")

    @property
    def _values(self) -> ParameterValues:
        return self._binding.values

    def _update_preset(self) -> None:
        """Compare the present values with their preset."""
        self._preset = ActivePreset.of(self._values)
        self._summary = self._preset.summary

    # Transitions

    def configure(self) -> None:
        """Create the session, the publishers and the services."""
        self._create_session()
        if self._configuration_error and not self._values["autostart"]:
            raise ValueError(self._configuration_error)
        report = self._reporter.report
        self._status_output = StatusOutput(self, report)
        self._frame_publishers = FramePublishers(self, report)
        self._trigger_services = [
            self.create_service(Trigger, "~/stop", self._on_stop),
            self.create_service(SetBool, "~/enable", self._on_enable),
        ]

    def activate(self) -> None:
        """Subscribe to target requests, detections and images."""
        # Before the images: the executor serves subscriptions in the order of their creation.
        self._target_subscriptions = TargetSubscriptions(
            self,
            self._session,
            lambda: self._values["click_size"],
            self._image_subscription.check_frame_id,
            self._reporter.report,
        )
        self._subscribe()
        self._diagnostics.restart()
        self._skipped.forget()
        self._report_unused_overrides()
        name = self.get_fully_qualified_name()
        topics = f"images on {self._image_subscription.topic}, targets on {name}/target"
        if DETECTIONS_CLASS:
            topics += f", detections on {self.resolve_topic_name(DETECTIONS_TOPIC)}"
        elif _is_multi_target(self._values) and self._values["built_in_detector"] == "none":
            self._log.warning(VISION_MSGS_MISSING)
        if self._configuration_error:
            self._log.warning(f"not tracking until the parameters are corrected; {topics}")
        else:
            self._log.info(f"preset {self._preset.description}; {topics}")

    def deactivate(self) -> None:
        """Unsubscribe; the targets are kept."""
        self._image_subscription.close()
        if self._target_subscriptions:
            self._target_subscriptions.close()
            self._target_subscriptions = None

    def clean_up(self) -> None:
        """Remove subscriptions, publishers, services and session."""
        self.deactivate()
        for service in self._trigger_services:
            self.destroy_service(service)
        self._trigger_services = []
        for interface in (self._status_output, self._frame_publishers):
            if interface:
                interface.close()
        self._status_output = self._frame_publishers = None
        self._manager.forget()
        self._result = FrameResult()
        self._configuration_error = ""
        self._enabled = True

    def _subscribe(self) -> None:
        self._image_subscription.open(
            self._values["image_transport"], self._values["image_reliability"]
        )

    def _report_unused_overrides(self) -> None:
        unused = {name for name in given_overrides(self) if not self.has_parameter(name)}
        for name in sorted(unused - self._unused_overrides):
            self._reporter.report(
                f"'{name}' has no effect: this node has no such topic, or QoS no such policy"
            )
        self._unused_overrides |= unused

    # Parameters

    def _declare_parameters(self, command_line: Sequence[str]) -> None:
        self._binding.declare(NodeParameters)
        self._binding.declare(
            TrackerParameters,
            defaults=lambda values: preset_parameters(values["preset"], values["max_targets"]),
            reset_by={
                "preset": lambda before, after: True,
                "max_targets": lambda before, after: (before > 1) != (after > 1),
            },
            # They describe the detector, not its use by a preset.
            kept=[name for name in declarations(TrackerParameters) if name.startswith("detector.")],
            superseded=parameters_superseded_by(
                "preset", self.get_fully_qualified_name(), command_line
            ),
            # The session relearns the targets if needed.
            keeps_read_only=False,
        )

    def _check(self, values: ParameterValues) -> None:
        if self._manager.session or not (self._configuration_error or self._binding.refused):
            self._manager.check(values)

    def _apply(self, changes: ParameterValues) -> None:
        self._update_preset()
        if changes.keys() & {"preset", "max_targets"}:
            self._log.info(f"preset {self._preset.description}")
        if self._real_time and "realtime_priority" in changes:
            self._real_time.request_priority(self._values["realtime_priority"])
        image_changes = changes.keys() & {"image_reliability", "image_transport"}
        if self._image_subscription.topic and image_changes:
            self._subscribe()
        if self._manager.session is None:
            if self._status_output:
                self._create_session()
            return
        self._manager.configure(self._values)
        if "target_box" in changes:
            self._request_target_box()

    def _create_session(self) -> None:
        """Create the session, unless a parameter is invalid."""
        self._configuration_error = "; ".join(self._binding.refused.values())
        if self._configuration_error:
            return
        try:
            self._manager.configure(self._values)
        except ValueError as error:
            self._configuration_error = str(error)
            self._reporter.report(self._configuration_error)
            return
        self._request_target_box()

    def _session(self) -> Session:
        """The session.

        Raises:
            ValueError: There is none, with the reason.
        """
        if self._manager.session is None:
            raise ValueError(f"not tracking: {self._configuration_error}")
        return self._manager.session

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

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Stop all targets."""
        self._has_target = False
        response.success, response.message = True, self._manager.stop()
        self._result = self._frame_result()
        self._outcome_log.forget_targets()
        self._log.info(response.message)
        return response

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Resume, or pause."""
        self._enabled = request.data
        answer = "tracking resumed" if request.data else "paused: images are skipped"
        response.success, response.message = True, answer
        self._log.info(answer)
        return response

    # Images

    def _on_image(self, message: Image | CompressedImage) -> None:
        start = time.perf_counter()
        if self._target_subscriptions:
            self._target_subscriptions.take_pending()
        processed = self._report_errors_of(partial(self._process, message))
        if processed is None:
            if not self.context.ok():
                return
            processed = _Processed("refused")
        elapsed = time.perf_counter() - start
        (outcome, result), stamp = processed, stamp_of(message.header)
        if outcome in SKIPPED:
            self._skipped.skip(outcome, self._skip_cause(outcome, stamp))
        else:
            self._skipped.mark_processed(stamp)
        if self._status_output:
            status = self._current_status(outcome)
            self._status_output.publish(message.header, status, self._reporter, elapsed)
            self._has_target = status.last_state != "idle"
        if self._frame_publishers and result and outcome not in SKIPPED:
            publish = self._frame_publishers.publish_visualizations
            self._report_errors_of(partial(publish, message.header, result))
        # Image and likelihood are of this frame alone.
        self._result = replace(self._result, image=None, likelihood=None)
        self._diagnostics.count(outcome, stamp, time.perf_counter() - start)

    def _report_errors_of(self, step: Callable[[], Value]) -> Value | None:
        """The value of a step; None if it fails, which is reported, or the context is shut down."""
        try:
            return step()
        except BaseException as error:
            # A part of another package may raise what would end the process.
            if self.context.ok():
                self._reporter.report_failure(error)
            return None

    def _process(self, message: Image | CompressedImage) -> _Processed:
        """Track in a frame, and publish the topics that robots act on.

        Raises:
            ValueError: The image is invalid.
        """
        stamp = stamp_of(message.header)
        if not self._enabled:
            self._manager.skip(stamp)
            return _Processed("paused")
        session = self._manager.session
        if session is None:
            self._decode(message)
            return _Processed("waiting")
        if self._manager.detector_thread:
            self._outcome_log.report_unrepeated(self._manager.take_detections())
        arrival = session.classify(stamp)
        if arrival in DROPPED_ARRIVALS:
            return _Processed(session.drop(arrival).frame)
        frame = Frame(self._decode(message), stamp)
        outcome = session.process(frame, arrival)
        result = self._frame_result(frame.image)
        try:
            # A duplicate on which a target could start has no new result.
            if self._frame_publishers and outcome.frame not in SKIPPED:
                self._frame_publishers.publish(message.header, result)
                if self._frame_publishers.has_subscribers("likelihood"):
                    result = replace(result, likelihood=session.map_likelihood())
                    self._frame_publishers.publish(message.header, result, ("likelihood",))
        finally:
            # The log and the detector wait for the topics that robots act on.
            self._diagnostics.time_jumps += bool(outcome.jumped_back)
            self._outcome_log.update(
                outcome, self._values["time_jump"], had_target=self._has_target
            )
            if (detector := self._manager.detector_thread) and outcome.frame != "frozen":
                if outcome.jumped_back:
                    detector.discard_pending()
                detector.offer(frame.image, stamp)
        self._result = result
        return _Processed(outcome.frame, result)

    def _decode(self, message: Image | CompressedImage) -> NDArray[Any]:
        return decode_image(message, self._values["max_image_pixels"])

    def _frame_result(self, image: NDArray[Any] | None = None) -> FrameResult:
        """The result after a processed frame; `image` is that of the frame."""
        session = self._manager.session
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

    # Status and health

    def _remedy(self, topic: str, policy: str) -> str:
        """The remedy for an image publisher with an incompatible policy, or empty."""
        is_image = topic == self._image_subscription.topic and policy == "reliability"
        by_parameter = is_image and not is_overridden(self, topic, "subscription", policy)
        return RELIABILITY_REMEDY if by_parameter else ""

    def _skip_cause(self, outcome: str, stamp: int) -> str:
        """Why a frame is skipped, and the remedy."""
        if outcome == "refused":
            return self._reporter.last_error
        topic, frozen_after = self._image_subscription.topic, self._values["frozen_after"]
        return skip_cause(outcome, stamp, topic, frozen_after)

    def _current_status(self, outcome: str) -> NodeStatus:
        session = self._manager.session
        return NodeStatus(
            outcome=outcome,
            result=self._result,
            requested_stamp=session.requested_stamp if session else None,
            skipped=self._skipped.last,
            configuration_error=self._configuration_error,
            enabled=self._enabled,
            preset=self._summary,
            frame_loss_rate=self._diagnostics.frame_loss_rate,
        )

    def _health(self) -> Health:
        if self._target_subscriptions:
            # Here, once a second: without a localizer, no frame pays for its topic.
            self._target_subscriptions.find_localizer()
        status = self._current_status("")
        level, message = status.level, status.description
        active = bool(self._image_subscription.topic)
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
        values: StatusValues = {
            f"refused_{cause}": count for cause, count in self._reporter.failures.items()
        }
        values |= {
            "lifecycle": self.lifecycle_state,
            "image_topic": self._image_subscription.topic,
            "image_reliability": self._image_subscription.reliability,
            "preset": status.preset,
            "realtime_priority": self._real_time.granted if self._real_time else 0,
        }
        values |= status.values
        values |= self._reporter.values()
        return Health(
            level,
            message,
            expects_images=active and self._enabled,
            image_topic=self._image_subscription.topic,
            image_reliability=self._image_subscription.reliability,
            is_compressed=self._values["image_transport"] == "compressed",
            values=values,
        )


class _Processed(NamedTuple):
    """A frame after processing.

    Attributes:
        outcome: As in the status.
        result: None without a session, and for a skipped frame.
    """

    outcome: str
    result: FrameResult | None = None


def _is_multi_target(values: ParameterValues) -> bool:
    """Whether more than one target is allowed."""
    return bool(values["max_targets"] > 1)


def main(arguments: list[str] | None = None) -> None:
    """Run the tracker node until SIGINT or SIGTERM.

    Args:
        arguments: The command line with the program's name, by default that of the process.
    """
    # The tracker processes small regions: more threads do not speed it up, but occupy other cores.
    cv2.setNumThreads(1)
    command_line = sys.argv if arguments is None else arguments
    run(partial(TrackerNode, command_line, has_process=True), arguments)


if __name__ == "__main__":
    main()
