"""Several targets: their session, what is heard and published of them, and what the log tells."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial
from typing import Any, NamedTuple

from numpy.typing import NDArray
from rclpy.node import Node
from std_msgs.msg import Header

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.node.parameter_group import Values
from pf_tracker_ros.node.qos import Report
from pf_tracker_ros.node.tracker.detections import DETECTIONS_TYPE
from pf_tracker_ros.node.tracker.following import Followed, Known, TargetStatus, show_nothing
from pf_tracker_ros.node.tracker.reporter import Throttle
from pf_tracker_ros.node.tracker.session_settings import set_up
from pf_tracker_ros.node.tracker.several_input import DETECTIONS_TOPIC, NOT_INSTALLED, SeveralInput
from pf_tracker_ros.node.tracker.several_outputs import SeveralOutputs
from pf_tracker_ros.node.tracker.skipped_frames import SKIPPED
from pf_tracker_ros.node.tracker.state_log import TargetsLog
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import build, declarations
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.stamps import stamp_of
from pf_tracker_ros.targets.built_in_detectors import DETECTORS, Detector
from pf_tracker_ros.targets.detecting import DetectingThread
from pf_tracker_ros.targets.detections import Detections
from pf_tracker_ros.targets.parameters import SeveralTargetsParameters, multi_preset_parameters
from pf_tracker_ros.targets.session import MultiOutcome, MultiSession
from pf_tracker_ros.targets.statuses import (
    best_state,
    description,
    severity,
    target_values,
)
from pf_tracker_ros.targets.tracked_target import TrackedTarget
from pf_tracker_ros.tracking.presets import PresetInForce
from pf_tracker_ros.tracking.state_descriptions import DESCRIPTIONS


class _ChosenDetector(NamedTuple):
    """The built-in detector that is asked for.

    Attributes:
        name: A key of `DETECTORS`, or "none".
        parameters: Its group of tunables.
        rate: Most frames that it looks at in a second.
    """

    name: str = "none"
    parameters: Any = None
    rate: float = 0.0

    @classmethod
    def of(cls, values: Values) -> _ChosenDetector:
        """The one that values of all parameters ask for."""
        of_node = {name: values[name] for name in declarations(NodeParameters)}
        node = build(NodeParameters, of_node)
        name = node.built_in_detector
        return cls(name, node.of_detectors.get(name), node.built_in_detector_rate)

    def make(self) -> Detector | None:
        """The detector, None for "none".

        Raises:
            ValueError: It cannot be made here.
        """
        if self.name == "none":
            return None
        try:
            return DETECTORS.make(self.name, self.parameters)
        except Exception as error:
            # Whatever is missing for it on this machine, the node is to stay up.
            raise ValueError(
                f"the built-in detector {self.name!r} cannot be made here: {error}; set "
                "'built_in_detector' to another one, or to 'none'"
            ) from error


class SeveralTargets:
    """Follows several targets; see `Following`.

    Args:
        logger: Of the node.
    """

    tunables = SeveralTargetsParameters
    # They tell of the detector that there is, and not of how it is made use of.
    kept: Collection[str] = tuple(
        name for name in declarations(SeveralTargetsParameters) if name.startswith("detector.")
    )

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self._log = TargetsLog(logger)
        self._left_out = Throttle()
        self._session: MultiSession | None = None
        self._input: SeveralInput | None = None
        self._outputs: SeveralOutputs | None = None
        self._heard = 0
        self._detecting: DetectingThread | None = None
        self._detector = _ChosenDetector()

    def usual(self, preset: str) -> Values:  # noqa: D102
        return multi_preset_parameters(preset)

    def preset(self, values: Values) -> PresetInForce:  # noqa: D102
        return PresetInForce.of(values, self.usual)

    @property
    def is_ready(self) -> bool:  # noqa: D102
        return self._session is not None

    def check(self, values: Values) -> None:  # noqa: D102
        if self._session:
            self._session.check(_of_tracker(values), values["seed"])
        else:
            MultiSession(_of_tracker(values), values["seed"])
        detector = _ChosenDetector.of(values)
        if detector[:2] != self._detector[:2]:
            detector.make()

    def configure(self, values: Values) -> None:  # noqa: D102
        chosen = _ChosenDetector.of(values)
        # First, since it may be impossible: what is refused changes nothing.
        is_another = chosen != self._detector
        detector = chosen.make() if is_another else None
        if self._session:
            self._session.configure(_of_tracker(values), values["seed"])
        else:
            self._session = MultiSession(_of_tracker(values), values["seed"])
        set_up(self._session, values)
        if is_another:
            self._end_detecting()
            self._detecting = DetectingThread(detector, chosen.rate) if detector else None
            self._detector = chosen

    def _end_detecting(self) -> None:
        if self._detecting:
            self._detecting.close()
        self._detecting, self._detector = None, _ChosenDetector()

    def forget(self) -> None:  # noqa: D102
        self._end_detecting()
        self._session = None
        self._heard = 0

    def advertise(self, node: Node, report: Report) -> None:  # noqa: D102
        self._outputs = SeveralOutputs(node, report)

    def subscribe(self, node: Node, report: Report) -> None:  # noqa: D102
        if DETECTIONS_TYPE:
            self._logger.info(f"detections on {node.resolve_topic_name(DETECTIONS_TOPIC)}")
        elif self._detector.name == "none":
            self._logger.warning(NOT_INSTALLED)
        self._input = SeveralInput(node, self._detect, self._stop_target, report)

    def unsubscribe(self) -> None:  # noqa: D102
        if self._input:
            self._input.close()
            self._input = None

    def close(self) -> None:  # noqa: D102
        if self._outputs:
            self._outputs.close()
            self._outputs = None

    def request(self, box: Box, stamp: int) -> None:  # noqa: D102
        if self._session:
            self._session.request(box, stamp)

    def withdraw(self) -> None:  # noqa: D102
        if self._session:
            self._session.withdraw()

    def stop(self) -> str:  # noqa: D102
        count = len(self._session.targets) if self._session else 0
        if self._session:
            self._session.stop()
        self._log.tell(())
        if count == 0:
            return "there was no target"
        return f"stopped {counted(count, 'target')}; waiting for a target"

    def begin_frame(self) -> None:
        """Take what detectors have said before the frame."""
        if self._input:
            self._input.take_waiting()

    def process(  # noqa: D102
        self, read: Callable[[], NDArray[Any]], header: Header
    ) -> Followed:
        stamp = stamp_of(header)
        failures = self._ask_detector()
        if self._session:
            outcome = self._session.process_unread(read, stamp)
        else:
            read()
            outcome = MultiOutcome("waiting")
        if self._detecting and outcome.jumped_back:
            self._detecting.disregard()
        if self._detecting and outcome.frame not in SKIPPED:
            self._detecting.offer(read(), stamp)
        show = show_nothing
        if self._outputs and outcome.frame not in SKIPPED:
            self._outputs.publish(header, outcome.targets)
            show = partial(self._outputs.show, read(), header, outcome.targets)
            self._log.tell(outcome.targets)
        errors = (
            *outcome.refused,
            *outcome.ended,
            *self._left_out.pick((*failures, *outcome.left_out)),
        )
        return Followed(outcome.frame, errors, outcome.jumped_back, show)

    def pass_over(self, stamp: int) -> None:  # noqa: D102
        if self._session:
            self._session.pass_over(stamp)
        if self._detecting:
            self._detecting.disregard()

    def _ask_detector(self) -> tuple[str, ...]:
        """Take what the built-in detector has found since the last frame; what went wrong."""
        if self._detecting is None:
            return ()
        try:
            found = self._detecting.take()
            if found:
                self._detect(*found)
        except Exception as error:
            # Whatever the detector raised, in its thread: the frame at hand has no part in it.
            return (f"the detector '{self._detector.name}' failed: {error}",)
        return ()

    def _detect(self, detections: Detections, stamp: int) -> None:
        self._heard += 1
        if self._session:
            self._session.add_detections(detections, stamp)

    def _stop_target(self, id: int) -> None:
        if self._session:
            self._session.stop_target(id)

    @property
    def known(self) -> Known:  # noqa: D102
        session = self._session
        targets = session.targets if session else ()
        return Known(
            best_state(targets),
            description(targets),
            {"targets": len(targets), "detector_answers": self._heard},
            {},
            session.requested_stamp if session else None,
            tuple(_status_of(target) for target in targets),
        )


def _of_tracker(values: Values) -> dict[str, Any]:
    tunables = declarations(SeveralTargetsParameters)
    return {name: values[name] for name in tunables} | {"targets.most": values["max_targets"]}


def _status_of(target: TrackedTarget) -> TargetStatus:
    return TargetStatus(
        target.id,
        bytes([severity(target)]),
        DESCRIPTIONS[target.estimate.state],
        target_values(target),
    )
