"""What the node tracks with: the session, as its parameters ask for it, and a built-in detector."""

from __future__ import annotations

from typing import Any, NamedTuple

from pf_tracker_ros.node.parameter_group import Values
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameters import build, declarations
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.built_in_detectors import DETECTORS, Detector, DetectorThread
from pf_tracker_ros.targets.session import Session
from pf_tracker_ros.tracking.frame_clock import TimePolicy
from pf_tracker_ros.tracking.parameters import TrackerParameters


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
        return cls(name, node.detector_parameters.get(name), node.built_in_detector_rate)

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


class SessionManager:
    """The session of a configured node, and the detector of its own.

    It begins without a session, and is without one while a parameter is in the way.

    Attributes:
        session: None where there is none.
    """

    def __init__(self) -> None:
        self.session: Session | None = None
        self._detecting: DetectorThread | None = None
        self._detector = _ChosenDetector()

    def check(self, values: Values) -> None:
        """Try what `configure` would do with the node's parameters.

        Raises:
            ValueError: As `configure`.
        """
        if self.session:
            self.session.check(_of_tracker(values), values["seed"])
        else:
            Session(_of_tracker(values), values["seed"])
        detector = _ChosenDetector.of(values)
        if detector[:2] != self._detector[:2]:
            detector.make()

    def configure(self, values: Values) -> None:
        """Take parameters, and a session if there is none.

        Args:
            values: Full name to value of the node's parameters.

        Raises:
            ValueError: They cannot be; all is as before then.
        """
        chosen = _ChosenDetector.of(values)
        # First, since it may be impossible: what is refused changes nothing.
        detector = chosen.make() if chosen != self._detector else None
        if self.session:
            self.session.configure(_of_tracker(values), values["seed"])
        else:
            self.session = Session(_of_tracker(values), values["seed"])
        threshold = round(values["time_jump_threshold"] * NANOSECONDS)
        self.session.time_policy = TimePolicy(values["time_jump"], threshold)
        self.session.frame_buffer.limit(
            values["frame_buffer_length"], values["frame_buffer_megabytes"]
        )
        if chosen != self._detector:
            self._end_detecting()
            self._detecting = DetectorThread(detector, chosen.rate) if detector else None
            self._detector = chosen

    def forget(self) -> None:
        """Give the session up."""
        self._end_detecting()
        self.session = None

    def stop(self) -> str:
        """Forget all targets, and tell what came of it."""
        count = len(self.session.targets) if self.session else 0
        if self.session:
            self.session.stop()
        if count == 0:
            return "there was no target"
        return f"stopped {counted(count, 'target')}; waiting for a target"

    def take_detections(self) -> tuple[str, ...]:
        """Take what the built-in detector has found since the last frame; what went wrong."""
        if self._detecting is None or self.session is None:
            return ()
        try:
            found = self._detecting.take()
        except Exception as error:
            # Whatever the detector raised, in its thread: the frame at hand has no part in it.
            return (f"the detector '{self._detector.name}' failed: {error}",)
        try:
            if found:
                self.session.add_detections(*found)
        except ValueError as error:
            return (f"detections refused: {error}",)
        return ()

    def offer(self, image: Any, stamp: int, *, jumped_back: bool) -> None:
        """Show a frame that was looked at to the built-in detector.

        Args:
            image: (H, W, 3) or (H, W), not to be changed from then on.
            stamp: Of the frame, nanoseconds.
            jumped_back: Whether time went back with it.
        """
        if self._detecting:
            if jumped_back:
                self._detecting.discard_pending()
            self._detecting.offer(image, stamp)

    def skip(self, stamp: int) -> None:
        """Let the clock go on with a frame that is not looked at; its stamp, nanoseconds."""
        if self.session:
            self.session.skip(stamp)
        if self._detecting:
            self._detecting.discard_pending()

    def _end_detecting(self) -> None:
        if self._detecting:
            self._detecting.close()
        self._detecting, self._detector = None, _ChosenDetector()


def _of_tracker(values: Values) -> dict[str, Any]:
    return {name: values[name] for name in declarations(TrackerParameters)}
