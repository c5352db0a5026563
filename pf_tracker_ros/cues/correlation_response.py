"""Correlation response cue: the response of a trained correlation filter at each box.

1. A window around the predicted box is converted to features. If the target's size is estimated,
   those of a smaller and of a larger window are interpolated from them.
2. The filter's response maps to these windows are computed once per frame.
3. Each particle reads the maps at its center and interpolates to its size, so any number of
   particles costs almost the same.
4. The log likelihood falls linearly as the response falls below that at training.
5. Every few frames, the filter is trained with the window at the estimate.

Sources: see `correlation_filter` and the features; Bolme, Beveridge, Draper, Lui 2010, "Visual
object tracking using adaptive correlation filters", section 3.5 (the peak-to-sidelobe ratio).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import BoxGrid
from pf_tracker_ros.cues.correlation_filter import (
    SMALLEST_RESPONSE,
    ResponseMaps,
    Spectrum,
    Windows,
    mean_of,
    peak_to_sidelobe,
    response,
    response_at_center,
    shifted,
    spectra_of,
    train,
)
from pf_tracker_ros.cues.cue import CUES, CueParameters, Match, PredictedTarget, SearchableCue
from pf_tracker_ros.cues.features import FEATURES
from pf_tracker_ros.frames import Frame, Region
from pf_tracker_ros.frames.region import read_window
from pf_tracker_ros.parameters import declared, parts

# Cells of the windows processed at once, limited by the processor's cache.
_CELLS_AT_ONCE = 2400
# Samples of the response along each side of a cell.
_REFINEMENT = 2
# A window is colored if the mean difference of a pixel's largest and smallest channel is at least
# this, gray levels. Some cameras send gray images with three channels.
_MIN_COLOR_DIFFERENCE = 2.0
# How fast the log likelihood falls with a falling response.
_SHARPNESS = 100.0
# Largest shift, cells, and relative growth of a window that serves for training at another box.
_LARGEST_SHIFT, _LARGEST_GROWTH = 1.0, 0.03
# Standard deviation of the response over the logarithm of the size, measured on sequences; the
# largest logarithm of a growth that it tells.
_SIZE_STD, _LARGEST_LOG_GROWTH = 0.21, 0.1
# Side of the window of the coarse response, box sizes.
_COARSE_WINDOW = 2.5


@dataclass(frozen=True)
class _FeatureParameters(CueParameters):
    """The features of a correlation response cue."""

    features: str = declared(
        "gradients_and_colors",
        "Features of the filter.",
        choices=FEATURES,
        read_only=True,
    )
    of_features: dict[str, Any] = parts("features", FEATURES)


@dataclass(frozen=True)
class CorrelationResponseParameters(_FeatureParameters):
    """The correlation response cue."""

    window: float = declared(
        4.0,
        "Side of the filter's square window around the target; a larger one covers faster targets "
        "and more background.",
        unit="box sizes",
        minimum=2.0,
        maximum=8.0,
        read_only=True,
    )


@dataclass(frozen=True, eq=False)
class CorrelationTemplate:
    """A trained filter.

    Attributes:
        reference: Its response to its last training window.
        target_cells: (width, height) of the target in cells.
        colored: Whether the features are those of colored or of gray windows.
        frames: Number of updates so far, with or without training.
        frames_since_training: Updates since the last training.
    """

    filter: Spectrum
    reference: float
    target_cells: tuple[float, float]
    colored: bool
    frames: int = 1
    frames_since_training: int = 0


class DeferredObservation(NamedTuple):
    """Region and (4,) box, pixels, of an observation whose features are computed when needed."""

    region: Region
    box: NDArray[np.float64]


class Patch(NamedTuple):
    """A square part of a frame, with a (2,) center and a side in image pixels."""

    frame: Frame
    center: NDArray[np.float64]
    side: float


@CUES.register("correlation_response", CorrelationResponseParameters)
class CorrelationResponse(SearchableCue):
    """Response of a regularized correlation filter, relative to that to its training window.

    Attributes:
        cells: Cells along each side of the window, even; the features define a cell's pixels.
        size_span: Size ratio of the two windows around the predicted size; 1 means one window,
            which does not measure the size.
        size_bias: Logarithm of the response to the smaller window over that to the larger one, for
            a target of the size in which it was learned: interpolation favors the smaller one.
            Of two values between which sizes on sequences change from too small to too large.
        size_gain: Factor of the difference between the responses to both windows: interpolated ones
            differ less than two that are read from the frame.
        memory: Weight of the filter's change from frame to frame (mu); more adapts more slowly.
        training_interval: Frames from one training to the next.
        settling_frames: Number of first frames that are all trained with; over these, the memory
            grows to its full weight.
        reuses_windows: Whether, after these, windows that the frame was read in serve for training.
    """

    cells: ClassVar = 40
    size_span: ClassVar = 1.04
    size_bias: ClassVar = 0.007
    size_gain: ClassVar = 1.5
    memory: ClassVar = 300.0
    training_interval: ClassVar = 3
    settling_frames: ClassVar = 25
    reuses_windows: ClassVar = True

    def __init__(self, parameters: CorrelationResponseParameters) -> None:
        self._features = FEATURES.make(
            parameters.features, parameters.of_features[parameters.features]
        )
        self._window = parameters.window
        self._windows_at_once = max(_CELLS_AT_ONCE // self.cells**2, 1)
        self._log_span = math.log(self.size_span)
        # Sides of the windows over that of the predicted size.
        ends = np.array([-0.5, 0.5]) if self._log_span else np.zeros(1)
        self._scales = tuple(np.exp(ends * self._log_span).tolist())
        self._corrections = np.exp(ends * self.size_bias).astype(np.float32)[:, None, None]

    def learn(self, region: Region, box: NDArray[np.float64]) -> CorrelationTemplate:
        """See `Cue.learn`."""
        patch = self._patch(region, box)
        (pixels,) = self._pixels([patch], gray=False)
        difference = float(np.ptp(pixels, axis=2).mean()) if pixels.ndim == 3 else 0.0
        colored = difference >= _MIN_COLOR_DIFFERENCE
        (spectrum,) = spectra_of(self._features_of([patch], colored))
        width, height = (float(length) * self.cells / patch.side for length in box[2:])
        trained = train(spectrum, (width, height), None, 0.0)
        reference = _reference(trained, spectrum)
        return CorrelationTemplate(trained, reference, (width, height), colored)

    def precompute(self, predicted_targets: Sequence[PredictedTarget]) -> None:
        """See `Cue.precompute`."""
        for colored in (False, True):
            selected = [one for one in predicted_targets if one.template.colored == colored]
            for start in range(0, len(selected), self._windows_at_once):
                batch = selected[start : start + self._windows_at_once]
                if len(batch) > 1:
                    self._precompute_batch(batch, colored)

    def _precompute_batch(
        self, predicted_targets: Sequence[PredictedTarget], colored: bool
    ) -> None:
        windows = self._read([one.region for one in predicted_targets], colored)
        counts = [len(one.spectra) for one in windows]
        filters = np.stack([one.template.filter for one in predicted_targets])
        spectra = np.concatenate([one.spectra for one in windows])
        maps = response(np.repeat(filters, counts, axis=0), spectra, _REFINEMENT * self.cells)
        for one, its_windows, its_maps in zip(
            predicted_targets, windows, np.split(maps, np.cumsum(counts)[:-1]), strict=True
        ):
            one.region.store((self, colored), its_windows)
            one.region.store(_key(one.template), self._maps_of(its_maps, its_windows))

    def observe(self, region: Region, box: NDArray[np.float64]) -> DeferredObservation:
        """See `Cue.observe`."""
        return DeferredObservation(region, box)

    def template_from(self, observation: DeferredObservation) -> CorrelationTemplate:
        """See `Cue.template_from`."""
        return self.learn(observation.region, observation.box)

    def log_likelihood_of(
        self, response: NDArray[np.float64], template: CorrelationTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.log_likelihood_of`."""
        return -_SHARPNESS * (1.0 - response)

    def match(self, observation: DeferredObservation, template: CorrelationTemplate) -> Match:
        """See `Cue.match`.

        The similarity is computed from the map's peak-to-sidelobe ratio and the level of the peak
        (`Calibration`), not from the response at the box: a hidden target has a peak too.
        """
        value = float(self.response(observation.region, observation.box[None], template)[0])
        maps = self._response_maps(observation.region, template)
        peak = max(float(maps.expected.max()), SMALLEST_RESPONSE)
        similarity = self._features.calibration.similarity(peak, maps.deviation, template.reference)
        return Match(-_SHARPNESS * (1.0 - value), similarity)

    def log_odds(
        self, observation: DeferredObservation, template: CorrelationTemplate
    ) -> dict[str, float]:
        """See `Cue.log_odds` and `Calibration.log_odds`."""
        region, box = observation
        maps = self._response_maps(region, template)
        at_box = float(maps.read((box[:2] + box[2:] / 2)[None], np.array([0.5]))[0])
        return self._features.calibration.log_odds(peak_to_sidelobe(at_box, maps.deviation))

    def response(
        self, region: Region, boxes: NDArray[np.float64], template: CorrelationTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.response`: the responses at the boxes' centers, 0 to 1.

        Responses are interpolated between the sizes of the windows, and constant beyond these.
        """
        maps = self._response_maps(region, template)
        centers = boxes[:, :2] + boxes[:, 2:] / 2
        responses = maps.read(centers, self._shares(boxes[:, 2:], region.center_box))
        return _relative(responses, maps, template)

    def response_on_grid(
        self, region: Region, grid: BoxGrid, template: CorrelationTemplate
    ) -> NDArray[np.float64]:
        """See `SearchableCue.response_on_grid`."""
        maps = self._response_maps(region, template)
        width, height = grid.size
        share = self._shares(grid.size[None], region.center_box)
        responses = maps.read_grid(grid.left + width / 2, grid.top + height / 2, share)
        return _relative(responses.ravel(), maps, template)

    def log_growth(
        self, region: Region, box: NDArray[np.float64], template: CorrelationTemplate
    ) -> float:
        """See `SearchableCue.log_growth`: from the responses of the larger and the smaller window.

        Over the logarithm of the size, a response is about a Gaussian.
        """
        if not (self._log_span and region.estimates_size):
            return 0.0
        maps = self._response_maps(region, template)
        centers = np.repeat((box[:2] + box[2:] / 2)[None], 2, axis=0)
        smaller, larger = maps.read(centers, np.array([0.0, 1.0])).tolist()
        log_ratio = math.log(max(larger, SMALLEST_RESPONSE) / max(smaller, SMALLEST_RESPONSE))
        growth = _SIZE_STD**2 / self._log_span * log_ratio
        return min(max(growth, -_LARGEST_LOG_GROWTH), _LARGEST_LOG_GROWTH)

    def _shares(
        self, sizes: NDArray[np.float64], center_box: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(N,) position of (N, 2) sizes between the smaller window (0) and the larger one (1)."""
        if not self._log_span:
            return np.zeros(len(sizes))
        areas = sizes[:, 0] * sizes[:, 1] / (center_box[2] * center_box[3])
        return np.minimum(np.maximum(np.log(areas) / (2 * self._log_span) + 0.5, 0.0), 1.0)

    def _response_maps(self, region: Region, template: CorrelationTemplate) -> ResponseMaps:
        def compute() -> ResponseMaps:
            windows = self._windows(region, template.colored)
            maps = response(template.filter, windows.spectra, _REFINEMENT * self.cells)
            return self._maps_of(maps, windows)

        return region.cached(_key(template), compute)

    def _windows(self, region: Region, colored: bool) -> Windows:
        return region.cached((self, colored), lambda: self._read([region], colored)[0])

    def _read(self, regions: Sequence[Region], colored: bool) -> list[Windows]:
        """The windows around each region's `center_box`."""
        patches = [self._patch(region, region.center_box) for region in regions]
        windows = []
        for region, patch, features in zip(
            regions, patches, self._features_of(patches, colored), strict=True
        ):
            scales = self._scales if region.estimates_size else (1.0,)
            spectra = np.concatenate([spectra_of(features[None], scale) for scale in scales])
            sides = [patch.side * scale for scale in scales]
            windows.append(Windows(spectra, patch.center, sides, features, patch.side))
        return windows

    def _maps_of(self, maps: NDArray[np.float32], windows: Windows) -> ResponseMaps:
        """Response maps of (windows, S, S) responses, as if each window had been read."""
        if len(maps) > 1:
            maps = maps * self._corrections
            maps += np.float32(self.size_gain - 1.0) * (maps - mean_of(maps))
        return ResponseMaps.of(maps, windows)

    def blend(
        self, template: CorrelationTemplate, observation: DeferredObservation
    ) -> CorrelationTemplate:
        """See `Cue.blend`; the filter is trained every few frames; every frame is counted.

        After the first ones, a window of the frame that is near the box serves, moved onto it.
        """
        counted = replace(
            template,
            frames=template.frames + 1,
            frames_since_training=template.frames_since_training + 1,
        )
        settled = min(template.frames / self.settling_frames, 1.0)
        interval = self.training_interval if settled == 1.0 else 1
        if counted.frames_since_training < interval:
            return counted
        region, box = observation
        patch = self._patch(region, box)
        is_reused = self.reuses_windows and settled == 1.0
        spectrum = self._moved_window(region, patch, template) if is_reused else None
        if spectrum is None:
            (spectrum,) = spectra_of(self._features_of([patch], template.colored))
        memory = settled * self.memory / interval
        trained = train(spectrum, template.target_cells, template.filter, memory)
        reference = _reference(trained, spectrum)
        return replace(counted, filter=trained, reference=reference, frames_since_training=0)

    def _moved_window(
        self, region: Region, patch: Patch, template: CorrelationTemplate
    ) -> Spectrum | None:
        """Spectrum of a patch from the window of the frame; None where they are too different."""
        windows = self._windows(region, template.colored)
        shift = (patch.center - windows.center) * (self.cells / windows.source_side)
        growth = abs(patch.side / windows.source_side - 1.0)
        if np.abs(shift).max() > _LARGEST_SHIFT or growth > _LARGEST_GROWTH:
            return None
        # Those of the windows are of other sizes.
        return shifted(spectra_of(windows.source[None])[0], shift)

    def _features_of(self, patches: Sequence[Patch], colored: bool) -> NDArray[np.float32]:
        """(K, channels, cells, cells) features of K patches."""
        return self._features.extract(self._pixels(patches, gray=not colored))

    def _pixels(self, patches: Sequence[Patch], *, gray: bool) -> NDArray[np.uint8]:
        pixels = self._features.cell_size * self.cells
        return np.concatenate(
            [
                read_window(frame, center, np.full(2, side), pixels, gray)[None]
                for frame, center, side in patches
            ]
        )

    def _patch(self, region: Region, box: NDArray[np.float64]) -> Patch:
        """The window around a (4,) box."""
        side = self._window * math.sqrt(box[2] * box[3])
        return Patch(region.frame, box[:2] + box[2:] / 2, side)


def _key(template: CorrelationTemplate) -> object:
    """Key of the response maps in a region's cache."""
    return "correlation responses", template


def _relative(
    responses: NDArray[np.float64], maps: ResponseMaps, template: CorrelationTemplate
) -> NDArray[np.float64]:
    """(N,) responses, 0 to 1, relative to the trained one or to a larger one in the maps."""
    full = max(template.reference, maps.largest)
    return np.minimum(np.maximum(responses / full, 0.0), 1.0)


def _reference(trained: Spectrum, spectrum: Spectrum) -> float:
    return max(response_at_center(trained, spectrum), SMALLEST_RESPONSE)


@dataclass(frozen=True)
class CoarseCorrelationResponseParameters(_FeatureParameters):
    """The coarse correlation response cue."""


@CUES.register("coarse_correlation_response", CoarseCorrelationResponseParameters)
class CoarseCorrelationResponse(CorrelationResponse):
    """The correlation response in a smaller window, with larger cells and span of sizes."""

    cells = 24
    size_span = 1.1
    size_bias = 0.0085
    settling_frames = 1
    reuses_windows = False

    def __init__(self, parameters: CoarseCorrelationResponseParameters) -> None:
        windowed = CorrelationResponseParameters(
            features=parameters.features, of_features=parameters.of_features, window=_COARSE_WINDOW
        )
        super().__init__(windowed)
