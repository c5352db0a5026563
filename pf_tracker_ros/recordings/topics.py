"""The topics that the node would publish, as a bag to play together with the recording."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pf_tracker_ros.footage.bag_writing import BagWriter
from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.localization.located_frame import LocatedFrame
from pf_tracker_ros.localization.position_topics import POSITION_TOPICS, Headers
from pf_tracker_ros.messages import (
    DETECTIONS_3D_TYPE,
    ERROR,
    STATUS_TYPE,
    WARN,
    Status,
    status_message,
)
from pf_tracker_ros.recordings.tracking import TrackedFrame
from pf_tracker_ros.targets.tracked_target import description
from pf_tracker_ros.topics import OUTPUT_TOPICS, StatusValues
from pf_tracker_ros.tracking.estimate import SEVERITIES

NODE = "/pf_tracker"
LOCALIZER = "/localizer"
_STATUS = f"{NODE}/status"
# rosbags has no definitions of vision_msgs.
_POSITION_TOPICS = tuple(
    topic for topic in POSITION_TOPICS if topic.message_type != DETECTIONS_3D_TYPE
)


class TopicBag:
    """Writes the node's topics into an MCAP file, with the log times of the images. Needs rosbags.

    Attributes:
        topics: Name to type.

    Args:
        path: Of the new file.
        preset: As in the status.
        max_targets: As in the tracker.
        localizer: Parameters of the localizer, for the topics of targets in meters; None without.

    Raises:
        FootageError: rosbags is missing.
        OSError: It cannot be written.
    """

    note = ""

    def __init__(
        self,
        path: Path,
        preset: str,
        max_targets: int,
        localizer: LocalizerParameters | None = None,
    ) -> None:
        names = ["box", *(["boxes"] if max_targets > 1 else []), "particles", "overlay"]
        self._outputs = {f"{NODE}/{one.name}": one for one in OUTPUT_TOPICS if one.name in names}
        types = {name: output.message_type for name, output in self._outputs.items()}
        types[_STATUS] = STATUS_TYPE
        self._localizer = localizer
        if localizer:
            types |= {f"{LOCALIZER}/{one.name}": one.message_type for one in _POSITION_TOPICS}
            types[f"{LOCALIZER}/status"] = STATUS_TYPE
        self.topics: Mapping[str, str] = types
        self._preset = preset
        self._last_state = "idle"
        self._writer = BagWriter(path)
        self._writer.__enter__()
        for topic, message_type in self.topics.items():
            self._writer.add_topic(topic, message_type)

    def write(self, tracked: TrackedFrame) -> None:
        """Write the messages of a frame."""
        frame, new = tracked.frame, self._writer.new
        header = self._writer.header(frame.stamp, frame.frame_id)
        messages = {}
        if tracked.state != "skipped":
            self._last_state = tracked.state
            for topic, output in self._outputs.items():
                messages[topic] = output.build(new, header, tracked)
        statuses = [self._status(tracked), *tracked.target_statuses(NODE)]
        messages[_STATUS] = status_message(new, header, statuses)
        if self._localizer and tracked.located:
            messages |= self._position_messages(tracked.located, header, self._localizer)
        for topic, message in messages.items():
            if message is not None:
                self._writer.write_message(topic, frame.log_time, message)

    def _position_messages(
        self, located: LocatedFrame, header: Any, parameters: LocalizerParameters
    ) -> dict[str, Any]:
        new = self._writer.new
        headers = Headers(self._writer.header(located.frame.stamp, parameters.fixed_frame), header)
        messages = {
            f"{LOCALIZER}/{topic.name}": topic.build(new, headers, located)
            for topic in _POSITION_TOPICS
        }
        statuses = located.statuses(LOCALIZER)
        return {**messages, f"{LOCALIZER}/status": status_message(new, header, statuses)}

    def close(self) -> None:
        """Complete the file."""
        self._writer.__exit__(None, None, None)

    def discard(self) -> None:
        """Close the incomplete file."""
        error = InterruptedError()
        self._writer.__exit__(type(error), error, None)

    def _status(self, tracked: TrackedFrame) -> Status:
        """The status of the tracker as a whole."""
        problems = [tracked.problem] if tracked.problem else []
        problems += tracked.warnings
        level = SEVERITIES[self._last_state]
        if problems:
            level = max(level, ERROR if tracked.problem else WARN)
        text = "; ".join(problems) or description(tracked.targets, tracked.selected)
        values: StatusValues = {"frame": tracked.outcome, "state": tracked.state}
        if tracked.state == "skipped":
            values["last_state"] = self._last_state
            text = text if problems else f"frame skipped: {tracked.outcome}"
        else:
            values |= tracked.values
        values["processing_time_ms"] = 1e3 * tracked.seconds
        values["frame_loss_rate"] = 0.0
        values["preset"] = self._preset
        values["last_error"] = problems[-1] if problems else ""
        return Status(NODE, level, text, values)
