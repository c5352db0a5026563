"""The interface of detection sources: what a detector has reported between two frames."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from pf_tracker_ros.recordings.recording import RecordedFrame
from pf_tracker_ros.targets.detections import Detections
from pf_tracker_ros.targets.session import Outcome


class DetectorOutput(NamedTuple):
    """One output of a detector, as the node would receive it.

    Attributes:
        detections: Of one frame; None on an error.
        stamp: Of this frame, nanoseconds; 0 means the next frame.
        error: Why there are no detections, or empty.
    """

    detections: Detections | None
    stamp: int = 0
    error: str = ""


class DetectionSource:
    """Source of detections for one pass through a recording; the base class has none."""

    @property
    def warning(self) -> str:
        """Warning at the end of the recording, or empty."""
        return ""

    def detections_before(self, frame: RecordedFrame) -> Iterator[DetectorOutput]:
        """Yield the outputs since the previous frame.

        Raises:
            FootageError: The recording can be read only in part.
        """
        return iter(())

    def on_frame(self, frame: RecordedFrame, outcome: Outcome) -> None:
        """Receive a tracked frame."""

    def finish(self, frame_count: int) -> None:
        """Check the detections after the last frame. Later detections are dropped.

        Raises:
            RecordingError: The detections belong to another recording.
        """

    def close(self) -> None:
        """Release its resources."""
