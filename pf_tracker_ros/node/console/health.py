"""The health of the tracker: its own diagnostics, or that it is absent or silent."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pf_tracker_ros.node.console.json_conversions import Json

# Seconds without a message until a tracker counts as silent; its diagnostics come once a second.
_SILENCE = 1.6
_FAULT_SHOWN = 6.0
_SHOWN_VALUES = ("confidence", "image_topic", "image_reliability", "preset", "input_rate")


class TrackerHealth:
    """Health of one tracker. All times are seconds by a monotonic clock.

    Attributes:
        last_status_at: Time of the last status of a frame.

    Args:
        name: Of the tracker's node.
    """

    def __init__(self, name: str) -> None:
        self.last_status_at = float("-inf")
        self._name = name
        self._status: Json | None = None
        self._diagnostics: Json | None = None
        # The state in the newer of the two.
        self._state: object = None
        self._received_at: float | None = None
        self._fault, self._fault_at = "", float("-inf")

    def take_status(self, status: Json, now: float) -> None:
        """Process the status of a frame."""
        self._received_at = self.last_status_at = now
        self._status, self._state = status, status["values"].get("state")

    def take_diagnostics(self, diagnostics: Json, now: float) -> None:
        """Process the node's diagnostics."""
        self._received_at, self._diagnostics = now, diagnostics
        self._state = diagnostics["values"].get("state")

    def take_fault(self, fault: str, now: float) -> None:
        """Process a fault that the console has found itself."""
        self._fault, self._fault_at = fault, now

    def summary(
        self,
        now: float,
        *,
        recording_paused: bool,
        others: Callable[[], Sequence[str]] = tuple,
        graph_faults: Sequence[str] = (),
    ) -> Json:
        """The `health` message for the page.

        Args:
            now: The time.
            recording_paused: Whether a recording is paused, so that no images are expected.
            others: Returns the names of available trackers, which the page suggests.
            graph_faults: Faults of the ROS graph around the console, a sentence each.
        """
        source = self._diagnostics or self._status
        if self._received_at is None or source is None:
            names = ", ".join(others())
            cure = (
                f"there is {names}: start the console with -p tracker:=NAME"
                if names
                else "start it (ros2 run pf_tracker_ros tracker), with the ROS_DOMAIN_ID of the "
                "console"
            )
            text = f"no tracker {self._name}; {cure}"
            return {"type": "health", "tracker": "absent", "level": "error", "text": text}
        if now - self._received_at > _SILENCE:
            text = (
                f"{self._name} is silent: it has ended, hangs, or cannot be reached; the console "
                "continues as soon as it is back"
            )
            return {"type": "health", "tracker": "silent", "level": "error", "text": text}
        values, state = source["values"], self._state
        if recording_paused and self._status and "duplicate stamp" in source["message"]:
            # The frame was repeated for a target that was refused: its first result holds.
            source, state = self._status, self._status["values"].get("state")
        elif self._status and state not in (values.get("state"), "skipped"):
            # The state has changed since the last diagnostics. A single skipped frame is no news.
            source = self._status
        text, level = str(source["message"]), source["level"]
        if recording_paused and text.startswith("no image for"):
            # Expected while paused: the rest keeps its level.
            text = text.partition("; ")[2]
            if not self._status or not text.startswith(self._status["message"]):
                level = "ok"
            elif text == self._status["message"]:
                level = self._status["level"]
        faults = dict.fromkeys(graph_faults)
        if now - self._fault_at < _FAULT_SHOWN:
            faults[self._fault] = None
        if faults:
            text, level = f"{text}; the console: {'; '.join(faults)}", "error"
        health = {"type": "health", "tracker": "alive", "level": level, "text": text}
        return health | {name: values.get(name) for name in _SHOWN_VALUES} | {"state": state}
