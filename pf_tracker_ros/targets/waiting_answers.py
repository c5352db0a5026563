"""What detectors said of frames that are still to come."""

from __future__ import annotations

from collections.abc import Callable

from pf_tracker_ros.plurals import counted
from pf_tracker_ros.targets.detections import Detections
from pf_tracker_ros.targets.out_of_sequence import StampedDetections
from pf_tracker_ros.tracking.frame_clock import is_due

# The oldest beyond are dropped.
MOST_ANSWERS = 20


class WaitingAnswers:
    """Answers of detectors until their frames come; stamps are in nanoseconds, 0 is unknown."""

    def __init__(self) -> None:
        self._answers: list[StampedDetections] = []
        self._dropped = 0

    def add(self, detections: Detections, stamp: int) -> None:
        """Keep an answer.

        Args:
            detections: Of one frame; their age is not looked at.
            stamp: Of that frame, 0 for the next one.
        """
        self._answers.append(StampedDetections(stamp, detections))
        if len(self._answers) > MOST_ANSWERS:
            del self._answers[0]
            self._dropped += 1

    def due(self, stamp: int) -> list[StampedDetections]:
        """Those that count with a frame; they are kept."""
        return [one for one in self._answers if is_due(one.stamp, stamp)]

    def forget_due(self, stamp: int) -> None:
        """Forget those that count with a frame."""
        self._answers = [one for one in self._answers if not is_due(one.stamp, stamp)]

    def forget_all_of(self, is_meant: Callable[[int], bool]) -> tuple[str, ...]:
        """Forget those of images that were of another size or kind than those of now.

        Args:
            is_meant: Tells by the stamp of an image whether it was.

        Returns:
            A sentence on them, if there are any.
        """
        kept = [one for one in self._answers if not is_meant(one.stamp)]
        count = len(self._answers) - len(kept)
        self._answers = kept
        if not count:
            return ()
        return (
            f"{counted(count, 'answer')} of the detector left out, of images of another size or "
            "kind than those of now",
        )

    def clear(self) -> None:
        """Forget all; how many were dropped is still to be told."""
        self._answers = []

    def tell_dropped(self) -> tuple[str, ...]:
        """A sentence on those that were dropped since it was asked last; none without any."""
        count, self._dropped = self._dropped, 0
        if not count:
            return ()
        return (
            f"{count} of the detector's answers left out: {MOST_ANSWERS} at most wait for a frame; "
            "let frames come, and the detector give each the stamp of the image that it saw",
        )
