"""The ROS node `pf_tracker`: images and targets in, boxes and what the tracker knows out."""

from __future__ import annotations

import time
import traceback
from collections import deque
from typing import Any

import cv2
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PolygonStamped
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import Header

from pf_tracker_ros.node.image_decoding import ImageError, decode
from pf_tracker_ros.node.message_building import (
    TargetError,
    box_message,
    box_of_polygon,
    estimate_values,
    image_message,
    particles_message,
    status_message,
)
from pf_tracker_ros.node.node_parameters import NodeParameters
from pf_tracker_ros.node.overlay import draw_overlay
from pf_tracker_ros.node.parameter_binding import ParameterBinding, Values
from pf_tracker_ros.node.running import run
from pf_tracker_ros.node.session import NANOSECONDS, Outcome, Session
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters

# The newest frame wins where frames may be lost; else a few may wait.
_IMAGE_QOS = {
    "best_effort": QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),
    "reliable": QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE),
}
_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
_LEVELS = {
    "idle": DiagnosticStatus.OK,
    "tracking": DiagnosticStatus.OK,
    "occluded": DiagnosticStatus.WARN,
    "lost": DiagnosticStatus.ERROR,
}
_LOG_INTERVAL = 5.0
# What came over the wire may be quoted in an error, and be of any length.
_LONGEST_ERROR = 1000
_SHOWN_ERRORS = 5


