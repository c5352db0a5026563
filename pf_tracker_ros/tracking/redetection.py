"""Redetection of a target that is out of sight, by its templates.

1. Choose windows: every third frame the one where the target was last seen, and for a lost target
   the next ones of a sequence that covers the image.
2. Search each window for the likeliest box of the last seen size.
3. If the confidence in this box suffices, search again in the window around it: a distractor seldom
   has a high confidence in both.
4. Take the most confident box if it is confident enough (`TrackAssessor`).

Otherwise the likeliest box elsewhere challenges the current one, see `Challenger`: without a claim
that it is the target, the filter goes on from there once it has been likelier for long enough.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, are_same_place, as_box
from pf_tracker_ros.cues import CueFusion
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import declared
from pf_tracker_ros.tracking.assessment import AssessedBox, Assessment, Confidence, log_odds
from pf_tracker_ros.tracking.filter_state import Challenger, FilterState
from pf_tracker_ros.tracking.hints import Standing
from pf_tracker_ros.tracking.measurement import Measurement, SearchingMeasurer

# Overlap of neighboring windows, so that the target is near the center of one of them.
_OVERLAP = 0.5
DOUBTFUL_BELOW = 0.3
"""Confidence below which a box is too unlike the target to be taken for it."""
# Seconds out of sight before another box can challenge the current one, and of the time constant of
# its lead; lead with which it wins; largest change of odds by one frame.
_CHALLENGED_AFTER, _LEAD_TIME, _WINS_ABOVE, _LARGEST_LEAD = 0.5, 0.5, 1.0, 4.0
# Interval of the searches where the target was last seen, frames.
_REVISIT_INTERVAL = 3
# Heights of standing targets that are searched for, in heights of the image.
_SCALES = (0.25, 0.33, 0.43, 0.56, 0.72, 0.94, 1.22, 1.58)
# Stride of the window sequence as a share of its length: consecutive windows are far apart.
_GOLDEN_RATIO = (math.sqrt(5.0) - 1.0) / 2.0

MODES = ("automatic", "ask")


@dataclass(frozen=True)
class RedetectionParameters:
    """Search for a target that is out of sight."""

    windows: int = declared(
        1,
        "Windows of the image that are searched in each frame while the target is lost, besides "
        "the one around the estimate. They take turns to cover the image (405 windows for 1920 x "
        "1080 and a target of 40 px). Each costs as much as tracking, or twice as much where it "
        "contains a distractor. An occluded or lost target is also searched where it was last "
        "seen, every third frame, unless the estimate is there. 0 disables redetection. With "
        "max_targets above 1, any other value enables redetection by appearance instead.",
        minimum=0,
        maximum=100,
    )
    mode: str = declared(
        "automatic",
        "What happens when a lost target seems to be seen again. automatic: it is tracked. ask: it "
        "stays lost, with the candidate in its box, until somebody confirms it by a box on "
        "~/target or a click on ~/click.",
        choices=MODES,
    )


def window_centers(
    image_size: tuple[int, int], side: float, first: int, count: int
) -> NDArray[np.float64]:
    """(count, 2) centers, pixels, of the next windows to search, after the `first` ones.

    The sequence of windows of a side in pixels covers the image and repeats. Consecutive windows
    are far apart.
    """
    across, down = (max(math.ceil(length / (side * (1.0 - _OVERLAP))), 1) for length in image_size)
    total = across * down
    number = np.arange(first, first + count) * _stride(total) % total
    places = np.stack([number % across, number // across], axis=1) + 0.5
    return places * np.array([image_size[0] / across, image_size[1] / down])


def standing_boxes(
    image_size: tuple[int, int], standing: Standing, aspect: float, window: float
) -> NDArray[np.float64]:
    """(N, 4) boxes of standing targets, at least one, whose windows cover the image.

    The aspect is width over height; the side of a window is in box sizes.
    """
    width, height = image_size
    boxes = []
    for scale in _SCALES:
        high = scale * height
        across = max(math.ceil(width / (window * math.sqrt(aspect) * high * (1.0 - _OVERLAP))), 1)
        top = standing.lower_edge(high) - high
        # As those of the particles, the center stays in the image.
        top = min(max(top, -high / 2), height - high / 2)
        centers = (np.arange(across) + 0.5) * width / across
        boxes += [(center - aspect * high / 2, top, aspect * high, high) for center in centers]
    return np.array(boxes)


def _boxes_around(centers: NDArray[np.float64], size: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, 4) boxes of a (2,) size around (K, 2) centers."""
    return np.hstack([centers - size / 2, np.tile(size, (len(centers), 1))])


def _stride(total: int) -> int:
    """Stride through so many windows that visits all, and takes consecutive ones far apart."""
    stride = max(round(total * _GOLDEN_RATIO), 1)
    while math.gcd(stride, total) > 1:
        stride += 1
    return stride


class Candidate(NamedTuple):
    """The likeliest (4,) box of a window, pixels, and the probability that it is the target."""

    box: NDArray[np.float64]
    confidence: float


