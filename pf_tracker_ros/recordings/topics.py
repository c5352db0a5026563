"""What the node would have published, as a bag to play beside the recording."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from pf_tracker_ros.footage.bag_writing import PARTICLES_TYPE, STATUS_TYPE, BagWriter, Status
from pf_tracker_ros.footage.bags import GROUND_TRUTH_TYPE, IMAGE_TYPE
from pf_tracker_ros.recordings.tracking import Tracked, TrackedFrame
from pf_tracker_ros.tracking.estimate import estimate_values
from pf_tracker_ros.tracking.state_descriptions import DESCRIPTIONS, SEVERITIES

NODE = "/pf_tracker"
BOX, STATUS = f"{NODE}/box", f"{NODE}/status"
PARTICLES, OVERLAY = f"{NODE}/particles", f"{NODE}/overlay"
ERROR = 2
Values = Mapping[str, str | float | int]


class TopicBag:
    """Writes the node's topics into an MCAP file, logged when their images were. Needs rosbags.

    Attributes:
        topics: Name to type.

    Args:
        path: The file, made anew.
        preset: As the status names it.

    Raises:
        FootageError: rosbags is missing.
        OSError: It cannot be written.
    """

    topics: ClassVar[Mapping[str, str]] = {
        BOX: GROUND_TRUTH_TYPE,
        STATUS: STATUS_TYPE,
        PARTICLES: PARTICLES_TYPE,
        OVERLAY: IMAGE_TYPE,
    }

    def __init__(self, path: Path, preset: str) -> None:
        self._preset = preset
        self._last_state = "idle"
        self._writer = BagWriter(path)
        self._writer.__enter__()
        for topic, message_type in self.topics.items():
            self._writer.add_topic(topic, message_type)

    def write(self, tracked: Tracked) -> None:
        """Write what the node would publish for a frame."""
        frame = tracked.frame
        where: dict[str, Any] = {"frame_id": frame.frame_id, "log_time": frame.time}
        self._write_targets(tracked, where)
        if tracked.state != "skipped":
            self._last_state = tracked.state
            self._writer.write_image(OVERLAY, frame.stamp, tracked.draw(), **where)
        self._writer.write_statuses(STATUS, frame.stamp, self._statuses(tracked), **where)

    def close(self) -> None:
        """Finish the file."""
        self._writer.__exit__(None, None, None)

    def discard(self) -> None:
        """Give the file up."""
        error = InterruptedError()
        self._writer.__exit__(type(error), error, None)

    def _write_targets(self, tracked: Tracked, where: dict[str, Any]) -> None:
        """Write what is published of the target."""
        assert isinstance(tracked, TrackedFrame)
        stamp, estimate = tracked.frame.stamp, tracked.estimate
        if tracked.box is not None:
            self._writer.write_box(BOX, stamp, tracked.box, **where)
        if estimate is not None:
            boxes, weights = estimate.particle_boxes, estimate.weights
            self._writer.write_particles(PARTICLES, stamp, boxes, weights, **where)

    def _statuses(self, tracked: Tracked) -> list[Status]:
        """What is told of the frame."""
        assert isinstance(tracked, TrackedFrame)
        known = estimate_values(tracked.estimate) if tracked.estimate else {}
        values = self._values(tracked, known, tracked.problem)
        return [Status(NODE, self._level(tracked), self._text(tracked), values)]

    def _level(self, tracked: TrackedFrame) -> int:
        return ERROR if tracked.outcome == "refused" else SEVERITIES[self._last_state]

    @staticmethod
    def _text(tracked: TrackedFrame) -> str:
        if tracked.state == "skipped":
            return tracked.problem or f"not looked at: {tracked.outcome}"
        return DESCRIPTIONS[tracked.state]

    def _values(self, tracked: Tracked, known: Values, error: str) -> Values:
        """What the status of the frame holds, with what is known of the target."""
        values: dict[str, str | float | int] = {"frame": tracked.outcome, "state": tracked.state}
        if tracked.state == "skipped":
            values["last_state"] = self._last_state
        values |= known
        values["processing_time_ms"] = 1e3 * tracked.seconds
        values["lost_share"] = 0.0
        values["preset"] = self._preset
        values["last_error"] = error
        return values
