"""A target that somebody drew, and the image that it was drawn on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.tracking.scaling import is_scaled, scaled_box, size_of


class Drawn(NamedTuple):
    """A target that somebody drew.

    Attributes:
        box: Pixels.
        label: What it is.
        stamp: Of the frame that it was drawn on, nanoseconds; 0 for the next one.
        on_misfits: Whether the image before was refused, since it fits no target.
        image_size: (width, height) of that frame, pixels; None before it began.
        is_selected: Whether it is to be the selected target.
        has_waited: Whether it has waited for a frame with which time goes back to it.
    """

    box: Box
    label: str
    stamp: int
    on_misfits: bool = False
    image_size: tuple[int, int] | None = None
    is_selected: bool = False
    has_waited: bool = False

    def redraw(self, image: NDArray[np.generic], *, is_selected: bool) -> Drawn:
        """The same, drawn on another image; its box is scaled if that has the same aspect ratio."""
        size, box = self.image_size, self.box
        if size is not None and is_scaled(size, size_of(image)):
            box = scaled_box(box, size, size_of(image))
        return Drawn(box, self.label, 0, is_selected=is_selected)
