"""Correlation response cue: how strongly a trained filter answers at each place and size.

The filter's answer to a window around the prediction is computed once a frame for a few sizes of
the target; each particle reads it at its center, between the two sizes next to its own.

Sources: as in `correlation_filter` and `window_features`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

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
from pf_tracker_ros.cues.cue import Match
from pf_tracker_ros.cues.maps import FrameMaps
from pf_tracker_ros.cues.window_features import CELL_PIXELS, square_window, window_features
from pf_tracker_ros.parameters import declared

# Places along each side of a cell at which the response is computed.
_REFINEMENT = 2


@dataclass(frozen=True)
class CorrelationResponseParameters:
    """The correlation response cue."""

    power: float = declared(
        0.0,
        "Power of this cue in the fused likelihood; 0 switches it off. "
        "The powers of all cues are scaled to a sum of 1.",
        minimum=0.0,
        maximum=1.0,
    )
    window: float = declared(
        4.0,
        "Side of the square window around the target that the filter is trained in.",
        unit="box sizes",
        minimum=2.0,
        maximum=8.0,
        read_only=True,
    )
    cells: int = declared(
        32,
        "Cells of 4 x 4 pixels along each side of the window, which is brought to that resolution; "
        "an even number.",
        minimum=16,
        maximum=64,
        read_only=True,
    )
    sizes: int = declared(
        3,
        "Sizes of the target at which the response is computed each frame.",
        minimum=1,
        maximum=9,
    )
    size_step: float = declared(
        1.03,
        "Factor from one of these sizes to the next.",
        minimum=1.001,
        maximum=1.5,
    )
    sharpness: float = declared(
        60.0,
        "How fast the likelihood falls as the response does.",
        minimum=0.0,
        maximum=1000.0,
    )
    memory: float = declared(
        100.0,
        "Weight of the filter's change from one training to the next (mu); more adapts slower.",
        minimum=0.0,
        maximum=10000.0,
    )
    learn_above: float = declared(
        0.2,
        "The filter is trained on only when its response at the estimate exceeds this.",
        minimum=0.0,
        maximum=1.0,
    )


@dataclass(frozen=True, eq=False)
class CorrelationTemplate:
    """A filter, trained when it is first needed.

    Attributes:
        seen: Spectrum of the features of the last window that was learned from.
        target_cells: (width, height) of the target in cells.
        before: The filter before, None at first.
        memory: Weight of the change from the filter before.
    """

    seen: Spectrum
    target_cells: tuple[float, float]
    before: Spectrum | None = None
    memory: float = 0.0

    @cached_property
    def filter(self) -> Spectrum:
        """The filter's spectrum, scaled to a response of 1 to the window that it was trained on."""
        trained = train(self.seen, self.target_cells, self.before, self.memory)
        return trained

    @cached_property
    def reference(self) -> float:
        return max(response_at_center(self.filter, self.seen), 1e-9)


class CorrelationResponse:
    """Response of a regularized correlation filter.

    Args:
        parameters: Window, sizes and sharpness.
    """

    def __init__(self, parameters: CorrelationResponseParameters) -> None:
        self._window = parameters.window
        self._cells = parameters.cells
        self._sizes = parameters.sizes
        self._step = parameters.size_step
        self._sharpness = parameters.sharpness
        self._learn_above = parameters.learn_above
        self._memory = parameters.memory

    @property
    def reach(self) -> float:
        """See `Cue.reach`; the cue crops its own window."""
        return 0.0

    @property
    def steady_keep(self) -> None:
        """See `Cue.steady_keep`."""
        return None

    def learn(self, maps: FrameMaps, box: NDArray[np.float64]) -> CorrelationTemplate:
        """See `Cue.learn`."""
        x, y, width, height = box
        size = math.sqrt(width * height)
        cells = self._cells / (self._window * size)
        seen = self._spectrum(maps, (x + width / 2, y + height / 2), size)
        return CorrelationTemplate(seen, (width * cells, height * cells))

    def log_likelihood(
        self, maps: FrameMaps, boxes: NDArray[np.float64], template: CorrelationTemplate
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood`."""
        return -self._sharpness * (1.0 - self.response(maps, boxes, template))

    def match(self, seen: CorrelationTemplate, template: CorrelationTemplate) -> Match:
        """See `Cue.match`; the similarity is the response at the box."""
        value = min(max(response_at_center(template.filter, seen.seen) / template.reference, 0.0), 1.0)
        return Match(-self._sharpness * (1.0 - value), value)

    def response(
        self, maps: FrameMaps, boxes: NDArray[np.float64], template: CorrelationTemplate
    ) -> NDArray[np.float64]:
        """(N,) responses, 0 to 1, at the centers and sizes of (N, 4) boxes."""
        sizes = np.sqrt(boxes[:, 2] * boxes[:, 3])
        centers = boxes[:, :2] + boxes[:, 2:] / 2
        middle = (float(centers[:, 0].mean()), float(centers[:, 1].mean()))
        mean_size = float(np.exp(np.log(sizes).mean()))
        samples = _REFINEMENT * self._cells
        levels = np.empty((self._sizes, len(boxes)))
        for level in range(self._sizes):
            size = mean_size * self._step ** (level - (self._sizes - 1) / 2)
            values = response(template.filter, self._spectrum(maps, middle, size), samples)
            places = (centers - middle) * (samples / (self._window * size)) + samples // 2
            places = places.astype(np.float32)
            levels[level] = cv2.remap(
                values, places[:, :1], places[:, 1:], cv2.INTER_CUBIC, borderValue=0.0
            )[:, 0] / template.reference
        if self._sizes == 1:
            return np.clip(levels[0], 0.0, 1.0)
        steps = np.log(sizes / mean_size) / math.log(self._step) + (self._sizes - 1) / 2
        steps = np.clip(steps, 0.0, self._sizes - 1.0)
        lower = np.minimum(steps.astype(np.intp), self._sizes - 2)
        share = steps - lower
        each = np.arange(len(boxes))
        values = (1.0 - share) * levels[lower, each] + share * levels[lower + 1, each]
        return np.clip(values, 0.0, 1.0)

    def blend(
        self, template: CorrelationTemplate, seen: CorrelationTemplate, keep: float
    ) -> CorrelationTemplate:
        """See `Cue.blend`: the filter's change has the weight keep / (1 - keep)."""
        if self.match(seen, template).similarity < self._learn_above:
            return template
        return CorrelationTemplate(seen.seen, template.target_cells, template.filter, self._memory)

    def _spectrum(self, maps: FrameMaps, center: tuple[float, float], size: float) -> Spectrum:
        window = square_window(
            maps.image, center, self._window * size, CELL_PIXELS * self._cells
        )
        return spectrum(window_features(window))
