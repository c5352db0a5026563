"""Detections of a built-in detector, which here has all the time that it takes."""

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
    "people": "people who are at least 100 px high",
    "motion": (
        "what moves before a camera that stands still, once the first "
        f"{UPDATE_EVERY} frames that it is shown have taught it the background"
    ),
}


class BuiltInDetector(DetectionSource):
    """Shows a detector frames as the node does, and waits for each answer; see `DetectionSource`.

    What it finds in a frame is heard before the next one, so that it depends on no clock.

    Args:
        name: A key of `DETECTORS`.
        rate: Most frames that it looks at in a second of the recording.

    Raises:
        RecordingError: There is no such detector here.
    """

    def __init__(self, name: str, rate: float) -> None:
        self._name = name
        self._shown = self._last_shown = self._found = 0
        try:
            self._thread = DetectorThread(
                DETECTORS.make(name, DETECTORS.parameters_of(name)()), rate
            )
        except ValueError as error:
            raise RecordingError(str(error)) from error

    @property
    def warning(self) -> str:
        """That it found nothing at all, or empty."""
        if self._found:
            return ""
        finds = f"; it finds {_FINDS[self._name]}" if self._name in _FINDS else ""
        return (
            f"the detector '{self._name}' found nothing in {counted(self._shown, 'frame')} that it "
            f"was shown{finds}; --detector-rate shows it more frames"
        )

    def before(self, frame: RecordedFrame) -> Iterator[DetectorOutput]:  # noqa: D102
        try:
            found = self._thread.take(wait=True)
        except Exception as error:
            # Whatever the detector raised: the frame at hand has no part in it.
            yield DetectorOutput(
                None,
                error=f"the detector '{self._name}' failed in frame {self._last_shown}: {error}",
            )
        else:
            if found is not None:
                self._found += len(found.detections)
                yield DetectorOutput(found.detections, found.stamp)

    def after(self, frame: RecordedFrame, outcome: Outcome) -> None:  # noqa: D102
        if frame.image is None or outcome.frame in DROPPED_ARRIVALS:
            return
        if self._thread.offer(frame.image, frame.stamp):
            self._shown, self._last_shown = self._shown + 1, frame.index

    def close(self) -> None:  # noqa: D102
        self._thread.close()
