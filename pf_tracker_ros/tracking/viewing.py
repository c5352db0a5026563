"""A frame as the cues look at it: where the target is searched, and the maps that cover it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues import CueFusion, FrameMaps
from pf_tracker_ros.cues.fusion import Powers
from pf_tracker_ros.filter import ProposalParameters
from pf_tracker_ros.tracking.search import Search


class Frame(NamedTuple):
    """A frame at hand, and what its measurement takes beside the target.

    Attributes:
        image: (H, W, 3) BGR or (H, W).
        interval: Seconds since the last one, as far as a prediction reaches.
        foreground: As in `FrameMaps`.
        powers: Of the cues.
        generator: Source of randomness.
    """

    image: NDArray[np.uint8]
    interval: float
    foreground: tuple[NDArray[np.uint8], int] | None
    powers: Powers
    generator: np.random.Generator

    @property
    def size(self) -> tuple[int, int]:
        """(width, height), pixels."""
        return self.image.shape[1], self.image.shape[0]


class Viewer:
    """Makes the maps that the cues read.

    Args:
        fusion: The cues.
        proposal: How far around a place is searched.
        working_size: See `TrackerParameters`.
    """

    def __init__(self, fusion: CueFusion, proposal: ProposalParameters, working_size: int) -> None:
        self._fusion = fusion
        self._proposal = proposal
        self._working_size = working_size

    def search(self, frame: Frame, place: NDArray[np.float64]) -> Search | None:
        """A search around a (4,) box; None if there is to be none."""
        if self._proposal.search_share == 0.0:
            return None
        return Search(place, self._proposal, frame.size)

    def maps(
        self,
        frame: Frame,
        boxes: NDArray[np.float64],
        target_box: NDArray[np.float64],
        search: Search | None,
    ) -> FrameMaps:
        """Maps that cover (N, 4) boxes and all that is searched.

        Args:
            frame: At hand.
            boxes: Pixels.
            target_box: (4,) whose size decides how far the image is reduced.
            search: None without one.
        """
        target_size = math.sqrt(target_box[2] * target_box[3])
        place = search.place if search else None
        if place is None and self._fusion.looks_in_one_size:
            place = boxes.mean(axis=0)
        return FrameMaps(
            frame.image,
            search.covered(boxes) if search else boxes,
            math.ceil(target_size / self._working_size),
            self._fusion.reach,
            foreground=frame.foreground,
            place=place,
        )
