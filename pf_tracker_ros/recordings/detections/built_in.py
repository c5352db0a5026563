"""Detections of a built-in detector; the tracker waits for each output."""

from __future__ import annotations

from collections.abc import Iterator

from pf_tracker_ros.background import UPDATE_EVERY
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.recordings.detections.source import DetectionSource, DetectorOutput
from pf_tracker_ros.recordings.errors import RecordingError
from pf_tracker_ros.recordings.recording import RecordedFrame
from pf_tracker_ros.targets.built_in_detectors import DETECTORS, DetectorThread
from pf_tracker_ros.targets.session import DROPPED_ARRIVALS, Outcome

_FINDS = {
    "people": "people at least 100 px high",
    "motion": (
        "moving objects in front of a static camera, after it has learned the background from its "
        f"first {UPDATE_EVERY} frames"
    ),
}


class BuiltInDetector(DetectionSource):
    """Runs a detector on the same frames as the node; see `DetectionSource`.

    The detections of a frame arrive before the next frame, so they do not depend on the clock.

    Args:
        name: A key of `DETECTORS`.
        rate: Largest number of processed frames per second of the recording.

    Raises:
        RecordingError: The detector is not available.
    """

    def __init__(self, name: str, rate: float) -> None:
        self._name = name
        self._frame_count = self._last_frame = self._detection_count = 0
        try:
            detector = DETECTORS.make(name, DETECTORS.parameters_of(name)())
            self._thread = DetectorThread(detector, rate)
        except ValueError as error:
            raise RecordingError(str(error)) from error

    @property
    def warning(self) -> str:
        """That there were no detections, or empty."""
        if self._detection_count:
            return ""
        finds = f"; it finds {_FINDS[self._name]}" if self._name in _FINDS else ""
        return (
            f"the detector '{self._name}' found nothing in {counted(self._frame_count, 'frame')}"
            f"{finds}; raise --detector-rate to process more frames"
        )

    def detections_before(self, frame: RecordedFrame) -> Iterator[DetectorOutput]:  # noqa: D102
        try:
            result = self._thread.take(wait=True)
        except Exception as error:
            # The detector may raise anything, on an earlier frame than this one.
            yield DetectorOutput(
                None,
                error=f"the detector '{self._name}' failed in frame {self._last_frame}: {error}",
            )
        else:
            if result is not None:
                self._detection_count += len(result.detections)
                yield DetectorOutput(result.detections, result.stamp)

    def on_frame(self, frame: RecordedFrame, outcome: Outcome) -> None:  # noqa: D102
        if frame.image is None or outcome.frame in DROPPED_ARRIVALS:
            return
        if self._thread.offer(frame.image, frame.stamp):
            self._frame_count, self._last_frame = self._frame_count + 1, frame.index

    def close(self) -> None:  # noqa: D102
        self._thread.close()