class TrackerNode(Node):
    """Tracks one target through the images of one topic.

    Every image is answered by one status with its header, whatever became of it. A wrong
    parameter at start-up keeps the node from tracking until it is set rightly; it stays up.

    Args:
        **options: Of `rclpy.node.Node`.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("pf_tracker", **options)
        self._log = self.get_logger()  # type: ignore[no-untyped-call]
        self._last_error = ""
        self._unshown_errors: deque[str] = deque(maxlen=_SHOWN_ERRORS)
        self._logged: dict[str, float] = {}
        self._session: Session | None = None
        self._obstacle = ""

        self._tunables = declarations(TrackerParameters)
        self._binding = ParameterBinding(self, report=self._report)
        self._binding.declare(declarations(NodeParameters))
        self._binding.declare(self._tunables, preset_parameters(self._binding.values["preset"]))
        self._binding.listen(check=self._check, apply=self._apply, imply=self._imply)
        self._configure()

        self._box_publisher = self.create_publisher(PolygonStamped, "~/box", _QOS)
        self._particles_publisher = self.create_publisher(PointCloud2, "~/particles", _QOS)
        self._overlay_publisher = self.create_publisher(Image, "~/overlay", _QOS)
        self._status_publisher = self.create_publisher(DiagnosticArray, "~/status", _QOS)
        # The executor serves what waits in this order: a target before the image that came with it.
        self.create_subscription(PolygonStamped, "~/target", self._on_target, _QOS)
        self._image_subscription = self._subscribe()
        self._state = "idle"
        self._log.info(
            f"preset {self._binding.values['preset']}, "
            f"images on {self._image_subscription.topic_name}, "
            f"targets on {self.get_fully_qualified_name()}/target"
        )

    def _subscribe(self) -> Subscription:
        quality = _IMAGE_QOS[self._binding.values["image_reliability"]]
        return self.create_subscription(Image, "image", self._on_image, quality)

    # Parameters

    def _imply(self, requested: Values) -> Values:
        """A preset brings values for all that the user has not set."""
        if "preset" not in requested:
            return {}
        values = preset_parameters(requested["preset"])
        return {name: values[name] for name in values if name not in self._binding.given}

    def _check(self, values: Values) -> None:
        if self._session:
            Session(self._tracker_values(values), values["seed"])

    def _apply(self, changes: Values) -> None:
        if "image_reliability" in changes:
            self.destroy_subscription(self._image_subscription)
            self._image_subscription = self._subscribe()
        if self._session is None:
            self._configure()
            return
        values = self._binding.values
        self._session.configure(self._tracker_values(values), values["seed"])
        if "target_box" in changes:
            self._request_target_box(self._session)

    def _configure(self) -> None:
        """Make the session, unless a parameter is in the way."""
        values = self._binding.values
        self._obstacle = "; ".join(self._binding.refused.values())
        if self._obstacle:
            return
        try:
            self._session = Session(self._tracker_values(values), values["seed"])
        except ValueError as error:
            self._obstacle = str(error)
            self._report(self._obstacle)
            return
        self._request_target_box(self._session)

    def _request_target_box(self, session: Session) -> None:
        box = self._binding.values["target_box"]
        if box:
            session.request(box)
        else:
            session.withdraw()

    def _tracker_values(self, values: Values) -> dict[str, Any]:
        return {name: values[name] for name in self._tunables}

    # Messages

    def _on_target(self, message: PolygonStamped) -> None:
        try:
            box = box_of_polygon(message)
            if self._session is None:
                raise TargetError(f"target refused: not tracking, because {self._obstacle}")
        except TargetError as error:
            self._report(str(error))
            return
        self._session.request(box, _nanoseconds(message.header))

    def _on_image(self, message: Image) -> None:
        began = time.perf_counter()
        frame = "refused"
        try:
            image = decode(message)
            frame = self._process(image, message.header)
        except Exception as error:
            if not self.context.ok():
                return
            self._report_failure(error)
        self._publish_status(message.header, frame, time.perf_counter() - began)

    def _process(self, image: NDArray[Any], header: Header) -> str:
        outcome = Outcome("waiting", None)
        if self._session:
            outcome = self._session.process(image, _nanoseconds(header))
        if outcome.refused_target:
            self._report(outcome.refused_target)
        self._log_progress(outcome)
        if outcome.frame not in ("duplicate", "late"):
            self._publish(image, header, outcome)
        return outcome.frame

    def _log_progress(self, outcome: Outcome) -> None:
        estimate = outcome.estimate
        if estimate is None:
            return
        if outcome.frame == "started":
            box = ", ".join(f"{value:g}" for value in estimate.box)
            self._log.info(f"tracking a target from the box ({box}) on")
        elif estimate.state != self._state:
            self._log.info(
                f"{self._state} -> {estimate.state}, confidence {estimate.confidence:.2f}",
                throttle_duration_sec=_LOG_INTERVAL,
            )
        self._state = estimate.state

    def _publish(self, image: NDArray[Any], header: Header, outcome: Outcome) -> None:
        estimate = outcome.estimate
        if estimate and estimate.state != "lost":
            self._box_publisher.publish(box_message(estimate.box, header))
        if estimate and self._particles_publisher.get_subscription_count():
            self._particles_publisher.publish(particles_message(estimate, header))
        if self._overlay_publisher.get_subscription_count():
            text = f"{estimate.state} {estimate.confidence:.2f}" if estimate else "no target"
            overlay = draw_overlay(image, estimate, text)
            self._overlay_publisher.publish(image_message(overlay, header))

    def _publish_status(self, header: Header, frame: str, elapsed: float) -> None:
        estimate = self._session.estimate if self._session else None
        state = estimate.state if estimate else "idle"
        level = _LEVELS[state]
        errors = [error for error in self._unshown_errors if error not in self._obstacle]
        self._unshown_errors.clear()
        if self._obstacle or frame == "refused":
            level = DiagnosticStatus.ERROR
        elif errors:
            level = max(level, DiagnosticStatus.WARN)
        if self._obstacle or not errors:
            errors.insert(0, self._description(state))
        values: dict[str, str | float | int] = {"state": state, "frame": frame}
        if estimate:
            values |= estimate_values(estimate)
        values["processing_time_ms"] = 1e3 * elapsed
        values["preset"] = self._binding.values["preset"]
        values["last_error"] = self._last_error
        self._status_publisher.publish(
            status_message(
                header,
                self.get_fully_qualified_name(),
                level,
                "; ".join(errors),
                values,
            )
        )

    def _description(self, state: str) -> str:
        if self._obstacle:
            return f"not tracking: {self._obstacle}"
        waiting_for = self._session.requested_stamp if self._session else None
        if waiting_for:
            seconds, nanoseconds = divmod(waiting_for, NANOSECONDS)
            return f"{state}; a target waits for an image stamped {seconds}.{nanoseconds:09d} s"
        return {
            "idle": "waiting for a target",
            "tracking": "tracking",
            "occluded": "the target is hidden; the motion model carries it on",
            "lost": "the target is lost",
        }[state]

    # Errors

    def _report(self, error: str) -> None:
        """Tell the user what was refused: in the log, and in the next status."""
        error = error[:_LONGEST_ERROR]
        self._remember(error)
        self._log.error(error)

    def _report_failure(self, error: Exception) -> None:
        """Tell the user why a frame failed; the log hears of each kind only now and then."""
        kind = type(error).__name__
        text = str(error)[:_LONGEST_ERROR]
        details = text
        if isinstance(error, ImageError):
            kind = f"{kind} {error.field}"
        elif not isinstance(error, ValueError):
            text = f"unexpected {kind}: {error}"
            details = traceback.format_exc()
        self._remember(text)
        now = time.monotonic()
        if now - self._logged.get(kind, -_LOG_INTERVAL) >= _LOG_INTERVAL:
            self._logged[kind] = now
            self._log.error(details)

    def _remember(self, error: str) -> None:
        self._last_error = error
        self._unshown_errors.append(error)


def _nanoseconds(header: Header) -> int:
    return int(header.stamp.sec) * NANOSECONDS + int(header.stamp.nanosec)


def main(arguments: list[str] | None = None) -> None:
    """Run the tracker node until it is told to stop."""
    # The tracker looks at small regions: more threads make it no faster and keep other cores busy.
    cv2.setNumThreads(1)
    run(TrackerNode, arguments)


if __name__ == "__main__":
    main()