class Redetector:
    """Searches for a target outside the window of the particles.

    The side of a window is in box sizes.

    Attributes:
        asks: Whether a lost target has to be confirmed by somebody.
    """

    def __init__(
        self,
        measurer: SearchingMeasurer,
        fusion: CueFusion,
        confidence: Confidence,
        parameters: RedetectionParameters,
        *,
        side: float,
    ) -> None:
        self._measurer = measurer
        self._fusion = fusion
        self._confidence = confidence
        self._windows = parameters.windows
        self.asks = parameters.mode == "ask"
        self._side = side

    def search(
        self, measurement: Measurement, assessment: Assessment, *, searches_everywhere: bool
    ) -> list[Candidate]:
        """The likeliest box of each of this frame's windows."""
        if self._windows == 0:
            return []
        state, box = measurement.state, assessment.box
        last_seen = np.array(state.last_seen_box)
        size = last_seen[2:]
        boxes: NDArray[np.float64] = np.empty((0, 4))
        has_moved = (np.abs(box[:2] - last_seen[:2]) > size / 2).any()
        if has_moved and state.frames_since_seen % _REVISIT_INTERVAL == 0:
            boxes = last_seen[None]
        if searches_everywhere:
            everywhere = self._windows_everywhere(state, measurement.frame.size, size)
            boxes = np.vstack([boxes, everywhere])
        return self._search_in(measurement, assessment, boxes)

    def _search_in(
        self, measurement: Measurement, assessment: Assessment, boxes: NDArray[np.float64]
    ) -> list[Candidate]:
        """The likeliest box of each window with one of the (K, 4) boxes in its middle."""
        state, frame, cue_weights = measurement.state, measurement.frame, measurement.cue_weights
        excluded = assessment.known_distractor
        candidates = []
        for window_box in boxes:
            candidate = self.search_around(state, frame, cue_weights, window_box, excluded)
            if candidate.confidence >= DOUBTFUL_BELOW:
                candidate = self.search_around(state, frame, cue_weights, candidate.box, excluded)
            candidates.append(candidate)
        return candidates

    def challenger(
        self,
        measurement: Measurement,
        assessment: Assessment,
        candidates: Sequence[Candidate],
        confidence: float,
    ) -> Challenger | None:
        """The likeliest box elsewhere and its lead, for a target that is out of sight.

        It is the last challenger, the second peak of this frame, or a candidate of the search. The
        confidence is that of this frame in the current box, 0 to 1.
        """
        if self._windows == 0 or assessment.status.hidden_for < _CHALLENGED_AFTER:
            return None
        state = measurement.state
        last = state.challenger
        peaks = [] if measurement.second_peak is None else [measurement.second_peak]
        at, size = np.array(peaks).reshape(-1, 4), np.array(state.last_seen_box[2:])
        boxes = _boxes_around(at[:, :2] + at[:, 2:] / 2, size)
        if last:
            boxes = np.vstack([boxes, last.box])
        others = [*candidates, *self._search_in(measurement, assessment, boxes)]
        others = [one for one in others if not are_same_place(one.box, assessment.box)]
        rate = min(measurement.frame_prediction.interval / _LEAD_TIME, 1.0)
        if not others:
            return last and last._replace(lead=last.lead * (1.0 - rate))
        best = max(others, key=lambda one: one.confidence)
        lead = last.lead if last and are_same_place(best.box, last.box) else 0.0
        log_ratio = float(log_odds(best.confidence) - log_odds(confidence))
        log_ratio = min(max(log_ratio, -_LARGEST_LEAD), _LARGEST_LEAD)
        lead += rate * (log_ratio - lead)
        wins = lead >= _WINS_ABOVE and best.confidence >= DOUBTFUL_BELOW
        return Challenger(as_box(best.box), lead, wins=wins)

    def _windows_everywhere(
        self, state: FilterState, image_size: tuple[int, int], size: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(K, 4) boxes in the middle of this frame's windows.

        Of the (2,) last seen size or, where the ground is known, of standing targets.
        """
        first = state.followed_frames * self._windows
        if state.standing is None:
            side = self._side * math.sqrt(size[0] * size[1])
            centers = window_centers(image_size, side, first, self._windows)
            return _boxes_around(centers, size)
        boxes = standing_boxes(image_size, state.standing, size[0] / size[1], self._side)
        numbers = np.arange(first, first + self._windows) * _stride(len(boxes)) % len(boxes)
        return boxes[numbers]

    def search_around(
        self,
        state: FilterState,
        frame: Frame,
        cue_weights: Mapping[str, float],
        box: NDArray[np.float64],
        excluded: Box | None = None,
    ) -> Candidate:
        """The likeliest box in the window around a (4,) box, pixels; not on an excluded one."""
        search, region = self._measurer.search_window(frame, box)
        responses = self._fusion.responses_on_grid(region, search.grid, state.templates)
        if not responses:
            return Candidate(box, 0.0)
        likelihood = self._fusion.search(
            region, search.grid, responses, state.templates, cue_weights
        )
        if excluded is not None:
            likelihood[are_same_place(search.boxes, excluded)] = -np.inf
        best = int(np.argmax(likelihood))
        if likelihood[best] == -np.inf:
            return Candidate(box, 0.0)
        likeliest = search.boxes[best]
        seen = self._fusion.observe(region, likeliest)
        match = self._fusion.match(seen, state.templates)
        rival = search.second_peak(likeliest, likelihood)
        assessed = AssessedBox(frame, likeliest, seen, match, rival=rival)
        return Candidate(likeliest, self._confidence.assess(state, assessed))
