"""What the node would have published, as a bag to play beside the recording."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pf_tracker_ros.footage.bag_writing import PARTICLES_TYPE, STATUS_TYPE, BagWriter
from pf_tracker_ros.footage.bags import GROUND_TRUTH_TYPE, IMAGE_TYPE
from pf_tracker_ros.recordings.tracking import TrackedFrame
from pf_tracker_ros.recordings.video import overlay
from pf_tracker_ros.tracking.estimate import estimate_values
from pf_tracker_ros.tracking.state_descriptions import DESCRIPTIONS, SEVERITIES

NODE = "/pf_tracker"
BOX, STATUS = f"{NODE}/box", f"{NODE}/status"
PARTICLES, OVERLAY = f"{NODE}/particles", f"{NODE}/overlay"
_TOPICS = {
    BOX: GROUND_TRUTH_TYPE,
    STATUS: STATUS_TYPE,
    PARTICLES: PARTICLES_TYPE,
    OVERLAY: IMAGE_TYPE,
}
_ERROR = 2


class TopicBag:
    """Writes the node's topics into an MCAP file, logged when their images were. Needs rosbags.

    Args:
        path: The file, made anew.
        preset: As the status names it.

    Raises:
        FootageError: rosbags is missing.
        OSError: It cannot be written.
    """

    def __init__(self, path: Path, preset: str) -> None:
        self._preset = preset
        self._last_state = "idle"
        self._writer = BagWriter(path)
        self._writer.__enter__()
        for topic, message_type in _TOPICS.items():
            self._writer.add_topic(topic, message_type)

    def write(self, tracked: TrackedFrame) -> None:
        """Write what the node would publish for a frame."""
        frame, estimate = tracked.frame, tracked.estimate
        where: dict[str, Any] = {"frame_id": frame.frame_id, "log_time": frame.time}
        if tracked.box is not None:
            self._writer.write_box(BOX, frame.stamp, tracked.box, **where)
        if estimate is not None:
            self._writer.write_particles(
                PARTICLES, frame.stamp, estimate.particle_boxes, estimate.weights, **where
            )
        if tracked.state != "skipped":
            self._last_state = tracked.state
            self._writer.write_image(OVERLAY, frame.stamp, overlay(tracked), **where)
        self._writer.write_status(
            STATUS,
            frame.stamp,
            name=NODE,
            level=self._level(tracked),
            text=self._text(tracked),
            values=self._values(tracked),
            **where,
        )

    def close(self) -> None:
        """Finish the file."""
        self._writer.__exit__(None, None, None)

    def discard(self) -> None:
        """Give the file up."""
        error = InterruptedError()
        self._writer.__exit__(type(error), error, None)

    def _level(self, tracked: TrackedFrame) -> int:
        return _ERROR if tracked.outcome == "refused" else SEVERITIES[self._last_state]

    @staticmethod
    def _text(tracked: TrackedFrame) -> str:
        if tracked.state == "skipped":
            return tracked.problem or f"not looked at: {tracked.outcome}"
        return DESCRIPTIONS[tracked.state]

    def _values(self, tracked: TrackedFrame) -> Mapping[str, str | float | int]:
        values: dict[str, str | float | int] = {"frame": tracked.outcome, "state": tracked.state}
        if tracked.state == "skipped":
            values["last_state"] = self._last_state
        if tracked.estimate is not None:
            values |= estimate_values(tracked.estimate)
        values["processing_time_ms"] = 1e3 * tracked.seconds
        values["lost_share"] = 0.0
        values["preset"] = self._preset
        values["last_error"] = tracked.problem
        return values
