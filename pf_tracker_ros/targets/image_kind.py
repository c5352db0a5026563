"""The kind of images that the targets are of, and what of images of another one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames import Frame
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.drawn import Drawn
from pf_tracker_ros.tracking.frame_clock import is_due

# So many images in a row that fit no target of a detector's: the camera is another one.
_MOST_MISFITS = 10
# A target drawn on an image that was refused begins on one so much later, nanoseconds.
_SUBSTITUTE_WITHIN = NANOSECONDS


class ImageKind:
    """Knows what images the targets were followed in, and those in a row that fit none of them."""

    def __init__(self) -> None:
        # Of the last image that was accepted, in words, and its stamp.
        self._name, self._stamp = "", 0
        # Stamp of the last image of another size or kind than those since; 0 if there was none.
        self._others_until = 0
        # Images in a row that fit no target, and the earliest of their stamps.
        self._misfits = self._misfits_since = 0

    @property
    def is_doubtful(self) -> bool:
        """Whether the last image fits no target."""
        return self._misfits > 0

    @property
    def is_another(self) -> bool:
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

    def is_of_others(self, stamp: int) -> bool:
        """Whether a stamp is of the time when the images were of another size or kind."""
        return 0 < stamp <= self._others_until

    def check_drawn(self, drawn: Drawn) -> None:
        """Refuse a target that was drawn on an image of another size or kind than those of now.

        Raises:
            ValueError: It was.
        """
        if self.is_of_others(drawn.stamp):
            raise ValueError(
                f"it was drawn on an image of another size or kind than the last one, {self._name}"
            )

    def fit(self) -> None:
        """Count an image that the targets can go on with, or that all begins anew with."""
        self._misfits = 0

    def misfit(self, stamp: int) -> None:
        """Count an image that fits no target.

        Args:
            stamp: Of the image, nanoseconds.
        """
        self._misfits_since = min(self._misfits_since, stamp) if self._misfits else stamp
        self._misfits += 1

    def is_of_misfits(self, drawn: Drawn, stamp: int) -> bool:
        """Whether a target was drawn on an image that fits no target.

        Args:
            drawn: The target.
            stamp: Of the last such image, nanoseconds.
        """
        if drawn.stamp == 0:
            return drawn.on_misfits
        return self._misfits_since <= drawn.stamp and is_due(drawn.stamp, stamp)

    def brought_over(self, requested: Sequence[Drawn], stamp: int) -> list[Drawn]:
        """Targets that were asked for, those of images that were refused on the one at hand.

        Only those that were drawn a short time before it.

        Args:
            requested: All that were asked for.
            stamp: Of the image at hand, nanoseconds.
        """
        return [
            one._replace(stamp=0)
            if self.is_of_misfits(one, stamp) and stamp - one.stamp <= _SUBSTITUTE_WITHIN
            else one
            for one in requested
        ]

    def refusal(self, image: NDArray[np.generic]) -> str:
        """Why an image is refused that fits no target."""
        return (
            f"image is {_name_of(image)}, but those that the targets were followed in were "
            f"{self._name}"
        )


def ended_for_others(ids: Iterable[int]) -> str:
    """What is told of targets that end because another was drawn on images that fit none."""
    return (
        f"ended: {', '.join(map(str, ids))}; a target was drawn on images of another size or kind, "
        "and all begins anew with them"
    )


def _name_of(image: NDArray[np.generic]) -> str:
    return f"{image.shape} {image.dtype}"
