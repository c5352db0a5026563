"""Correlation response cue: how strongly a trained filter answers at each place.

The filter's answer to the window around the prediction is computed once a frame, and each particle
reads it at its center: any number of particles costs nearly the same.

Sources: as in `correlation_filter` and `window_features`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.correlation_filter import (
    Spectrum,
    response,
    response_at_center,
    spectrum,
    train,
)
from pf_tracker_ros.cues.cue import Match, declared_power
from pf_tracker_ros.cues.deferred import DeferredCue, View, declared_training_interval
from pf_tracker_ros.cues.maps import FrameMaps
from pf_tracker_ros.cues.window_features import CELL_PIXELS, window_features
from pf_tracker_ros.cues.windows import Crop
from pf_tracker_ros.parameters import declared

# Places along each side of a cell at which the response is computed.
_REFINEMENT = 2
# How many boxes are read at once, well within what OpenCV can (2^15 - 2).
_READ_AT_ONCE = 2**14
# Responses below this share of the one to the trained window are as good as none.
_SMALLEST = 1e-9


@dataclass(frozen=True)
class CorrelationResponseParameters:
    """The correlation response cue."""

    power: float = declared_power(0.0)
    window: float = declared(
        4.0,
        "Side of the square window around the target that the filter is trained in; a larger one "
        "sees faster targets, and more of what is not the target.",
        unit="box sizes",
        minimum=2.0,
        maximum=8.0,
        read_only=True,
    )
    cells: int = declared(
        40,
        "Cells along each side of the window, each of 4 x 4 pixels once the window is brought to "
        "that resolution; an odd number counts as the even one above.",
        minimum=16,
        maximum=64,
        read_only=True,
    )
    sharpness: float = declared(
        80.0,
        "How fast the likelihood falls as the response does.",
        minimum=0.0,
        maximum=1000.0,
    )
    memory: float = declared(
        300.0,
        "Weight of the filter's change from one frame to the next (mu); more adapts slower.",
        minimum=0.0,
        maximum=10000.0,
    )
    training_interval: int = declared_training_interval()


@dataclass(frozen=True, eq=False)
class CorrelationTemplate:
    """A trained filter.

    Attributes:
        filter: Its spectrum.
        reference: Its response to the window that it was trained on last.
        target_cells: (width, height) of the target in cells.
        waiting: Frames that could have been learned from since the last training.
    """

    filter: Spectrum
    reference: float
    target_cells: tuple[float, float]
    waiting: int = 0


class _Window(NamedTuple):
    """The window around the prediction.

    Attributes:
        spectrum: Of its features.
        center: (2,) in image pixels.
        side: Image pixels.
    """

    spectrum: Spectrum
    center: NDArray[np.float64]
    side: float


class CorrelationResponse(DeferredCue):
    """Response of a regularized correlation filter, against that to the window it was trained on.

    Args:
        parameters: Window, training and sharpness.
    """

    def __init__(self, parameters: CorrelationResponseParameters) -> None:
        self._window = parameters.window
        self._cells = parameters.cells + parameters.cells % 2
        self._sharpness = parameters.sharpness
        self._interval = parameters.training_interval
        self._memory = parameters.memory / self._interval

    def learn(self, maps: FrameMaps, box: NDArray[np.float64]) -> CorrelationTemplate:
        """See `Cue.learn`."""
        window = self._around(maps, box)
        cells = (
            float(box[2]) * self._cells / window.side,
            float(box[3]) * self._cells / window.side,
        )
        return self._trained(window.spectrum, cells, None)

    def log_likelihood(
        self, maps: FrameMaps, boxes: NDArray[np.float64], template: CorrelationTemplate
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood`."""
        return -self._sharpness * (1.0 - self.response(maps, boxes, template))

    def match(self, seen: View, template: CorrelationTemplate) -> Match:
        """See `Cue.match`; the similarity is the response."""
        value = float(self.response(seen.maps, seen.box[None], template)[0])
        return Match(-self._sharpness * (1.0 - value), value)

    def response(
        self, maps: FrameMaps, boxes: NDArray[np.float64], template: CorrelationTemplate
    ) -> NDArray[np.float64]:
        """(N,) responses, 0 to 1, at the centers of (N, 4) boxes.

        The first boxes of a frame tell where the window of that frame is: around their mean.
        """
        samples = _REFINEMENT * self._cells
        window = maps.shared(
            ("correlation window", self._window, self._cells),
            lambda: self._around(maps, boxes.mean(axis=0)),
        )
        values = maps.shared(
            ("correlation response", template),
            lambda: response(template.filter, window.spectrum, samples),
        )
        centers = boxes[:, :2] + boxes[:, 2:] / 2
        places = (centers - window.center) * (samples / window.side) + samples // 2
        read = [
            cv2.remap(values, part[None], None, cv2.INTER_CUBIC)[0]
            for part in np.split(
                places.astype(np.float32), range(_READ_AT_ONCE, len(places), _READ_AT_ONCE)
            )
        ]
        return np.clip(np.concatenate(read) / template.reference, 0.0, 1.0)

    def blend(self, template: CorrelationTemplate, seen: View, keep: float) -> CorrelationTemplate:
        """See `Cue.blend`; the filter's own memory takes the place of `keep`."""
        waiting = template.waiting + 1
        if waiting < self._interval:
            return replace(template, waiting=waiting)
        window = self._around(seen.maps, seen.box)
        return self._trained(window.spectrum, template.target_cells, template.filter)

    def _around(self, maps: FrameMaps, box: NDArray[np.float64]) -> _Window:
        center = box[:2] + box[2:] / 2
        side = self._window * math.sqrt(box[2] * box[3])
        sides, pixels = np.array([side, side]), CELL_PIXELS * self._cells
        window = Crop(maps.image, center, sides, pixels).window(center, sides, pixels)
        return _Window(spectrum(window_features(window)), center, side)

    def _trained(
        self, seen: Spectrum, target_cells: tuple[float, float], before: Spectrum | None
    ) -> CorrelationTemplate:
        trained = train(seen, target_cells, before, self._memory)
        reference = max(response_at_center(trained, seen), _SMALLEST)
        return CorrelationTemplate(trained, reference, target_cells)
