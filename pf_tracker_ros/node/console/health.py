"""How the tracker is, in the words of its diagnostics, and whether it is heard at all."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pf_tracker_ros.node.console.json_conversions import Json

# The diagnostics come once a second; a tracker that says nothing for longer has gone.
_SILENCE = 1.6
_FAULT_SHOWN = 6.0
_SHOWN = ("confidence", "image_topic", "image_reliability", "preset", "input_rate")


class TrackerHealth:
    """What was heard of one tracker. All times are seconds by one clock that never jumps.

    Attributes:
        last_status_at: When it answered a frame last.

    Args:
        name: Of the tracker's node.
    """

    def __init__(self, name: str) -> None:
        self.last_status_at = float("-inf")
        self._name = name
        self._status: Json | None = None
        self._diagnostics: Json | None = None
        # Of the newer of the two.
        self._state: object = None
        self._heard_at: float | None = None
        self._fault, self._fault_at = "", float("-inf")

    def take_status(self, status: Json, now: float) -> None:
        """Take the status of a frame."""
        self._heard_at = self.last_status_at = now
        self._status, self._state = status, status["values"].get("state")

    def take_diagnostics(self, diagnostics: Json, now: float) -> None:
        """Take what the node says of itself once a second."""
        self._heard_at, self._diagnostics = now, diagnostics
        self._state = diagnostics["values"].get("state")

    def take_fault(self, fault: str, now: float) -> None:
        """Take what the console itself has to complain about."""
        self._fault, self._fault_at = fault, now

    def summary(
        self,
        now: float,
        *,
        recording_paused: bool,
        others: Callable[[], Sequence[str]] = tuple,
        graph_faults: Sequence[str] = (),
    ) -> Json:
        """What the page shows.

        Args:
            now: The time.
            recording_paused: Whether a recording does, so that images are not missed.
            others: Tells the names of the trackers that there are, for one who asks for another.
            graph_faults: Of the ROS graph around the console, a sentence each.
        """
        said = self._diagnostics or self._status
        if self._heard_at is None or said is None:
            there = ", ".join(others())
            cure = (
                f"there is {there}: start the console with -p tracker:=NAME"
                if there
                else "start it (ros2 run pf_tracker_ros tracker), with the ROS_DOMAIN_ID of the "
                "console"
            )
            text = f"no tracker is heard as {self._name}; {cure}"
            return {"type": "health", "tracker": "absent", "level": "error", "text": text}
        if now - self._heard_at > _SILENCE:
            text = (
                f"{self._name} has fallen silent: it has ended, hangs, or cannot be reached; the "
                "console goes on with it as soon as it is back"
            )
            return {"type": "health", "tracker": "silent", "level": "error", "text": text}
        values = said["values"]
        if self._status and self._state not in (values.get("state"), "skipped"):
            # It has changed since the diagnostics came, which tell of the one before. Of a single
            # frame that was skipped, nobody need read.
            said = self._status
        text, level = str(said["message"]), said["level"]
        if recording_paused and text.startswith("no image for"):
            # No fault of anybody.
            text, level = text.partition("; ")[2], "ok"
        faults = dict.fromkeys(graph_faults)
        if now - self._fault_at < _FAULT_SHOWN:
            faults[self._fault] = None
        if faults:
            text, level = f"{text}; the console: {'; '.join(faults)}", "error"
        told = {"type": "health", "tracker": "heard", "level": level, "text": text}
        return told | {name: values.get(name) for name in _SHOWN} | {"state": self._state}
