"""Detections from a topic of the tracked bag."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pf_tracker_ros.footage import FootageError, is_bag
from pf_tracker_ros.footage.bags import read_topic, topics_of_type
from pf_tracker_ros.footage.cdr import deserialize_detections
from pf_tracker_ros.messages import DETECTIONS_TYPE
from pf_tracker_ros.recordings.detections.source import DetectionSource, DetectorOutput
from pf_tracker_ros.recordings.errors import REFUSED, WRONG_DETECTIONS, RecordingError
from pf_tracker_ros.recordings.recording import RecordedFrame
from pf_tracker_ros.targets.detections import check_message_size, detections_from_message


class DetectionTopic(DetectionSource):
    """Detections of a topic, in the recorded order of messages and images; see `DetectionSource`.

    Args:
        path: Of the bag.
        topic: Of type vision_msgs/Detection2DArray.

    Raises:
        RecordingError: There is no such topic, or the recording is not a bag.
        FootageError: The bag cannot be read.
    """

    def __init__(self, path: Path, topic: str) -> None:
        if not is_bag(path):
            raise RecordingError(
                f"--detections-topic applies to bags, and {path} is not a bag; allowed here: "
                "--detections or --detector NAME",
                REFUSED,
            )
        topics = topics_of_type(path, DETECTIONS_TYPE)
        if topic not in topics:
            raise RecordingError(
                f"bag {path} has no topic {topic} of type {DETECTIONS_TYPE}; available: "
                f"{', '.join(topics) or 'none'}",
                WRONG_DETECTIONS,
            )
        self._name = f"bag {path}, topic {topic}"
        self._messages = read_topic(path, topic)
        self._next = next(self._messages, None)
        self._count = 0

    def detections_before(self, frame: RecordedFrame) -> Iterator[DetectorOutput]:  # noqa: D102
        while self._next is not None and self._next[0] <= frame.log_time:
            yield self._convert(self._next[1])
            self._count += 1
            self._next = next(self._messages, None)

    def close(self) -> None:  # noqa: D102
        self._messages.close()

    def _convert(self, octets: bytes) -> DetectorOutput:
        try:
            check_message_size(octets)
        except ValueError as error:
            return DetectorOutput(None, error=f"detections refused: {error}")
        try:
            message = deserialize_detections(octets)
        except FootageError as error:
            raise FootageError(f"{self._name}, message {self._count}: {error}") from error
        return DetectorOutput(detections_from_message(message), message.stamp)
