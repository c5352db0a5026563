"""Looking for a target that is out of sight where it was last seen, and all over the image."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, are_same_place, as_box, relative_center_distances
from pf_tracker_ros.cues import CueFusion
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import declared
from pf_tracker_ros.tracking.assessment import Assessment, Confidence
from pf_tracker_ros.tracking.filter_state import FilterState
from pf_tracker_ros.tracking.measurement import Measurement, SearchingMeasurer

# Windows overlap by half, so that the target is near enough to the middle of one of them.
_OVERLAP = 0.5
# Confidence that what is found must exceed to be taken for the target.
_ACCEPT_ABOVE = 0.84
# Every how many frames the place where the target was last seen is looked at.
_REVISIT_INTERVAL = 3
# Steps of this share of a whole row of places visit it evenly, neighbors far apart in time.
_GOLDEN_RATIO = (math.sqrt(5.0) - 1.0) / 2.0


@dataclass(frozen=True)
class RedetectionParameters:
    """Looking elsewhere for a target that is out of sight."""

    windows: int = declared(
        1,
        "Windows of the image, beside the one around the last estimate, that are searched in each "
        "frame while the target is lost, one after another all over the image (405 cover 1920 x "
        "1080 for a target of 40 px); each costs about as much as tracking does, or twice where "
        "something looks like the target. While it is occluded or lost, also one around the place "
        "where it was last seen, every third frame, unless the estimate is still there. 0 searches "
        "nowhere else. Several targets are looked for by their colors, "
        "all over the image at once, and any number but 0 means that.",
        minimum=0,
        maximum=100,
    )


def window_centers(
    image_size: tuple[int, int], side: float, first: int, count: int
) -> NDArray[np.float64]:
    """(count, 2) centers, pixels, of the next windows to look at.

    The windows cover the image and are visited over and over, all before any is visited again, each
    far from the one before.

    Args:
        image_size: (width, height), pixels.
        side: Of a window, pixels.
        first: Number of windows that were looked at before.
        count: How many to look at.
    """
    across, down = (max(math.ceil(length / (side * (1.0 - _OVERLAP))), 1) for length in image_size)
    total = across * down
    stride = max(round(total * _GOLDEN_RATIO), 1)
    while math.gcd(stride, total) > 1:
        stride += 1
    number = np.arange(first, first + count) * stride % total
    places = np.stack([number % across, number // across], axis=1) + 0.5
    return places * np.array([image_size[0] / across, image_size[1] / down])


class Candidate(NamedTuple):
    """What is likeliest in a window.

    Attributes:
        box: (4,) x, y, width, height in pixels.
        confidence: That it is the target, 0 to 1.
    """

    box: NDArray[np.float64]
    confidence: float


class Redetector:
    """Looks for a target that is out of sight where the particles are not.

    A window is searched by the target's templates, at the size that it had when it was last seen.
    What is likeliest there is looked at again with the window around it, and taken for the target
    if that look is confident: a look-alike seldom stands out in both.

    Args:
        measurer: Looks into a window.
        fusion: The cues.
        confidence: Judges what is found.
        parameters: How many windows.
        side: Of a window, box sizes.
        doubtful_below: Confidence of a first look below which there is no second.
    """

    def __init__(
        self,
        measurer: SearchingMeasurer,
        fusion: CueFusion,
        confidence: Confidence,
        parameters: RedetectionParameters,
        *,
        side: float,
        doubtful_below: float,
    ) -> None:
        self._measurer = measurer
        self._fusion = fusion
        self._confidence = confidence
        self._windows = parameters.windows
        self._side = side
        self._doubtful_below = doubtful_below

    def find(
        self,
        target: FilterState,
        measured: Measurement,
        assessment: Assessment,
        everywhere: bool,
        tracked_confidence: float = 0.0,
    ) -> Candidate | None:
        """The target, if it is in one of the windows whose turn it is.

        Args:
            target: As it was before this frame.
            measured: In this frame.
            assessment: The box that was looked around already, and what is known to be something else.
            everywhere: Look all over the image, and not only where the target was last seen.
            tracked_confidence: Confidence that it is in that box, which has to be exceeded elsewhere; 0 where it
                is not.
        """
        if self._windows == 0:
            return None
        box, seen = assessment.box, np.array(target.last_seen_box)
        size = seen[2:]
        centers: NDArray[np.float64] = np.empty((0, 2))
        is_elsewhere = (np.abs(box[:2] - seen[:2]) > size / 2).any()
        if is_elsewhere and target.frames_since_seen % _REVISIT_INTERVAL == 0:
            centers = seen[None, :2] + size / 2
        if everywhere:
            side = self._side * math.sqrt(size[0] * size[1])
            before = target.followed_frames * self._windows
            elsewhere = window_centers(measured.frame.size, side, before, self._windows)
            centers = np.vstack([centers, elsewhere])
        needed = max(_ACCEPT_ABOVE, tracked_confidence)
        best = Candidate(seen, needed)
        for center in centers:
            place, known = np.hstack([center - size / 2, size]), assessment.known_distractor
            look = self.search_around(target, measured.frame, measured.cue_weights, place, known)
            if look.confidence >= self._doubtful_below:
                look = self.search_around(
                    target, measured.frame, measured.cue_weights, look.box, known
                )
                if tracked_confidence and (np.abs(look.box[:2] - box[:2]) <= size / 2).all():
                    continue
                best = max(best, look, key=lambda one: one.confidence)
        return best if best.confidence > needed else None

    def known_distractor(self, target: FilterState, measured: Measurement) -> Box | None:
        """See `FilterState.known_distractor`, in the frame in which the target goes out of sight.

        It is what was likeliest beside the target a frame ago, if it would be taken for that now.
        Not if it is more like the target than what was followed, or not clear of that: then it may
        be the target.

        Args:
            target: As it was before this frame.
            measured: In this frame.
        """
        if self._windows == 0 or target.second_peak is None:
            return None
        place = np.array(target.second_peak)
        look = self.search_around(target, measured.frame, measured.cue_weights, place)
        if not self._doubtful_below <= look.confidence < target.estimate.confidence:
            return None
        is_clear = relative_center_distances(look.box, target.estimate.box) >= 1.0
        return (
            as_box(look.box) if is_clear and are_same_place(look.box, target.second_peak) else None
        )

    def search_around(
        self,
        target: FilterState,
        frame: Frame,
        cue_weights: Mapping[str, float],
        place: NDArray[np.float64],
        but: Box | None = None,
    ) -> Candidate:
        """What is likeliest in a window, and how likely it is the target.

        Args:
            target: Looked for.
            frame: Looked at.
            cue_weights: Of the cues.
            place: (4,) box that the window is around.
            but: What is there is passed over.
        """
        search, region = self._measurer.search_window(frame, place)
        strengths = self._fusion.responses_on_grid(region, search.grid, target.templates)
        if not strengths:
            return Candidate(place, 0.0)
        likelihood = self._fusion.search(
            region, search.grid, strengths, target.templates, cue_weights
        )
        if but is not None:
            likelihood[are_same_place(search.boxes, but)] = -np.inf
        best = int(np.argmax(likelihood))
        if likelihood[best] == -np.inf:
            return Candidate(place, 0.0)
        box = search.boxes[best]
        seen = self._fusion.observe(region, box)
        match = self._fusion.match(seen, target.templates)
        return Candidate(box, self._confidence.assess(target, seen, match))
