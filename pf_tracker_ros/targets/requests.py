"""Manual targets and detections that wait for their frames, and the guard of the image format."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.detections import Detections, StampedDetections
from pf_tracker_ros.tracking.frame_clock import is_due
from pf_tracker_ros.tracking.scaling import same_aspect_ratio, scaled_box, size_of


class ManualTarget(NamedTuple):
    """A target that a user drew or a program requested.

    Attributes:
        label: Its class, or an empty text.
        stamp: Of the frame that it was drawn on, nanoseconds; 0 for the next one.
        on_mismatch: Whether it was requested after images of another format had been rejected.
        image_size: (width, height) of the image that it started on, pixels; None before.
        is_selected: Whether it becomes the selected target.
        has_waited: Whether its frame was missing once, and it waits for a jump back to it.
    """

    box: Box
    label: str
    stamp: int
    on_mismatch: bool = False
    image_size: tuple[int, int] | None = None
    is_selected: bool = False
    has_waited: bool = False

    def redraw(self, image: NDArray[np.generic], *, is_selected: bool) -> ManualTarget:
        """The same on another image; the box is scaled if the aspect ratio is equal."""
        size, box = self.image_size, self.box
        if size is not None and same_aspect_ratio(size, size_of(image)):
            box = scaled_box(box, size, size_of(image))
        return ManualTarget(box, self.label, 0, is_selected=is_selected)


# Beyond this number, the oldest are dropped.
MAX_QUEUED_DETECTIONS = 20


class DetectionQueue:
    """Detections that wait for their frames; stamps are in nanoseconds, 0 is unknown."""

    def __init__(self) -> None:
        self._waiting: list[StampedDetections] = []
        self._dropped = 0

    def add(self, detections: Detections, stamp: int) -> None:
        """Queue the detections of the frame of a stamp, 0 for the next; their age is ignored."""
        self._waiting.append(StampedDetections(detections, stamp))
        if len(self._waiting) > MAX_QUEUED_DETECTIONS:
            del self._waiting[0]
            self._dropped += 1

    def due(self, stamp: int) -> list[StampedDetections]:
        """The detections of frames up to this one; they stay in the queue."""
        return [one for one in self._waiting if is_due(one.stamp, stamp)]

    def discard_due(self, stamp: int) -> None:
        """Discard the detections of frames up to this one."""
        self._waiting = [one for one in self._waiting if not is_due(one.stamp, stamp)]

    def discard_where(self, is_other_format: Callable[[int], bool]) -> tuple[str, ...]:
        """Discard detections of images of a former size or type; a message if there were any."""
        kept = [one for one in self._waiting if not is_other_format(one.stamp)]
        count = len(self._waiting) - len(kept)
        self._waiting = kept
        if not count:
            return ()
        return (
            f"{counted(count, 'detector result')} left out: the images had another size or type",
        )

    def clear(self) -> None:
        """Discard all; the message on dropped ones stays pending."""
        self._waiting = []

    def pop_dropped_message(self) -> tuple[str, ...]:
        """A message if any were dropped for their number since the last call."""
        count, self._dropped = self._dropped, 0
        if not count:
            return ()
        return (
            f"{counted(count, 'detector result')} left out: at most {MAX_QUEUED_DETECTIONS} wait "
            "for their frames; publish images, and stamp detections with that of their image",
        )


# After this number of mismatched images in a row, the camera is taken for another one.
_MAX_MISMATCHES = 10
# A target drawn on a rejected image may start on one at most this much later, nanoseconds.
_SUBSTITUTE_WITHIN = NANOSECONDS


class ImageFormatGuard:
    """The image size and type of the tracked targets, and the mismatched images in a row."""

    def __init__(self) -> None:
        # Format and stamp of the last accepted image.
        self._format, self._stamp = "", 0
        # Stamp of the last image of the former format; 0 if there was none.
        self._former_until = 0
        # Number of mismatched images in a row, and the earliest of their stamps.
        self._mismatches = self._mismatched_since = 0

    @property
    def is_mismatched(self) -> bool:
        """Whether the last image had another format than the targets."""
        return self._mismatches > 0

    @property
    def is_new_format(self) -> bool:
        """Whether the mismatched images are enough to take the camera for another one."""
        return self._mismatches >= _MAX_MISMATCHES

    def accept(self, frame: Frame) -> None:
        """Record the format of a frame that the targets are tracked in."""
        image_format, stamp = _format_of(frame.image), frame.stamp
        if stamp <= self._stamp:
            self._former_until = 0
        elif self._format and image_format != self._format:
            self._former_until = self._stamp
        self._format, self._stamp = image_format, stamp

    def is_before_change(self, stamp: int) -> bool:
        """Whether a stamp is of the time before the last change of format."""
        return 0 < stamp <= self._former_until

    def check_manual_target(self, manual: ManualTarget) -> None:
        """Check that a manual target was drawn on an image of the present format.

        Raises:
            ValueError: It was drawn on an image of the former format.
        """
        if self.is_before_change(manual.stamp):
            raise ValueError(
                "it was drawn on an image of another size or type; draw it on one like the last, "
                f"{self._format}"
            )

    def count_match(self) -> None:
        """Reset the count: the image fits, or the tracker was reset to its format."""
        self._mismatches = 0

    def count_mismatch(self, stamp: int) -> None:
        """Count an image of another format."""
        self._mismatched_since = min(self._mismatched_since, stamp) if self._mismatches else stamp
        self._mismatches += 1

    def is_on_mismatched_image(self, manual: ManualTarget, stamp: int) -> bool:
        """Whether a manual target was drawn on a mismatched image; `stamp` is that of the last."""
        if manual.stamp == 0:
            return manual.on_mismatch
        return self._mismatched_since <= manual.stamp and is_due(manual.stamp, stamp)

    def moved_to_current(self, requested: Sequence[ManualTarget], stamp: int) -> list[ManualTarget]:
        """The targets, those of recent mismatched images moved to the current one, of a stamp."""
        return [
            one._replace(stamp=0)
            if self.is_on_mismatched_image(one, stamp) and stamp - one.stamp <= _SUBSTITUTE_WITHIN
            else one
            for one in requested
        ]

    def mismatch_message(self, image: NDArray[np.generic]) -> str:
        """The error message for an image of another format."""
        return (
            f"image is {_format_of(image)}, but the targets are tracked in images of {self._format}"
        )


def ended_message(ids: Iterable[int]) -> str:
    """The message on targets that end for one drawn on images of another format."""
    return (
        f"ended: {', '.join(map(str, ids))}; a new target was drawn on images of another size or "
        "type"
    )


def _format_of(image: NDArray[np.generic]) -> str:
    return f"{image.shape} {image.dtype}"
