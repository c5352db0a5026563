"""Correlation response cue: how strongly a trained filter answers at each place.

The filter's answers to the window around the prediction, in two sizes of it where the target's size
is asked for, are computed once a frame, and each particle reads them at its center and size: any
number of particles costs nearly the same.

Sources: as in `correlation_filter` and in the features.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxGrid
from pf_tracker_ros.cues.correlation_filter import (
    SMALLEST_RESPONSE,
    ResponseMaps,
    Spectrum,
    Windows,
    deviation_of,
    mean_of,
    peak_near,
    peak_to_sidelobe,
    response,
    response_at_center,
    spectra_of,
    train,
)
from pf_tracker_ros.cues.cue import CUES, CueParameters, Match, PredictedTarget, SearchableCue
from pf_tracker_ros.cues.features import FEATURES
from pf_tracker_ros.frames import Frame, Region
from pf_tracker_ros.frames.region import read_window
from pf_tracker_ros.parameters import declared, parts

Value = TypeVar("Value", bound=np.generic)

# Cells of windows that are worked on at once: a processor's cache does not hold what more need.
_CELLS_AT_ONCE = 2400
# Places along each side of a cell at which the response is computed.
_REFINEMENT = 2
# Mean difference between the largest and the smallest of a pixel's channels, in gray levels, from
# which on a window shows colors; some cameras give gray images three channels.
_LEAST_COLOR = 2.0


@dataclass(frozen=True)
class CorrelationResponseParameters(CueParameters):
    """The correlation response cue."""

    features: str = declared(
        "gradients_and_colors",
        "What the filter looks at.",
        choices=FEATURES,
        read_only=True,
    )
    of_features: dict[str, Any] = parts("features", FEATURES)
    window: float = declared(
        4.0,
        "Side of the square window around the target that the filter is trained in; a larger one "
        "sees faster targets, and more of what is not the target.",
        unit="box sizes",
        minimum=2.0,
        maximum=8.0,
        read_only=True,
    )
    sharpness: float = declared(
        100.0,
        "How fast the likelihood falls as the response does.",
        minimum=0.0,
        maximum=1000.0,
    )


@dataclass(frozen=True, eq=False)
class CorrelationTemplate:
    """A trained filter.

    Attributes:
        filter: Its spectrum.
        reference: Its response to the window that it was trained on last.
        target_cells: (width, height) of the target in cells.
        colored: Whether it looks at colors; where there are none, at gray levels.
        frames: That could be learned from so far.
        frames_since_training: Those since the last training.
    """

    filter: Spectrum
    reference: float
    target_cells: tuple[float, float]
    colored: bool
    frames: int = 1
    frames_since_training: int = 0


class DeferredObservation(NamedTuple):
    """Where to look in the frame at hand: training the filter costs too much for every frame.

    Attributes:
        region: Of that frame.
        box: (4,) x, y, width, height in pixels.
    """

    region: Region
    box: NDArray[np.float64]


class Patch(NamedTuple):
    """Part of a frame.

    Attributes:
        frame: All of it.
        center: (2,) in image pixels.
        side: Image pixels.
    """

    frame: Frame
    center: NDArray[np.float64]
    side: float


@CUES.register("correlation_response", CorrelationResponseParameters)
class CorrelationResponse(SearchableCue):
    """Response of a regularized correlation filter, against that to the window it was trained on.

    What a response says of the target depends on the features, which bring their calibration.

    Args:
        parameters: Features, window and sharpness.
        cells: Along each side of the window, even; each has as many pixels as the features ask for,
            once the window is brought to that resolution.
        size_span: Factor from the smaller to the larger of the two windows that are compared each
            frame, as much smaller and larger than the prediction's; with 1 there is one window,
            which says nothing about the target's size. Nor is there another where nobody asks for
            that.
        memory: Weight of the filter's change from one frame to the next (mu); more adapts slower.
        training_interval: Frames from one training of the filter to the next, each counting for all
            of them.
        settling_frames: Frames, from the first on, in which the filter is trained each time, and
            over which the weight of its memory grows to the full one: the first views say most.
    """

    def __init__(
        self,
        parameters: CorrelationResponseParameters,
        *,
        cells: int = 40,
        size_span: float = 1.04,
        memory: float = 300.0,
        training_interval: int = 3,
        settling_frames: int = 25,
    ) -> None:
        self._features = FEATURES.make(
            parameters.features, parameters.of_features[parameters.features]
        )
        self._window = parameters.window
        self._cells = cells
        # Windows that are worked on at once.
        self._at_once = max(_CELLS_AT_ONCE // cells**2, 1)
        self._log_span = math.log(size_span)
        reach = self._log_span / 2
        self._factors = (math.exp(-reach), math.exp(reach)) if reach else (1.0,)
        self._sharpness = parameters.sharpness
        self._interval = training_interval
        self._settling = settling_frames
        self._memory = memory

    def learn(self, region: Region, box: NDArray[np.float64]) -> CorrelationTemplate:
        """See `Cue.learn`."""
        square = self._square(region, box)
        (pixels,) = self._pixels([square], gray=False)
        colored = pixels.ndim == 3 and float(np.ptp(pixels, axis=2).mean()) >= _LEAST_COLOR
        (seen,) = self._spectra([square], colored)
        width, height = (float(length) * self._cells / square.side for length in box[2:])
        trained = train(seen, (width, height), None, 0.0)
        return CorrelationTemplate(trained, _reference(trained, seen), (width, height), colored)

    def precompute(self, predicted_targets: Sequence[PredictedTarget]) -> None:
        """See `Cue.precompute`."""
        for colored in (False, True):
            of_kind = [
                one
                for one in predicted_targets
                if one.template.colored == one.first.colored == colored
            ]
            for start in range(0, len(of_kind), self._at_once):
                some = of_kind[start : start + self._at_once]
                if len(some) > 1:
                    self._prepare(some, colored)

    def _prepare(self, predicted_targets: Sequence[PredictedTarget], colored: bool) -> None:
        windows = self._read([one.region for one in predicted_targets], colored)
        counts = [len(one.spectra) for one in windows]
        filters = np.stack([one.template.filter for one in predicted_targets])
        spectra = np.concatenate([one.spectra for one in windows])
        maps = response(np.repeat(filters, counts, axis=0), spectra, _REFINEMENT * self._cells)
        first = np.stack([one.first.filter for one in predicted_targets])
        expected = np.stack([one.expected for one in windows])
        early_maps = response(first, expected, self._cells)
        for one, seen, answers, early in zip(
            predicted_targets, windows, _parts(maps, counts), early_maps, strict=True
        ):
            one.region.store((self, colored), seen)
            one.region.store(_key(one.template), ResponseMaps.of(answers, seen))
            one.region.store(_first_key(one.first), early)

    def observe(self, region: Region, box: NDArray[np.float64]) -> DeferredObservation:
        """See `Cue.observe`."""
        return DeferredObservation(region, box)

    def template_from(self, seen: DeferredObservation) -> CorrelationTemplate:
        """See `Cue.template_from`."""
        return self.learn(seen.region, seen.box)

    def log_likelihood_of(
        self, strength: NDArray[np.float64], template: CorrelationTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.log_likelihood_of`."""
        return -self._sharpness * (1.0 - strength)

    def match(self, seen: DeferredObservation, template: CorrelationTemplate) -> Match:
        """See `Cue.match`.

        The response at the box says little, since there is a best place even where the target is
        hidden. The similarity is how far the best place stands out from all others, and whether its
        response is on the level of the last one that was learned from (`Calibration`).

        Source: Bolme, Beveridge, Draper, Lui 2010, "Visual object tracking using adaptive
        correlation filters", section 3.5 (the peak-to-sidelobe ratio).
        """
        value = float(self.response(seen.region, seen.box[None], template)[0])
        answers = self._answers(seen.region, template)
        peak = max(float(answers.expected.max()), SMALLEST_RESPONSE)
        similarity = self._features.calibration.similarity(
            peak, answers.deviation, template.reference
        )
        return Match(-self._sharpness * (1.0 - value), similarity)

    def log_odds(
        self, seen: DeferredObservation, template: CorrelationTemplate, first: CorrelationTemplate
    ) -> dict[str, float]:
        """See `Cue.log_odds`.

        How far the box stands out for the filter, and near it for the first one, and whether the
        response is by far below the level of the last one that was learned from.
        """
        region, box = seen
        answers = self._answers(region, template)
        at_box = float(answers.read((box[:2] + box[2:] / 2)[None], np.array([0.5]))[0])
        early = region.cached(
            _first_key(first),
            # It may look at colors where the last one looks at gray levels.
            lambda: response(
                first.filter, self._windows(region, first.colored).expected, self._cells
            ),
        )
        near = peak_near(early, region.center_box, self._side(region.center_box), box)
        peak_to_sidelobe_ratio = peak_to_sidelobe(at_box, answers.deviation)
        first_peak_to_sidelobe_ratio = peak_to_sidelobe(near, deviation_of(early))
        level = max(at_box, SMALLEST_RESPONSE) / template.reference
        return self._features.calibration.log_odds(
            peak_to_sidelobe_ratio, first_peak_to_sidelobe_ratio, level
        )

    def response(
        self, region: Region, boxes: NDArray[np.float64], template: CorrelationTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.response`: the responses at the centers of the boxes, 0 to 1.

        The windows are around `Region.center_box`. Between their sizes a box's response is
        interpolated; beyond them it is that of the next.
        """
        answers = self._answers(region, template)
        centers = boxes[:, :2] + boxes[:, 2:] / 2
        responses = answers.read(centers, self._shares(boxes[:, 2:], region.center_box))
        return _of_the_best(responses, answers, template)

    def response_on_grid(
        self, region: Region, grid: BoxGrid, template: CorrelationTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.response_on_grid`."""
        answers = self._answers(region, template)
        width, height = grid.size
        share = self._shares(grid.size[None], region.center_box)
        responses = answers.read_grid(grid.left + width / 2, grid.top + height / 2, share)
        return _of_the_best(responses.ravel(), answers, template)

    def _shares(
        self, sizes: NDArray[np.float64], center_box: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(N,) where (N, 2) sizes are between the smaller (0) and the larger window (1)."""
        if not self._log_span:
            return np.zeros(len(sizes))
        areas = sizes[:, 0] * sizes[:, 1] / (center_box[2] * center_box[3])
        return np.minimum(np.maximum(np.log(areas) / (2 * self._log_span) + 0.5, 0.0), 1.0)

    def _answers(self, region: Region, template: CorrelationTemplate) -> ResponseMaps:
        def answer() -> ResponseMaps:
            windows = self._windows(region, template.colored)
            maps = response(template.filter, windows.spectra, _REFINEMENT * self._cells)
            return ResponseMaps.of(maps, windows)

        return region.cached(_key(template), answer)

    def _windows(self, region: Region, colored: bool) -> Windows:
        return region.cached((self, colored), lambda: self._read([region], colored)[0])

    def _read(self, regions: Sequence[Region], colored: bool) -> list[Windows]:
        """The windows around the prediction in each region."""
        squares = [
            [
                self._square(region, region.center_box, factor)
                for factor in (self._factors if region.estimates_size else (1.0,))
            ]
            for region in regions
        ]
        spectra = self._spectra([*itertools.chain(*squares)], colored)
        return [
            Windows(part, mean_of(part), some[0].center, [one.side for one in some])
            for part, some in zip(_parts(spectra, map(len, squares)), squares, strict=True)
        ]

    def blend(
        self, template: CorrelationTemplate, seen: DeferredObservation
    ) -> CorrelationTemplate:
        """See `Cue.blend`; the filter's memory holds it near what it was."""
        learned = replace(
            template,
            frames=template.frames + 1,
            frames_since_training=template.frames_since_training + 1,
        )
        settled = min(template.frames / self._settling, 1.0)
        interval = self._interval if settled == 1.0 else 1
        if learned.frames_since_training < interval:
            return learned
        (view,) = self._spectra([self._square(seen.region, seen.box)], template.colored)
        memory = settled * self._memory / interval
        trained = train(view, template.target_cells, template.filter, memory)
        reference = _reference(trained, view)
        return replace(learned, filter=trained, reference=reference, frames_since_training=0)

    def _spectra(self, squares: Sequence[Patch], colored: bool) -> Spectrum:
        """(K, channels, cells, cells // 2 + 1) of the features in K squares."""
        spectra = [
            spectra_of(self._features.extract(self._pixels(some, gray=not colored)))
            for some in (
                squares[start : start + self._at_once]
                for start in range(0, len(squares), self._at_once)
            )
        ]
        return spectra[0] if len(spectra) == 1 else np.concatenate(spectra)

    def _pixels(self, squares: Sequence[Patch], *, gray: bool) -> NDArray[np.uint8]:
        pixels = self._features.cell_size * self._cells
        return np.stack([read_window(*square, pixels, gray) for square in squares])

    def _square(self, region: Region, box: NDArray[np.float64], factor: float = 1.0) -> Patch:
        """Around a (4,) box, in so many times its size."""
        return Patch(region.frame, box[:2] + box[2:] / 2, factor * self._side(box))

    def _side(self, box: NDArray[np.float64]) -> float:
        return self._window * math.sqrt(box[2] * box[3])


def _key(template: CorrelationTemplate) -> object:
    """Under which a region keeps the answers to its windows."""
    return "correlation responses", template


def _first_key(first: CorrelationTemplate) -> object:
    return "first correlation response", first


def _parts(values: NDArray[Value], counts: Iterable[int]) -> list[NDArray[Value]]:
    """One part after the other of so many entries each."""
    ends = [*itertools.accumulate(counts)]
    return [values[start:end] for start, end in zip([0, *ends], ends, strict=False)]


def _of_the_best(
    responses: NDArray[np.float64], answers: ResponseMaps, template: CorrelationTemplate
) -> NDArray[np.float64]:
    """(N,) responses as shares, 0 to 1, of the one that was learned."""
    # A view may answer more than the one that was learned; still no place beats the best.
    full = max(template.reference, answers.largest)
    return np.minimum(np.maximum(responses / full, 0.0), 1.0)


def _reference(trained: Spectrum, seen: Spectrum) -> float:
    return max(response_at_center(trained, seen), SMALLEST_RESPONSE)


@dataclass(frozen=True)
class CoarseCorrelationResponseParameters(CorrelationResponseParameters):
    """The coarse correlation response cue."""

    window: float = declared(
        2.5,
        "Side of the square window around the target that the filter is trained in; a larger one "
        "sees faster targets, and more of what is not the target.",
        unit="box sizes",
        minimum=2.0,
        maximum=8.0,
        read_only=True,
    )


@CUES.register("coarse_correlation_response", CoarseCorrelationResponseParameters)
class CoarseCorrelationResponse(CorrelationResponse):
    """The correlation response in fewer, larger cells, and in sizes further apart.

    Args:
        parameters: Features, window and sharpness.
        cells: Along each side of the window, even.
        settling_frames: As for `CorrelationResponse`.
    """

    def __init__(
        self,
        parameters: CoarseCorrelationResponseParameters,
        *,
        cells: int = 24,
        settling_frames: int = 1,
    ) -> None:
        super().__init__(parameters, cells=cells, size_span=1.1, settling_frames=settling_frames)
