"""How the tracker of a recording hears of detections."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from pf_tracker_ros.recordings.recording import RecordedFrame
from pf_tracker_ros.targets.detections import Detections
from pf_tracker_ros.targets.session import Outcome


class DetectorOutput(NamedTuple):
    """What a detector said, heard as the node does.

    Attributes:
        detections: Of a frame; None where what it said cannot be taken.
        stamp: Of that frame, nanoseconds; 0 for the next one.
        error: Why it cannot be taken, or empty.
    """

    detections: Detections | None
    stamp: int = 0
    error: str = ""


class DetectionSource:
    """Hears what a detector says, once through a recording; this one hears nothing."""

    @property
    def warning(self) -> str:
        """What there is to tell of the detector at the end, or empty."""
        return ""

    def detections_before(self, frame: RecordedFrame) -> Iterator[DetectorOutput]:
        """What was said since the frame before this one.

        Raises:
            FootageError: The recording cannot be read any further.
        """
        return iter(())

    def on_frame(self, frame: RecordedFrame, outcome: Outcome) -> None:
        """Take what became of a frame."""

    def finish(self, frame_count: int) -> None:
        """Take that a recording has ended, with so many frames; what was said later is not heard.

        Raises:
            RecordingError: What was said is of another recording.
        """

    def close(self) -> None:
        """Let go of what it takes."""
