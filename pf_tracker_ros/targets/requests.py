"""What waits for frames: targets that were drawn, detections; and the kind of images that come."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.detections import Detections
from pf_tracker_ros.targets.out_of_sequence import StampedDetections
from pf_tracker_ros.tracking.frame_clock import is_due
from pf_tracker_ros.tracking.scaling import same_aspect_ratio, scaled_box, size_of


class ManualTarget(NamedTuple):
    """A target that somebody drew.

    Attributes:
        box: Pixels.
        label: What it is.
        stamp: Of the frame that it was drawn on, nanoseconds; 0 for the next one.
        on_mismatch: Whether the image before was refused, since it fits no target.
        image_size: (width, height) of that frame, pixels; None before it began.
        is_selected: Whether it is to be the selected target.
        has_waited: Whether it has waited for a frame with which time goes back to it.
    """

    box: Box
    label: str
    stamp: int
    on_mismatch: bool = False
    image_size: tuple[int, int] | None = None
    is_selected: bool = False
    has_waited: bool = False

    def redraw(self, image: NDArray[np.generic], *, is_selected: bool) -> ManualTarget:
        """The same, drawn on another image; its box is scaled if that has the same aspect ratio."""
        size, box = self.image_size, self.box
        if size is not None and same_aspect_ratio(size, size_of(image)):
            box = scaled_box(box, size, size_of(image))
        return ManualTarget(box, self.label, 0, is_selected=is_selected)


# The oldest beyond are dropped.
MAX_QUEUED_DETECTIONS = 20


class DetectionQueue:
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
        if len(self._answers) > MAX_QUEUED_DETECTIONS:
            del self._answers[0]
            self._dropped += 1

    def due(self, stamp: int) -> list[StampedDetections]:
        """Those that count with a frame; they are kept."""
        return [one for one in self._answers if is_due(one.stamp, stamp)]

    def discard_due(self, stamp: int) -> None:
        """Forget those that count with a frame."""
        self._answers = [one for one in self._answers if not is_due(one.stamp, stamp)]

    def discard_where(self, is_meant: Callable[[int], bool]) -> tuple[str, ...]:
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

    def pop_dropped_message(self) -> tuple[str, ...]:
        """A sentence on those that were dropped since it was asked last; none without any."""
        count, self._dropped = self._dropped, 0
        if not count:
            return ()
        return (
            f"{count} of the detector's answers left out: {MAX_QUEUED_DETECTIONS} at most wait for a frame; "
            "let frames come, and the detector give each the stamp of the image that it saw",
        )


# So many images in a row that fit no target of a detector's: the camera is another one.
_MOST_MISFITS = 10
# A target drawn on an image that was refused begins on one so much later, nanoseconds.
_SUBSTITUTE_WITHIN = NANOSECONDS


class ImageFormatGuard:
    """Knows what images the targets were followed in, and those in a row that fit none of them."""

    def __init__(self) -> None:
        # Of the last image that was accepted, in words, and its stamp.
        self._name, self._stamp = "", 0
        # Stamp of the last image of another size or kind than those since; 0 if there was none.
        self._others_until = 0
        # Images in a row that fit no target, and the earliest of their stamps.
        self._misfits = self._misfits_since = 0

    @property
    def is_mismatched(self) -> bool:
        """Whether the last image fits no target."""
        return self._misfits > 0

    @property
    def is_new_format(self) -> bool:
        """Whether so many images in a row fit no target that others will not come."""
        return self._misfits >= _MOST_MISFITS

    def accept(self, frame: Frame) -> None:
        """Take the kind of a frame's image for that of the targets, which are followed into it."""
        name, stamp = _name_of(frame.image), frame.stamp
        if stamp < self._stamp:
            self._others_until = 0
        elif self._name and name != self._name:
            self._others_until = self._stamp
        self._name, self._stamp = name, stamp

    def is_before_change(self, stamp: int) -> bool:
        """Whether a stamp is of the time when the images were of another size or kind."""
        return 0 < stamp <= self._others_until

    def check_manual_target(self, drawn: ManualTarget) -> None:
        """Refuse a target that was drawn on an image of another size or kind than those of now.

        Raises:
            ValueError: It was.
        """
        if self.is_before_change(drawn.stamp):
            raise ValueError(
                f"it was drawn on an image of another size or kind than the last one, {self._name}"
            )

    def count_match(self) -> None:
        """Count an image that the targets can go on with, or that all begins anew with."""
        self._misfits = 0

    def count_mismatch(self, stamp: int) -> None:
        """Count an image that fits no target.

        Args:
            stamp: Of the image, nanoseconds.
        """
        self._misfits_since = min(self._misfits_since, stamp) if self._misfits else stamp
        self._misfits += 1

    def is_on_mismatched_image(self, drawn: ManualTarget, stamp: int) -> bool:
        """Whether a target was drawn on an image that fits no target.

        Args:
            drawn: The target.
            stamp: Of the last such image, nanoseconds.
        """
        if drawn.stamp == 0:
            return drawn.on_mismatch
        return self._misfits_since <= drawn.stamp and is_due(drawn.stamp, stamp)

    def moved_to_current(self, requested: Sequence[ManualTarget], stamp: int) -> list[ManualTarget]:
        """Targets that were asked for, those of images that were refused on the one at hand.

        Only those that were drawn a short time before it.

        Args:
            requested: All that were asked for.
            stamp: Of the image at hand, nanoseconds.
        """
        return [
            one._replace(stamp=0)
            if self.is_on_mismatched_image(one, stamp) and stamp - one.stamp <= _SUBSTITUTE_WITHIN
            else one
            for one in requested
        ]

    def mismatch_message(self, image: NDArray[np.generic]) -> str:
        """Why an image is refused that fits no target."""
        return (
            f"image is {_name_of(image)}, but those that the targets were followed in were "
            f"{self._name}"
        )


def ended_message(ids: Iterable[int]) -> str:
    """What is told of targets that end because another was drawn on images that fit none."""
    return (
        f"ended: {', '.join(map(str, ids))}; a target was drawn on images of another size or kind, "
        "and all begins anew with them"
    )


def _name_of(image: NDArray[np.generic]) -> str:
    return f"{image.shape} {image.dtype}"
