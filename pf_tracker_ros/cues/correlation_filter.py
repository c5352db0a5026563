"""Correlation filters with spatial and temporal regularization (STRCF).

1. A window around the target is divided into cells, with feature channels x_k.
2. A filter f is trained so that its correlation with the features is a Gaussian peak y at the
   target's center:

       f = argmin |y - sum_k x_k * f_k|^2 + sum_k |w f_k|^2 + mu |f - f_before|^2

   The weight w is small inside the target and large outside: it keeps the filter from using the
   background and the periodic repetition of the window (spatial regularization). mu limits the
   change from frame to frame (temporal regularization).
3. The minimum is computed in the Fourier domain by a few steps of the alternating direction method
   of multipliers (ADMM).
4. The correlation of the filter with a window of a later frame is the response map. Its peak is the
   most likely position of the target.

Windows of a few dozen cells per side are transformed by matrix products, which are faster than an
FFT and can include the cosine window.

Source: Li, Tian, Zuo, Zhang, Yang 2018, "Learning spatial-temporal regularized correlation filters
for visual tracking", section 3; Danelljan et al. 2015, "Learning spatially regularized correlation
filters for visual tracking" (w).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames.region import read_map

ONE_THREAD = 2**18
"""Largest number of multiplications in a matrix product that OpenBLAS computes on one thread."""


def product(matrix: NDArray[np.float32], columns: NDArray[np.float32]) -> NDArray[np.float32]:
    """The matrix product, in blocks that OpenBLAS computes on one thread.

    More threads would keep a processor busy for longer than a frame takes.
    """
    block = max(ONE_THREAD // matrix.size, 1)
    result = np.empty((len(matrix), columns.shape[1]), dtype=np.float32)
    for start in range(0, columns.shape[1], block):
        result[:, start : start + block] = matrix @ columns[:, start : start + block]
    return result


Spectrum = NDArray[np.complex64]


class SquareTransform:
    """The Fourier transform of n x n squares, n even, whose axes a matrix transforms first.

    The (n, n) matrix is the identity for the transform alone.
    """

    def __init__(self, matrix: NDArray[np.float64]) -> None:
        waves = _waves(len(matrix)) @ matrix
        self._down = waves.astype(np.complex64)
        across = waves[: len(matrix) // 2 + 1].T
        # Real and imaginary parts alternate, as in complex numbers.
        parts = np.stack([across.real, across.imag], axis=-1)
        self._across = parts.reshape(len(matrix), -1).astype(np.float32)

    def apply(self, squares: NDArray[np.float32]) -> Spectrum:
        """(..., n, n // 2 + 1) half spectra of (..., n, n) real squares."""
        return self._down @ (squares @ self._across).view(np.complex64)


@cache
def transform(n: int) -> SquareTransform:
    """The Fourier transform of n x n squares, n even."""
    return SquareTransform(np.eye(n))


def invert(spectra: Spectrum) -> NDArray[np.float32]:
    """(..., n, n) real squares of (..., n, n // 2 + 1) half spectra."""
    down, across = _inverse(spectra.shape[-2])
    return (down @ spectra).view(np.float32) @ across


def _waves(n: int) -> NDArray[np.complex128]:
    return np.exp(-2j * np.pi / n * np.outer(np.arange(n), np.arange(n)))


@cache
def _inverse(n: int) -> tuple[NDArray[np.complex64], NDArray[np.float32]]:
    """The inverse matrices for columns, and for rows of alternating real and imaginary parts."""
    waves = np.conj(_waves(n)) / n
    # Middle frequencies also represent their conjugates in the other half.
    waves[1 : n // 2] *= 2.0
    half = waves[: n // 2 + 1]
    across = np.stack([half.real, -half.imag], axis=1).reshape(-1, n)
    return (np.conj(_waves(n)) / n).astype(np.complex64), across.astype(np.float32)


Value = TypeVar("Value", bound=np.inexact)

# Smallest response used as a divisor.
SMALLEST_RESPONSE = 1e-9
_MIN_PEAK_TO_SIDELOBE = 0.1


class Windows(NamedTuple):
    """Square windows of the frame with a common center, in one or two sizes.

    Attributes:
        spectra: (windows, channels, cells, cells // 2 + 1) spectra of their features.
        center: (2,) common center, image pixels.
        sides: Side of each window, image pixels, ascending.
        source: (channels, cells, cells) features of the window that was read, of which the others
            are interpolated.
        source_side: Its side, image pixels.
    """

    spectra: Spectrum
    center: NDArray[np.float64]
    sides: Sequence[float]
    source: NDArray[np.float32]
    source_side: float


class ResponseMaps(NamedTuple):
    """The filter's responses to the windows of a frame.

    Attributes:
        maps: (windows, S, S) response maps.
        expected: (S, S) mean map, approximately that of the predicted size.
        deviation: Standard deviation of `expected`, > 0.
        largest: Largest response of all maps.
    """

    maps: NDArray[np.float32]
    windows: Windows
    expected: NDArray[np.float32]
    deviation: float
    largest: float

    @classmethod
    def of(cls, maps: NDArray[np.float32], windows: Windows) -> ResponseMaps:
        """Response maps from (windows, S, S) responses."""
        expected = mean_of(maps)
        return cls(maps, windows, expected, deviation_of(expected), float(maps.max()))

    def read(
        self, centers: NDArray[np.float64], shares: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(N,) responses at (N, 2) box centers, image pixels; 0 outside of the windows.

        The (N,) shares, 0 to 1, are the weights of the largest window in the interpolation between
        sizes.
        """

        def read_one(number: int) -> NDArray[np.float32]:
            points = self._to_map(number, centers, self.windows.center)
            return read_map(self.maps[number], points, cv2.INTER_CUBIC)

        return self._interpolate_size(read_one, shares)

    def read_grid(
        self, x: NDArray[np.float64], y: NDArray[np.float64], share: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(rows, columns) responses at a grid of (columns,) x and (rows,) y, image pixels.

        The sides of the grid are below 2^15. The (1,) share is a weight as in `read`.
        """
        center = self.windows.center

        def read_one(number: int) -> NDArray[np.float32]:
            points = np.empty((len(y), len(x), 2), dtype=np.float32)
            points[..., 0] = self._to_map(number, x, center[0])
            points[..., 1] = self._to_map(number, y, center[1])[:, None]
            return cv2.remap(self.maps[number], points, None, cv2.INTER_CUBIC)

        return self._interpolate_size(read_one, share)

    def _to_map(
        self, number: int, positions: NDArray[np.float64], center: NDArray[np.float64] | np.float64
    ) -> NDArray[np.float32]:
        """Positions in a window's map, for positions in image pixels."""
        samples = len(self.maps[number])
        scale = samples / self.windows.sides[number]
        return ((positions - center) * scale + samples // 2).astype(np.float32)

    def _interpolate_size(
        self, read_one: Callable[[int], NDArray[np.float32]], shares: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Linear interpolation between the responses of the smallest and the largest window."""
        smallest = read_one(0).astype(np.float64)
        if len(self.maps) == 1:
            return smallest
        return smallest + shares * (read_one(-1) - smallest)


def mean_of(windows: NDArray[Value]) -> NDArray[Value]:
    """The mean over one or two windows."""
    return windows[0] if len(windows) == 1 else (windows[0] + windows[1]) * np.float32(0.5)


def deviation_of(values: NDArray[np.float32]) -> float:
    """Standard deviation of a response map, > 0."""
    return max(float(cv2.meanStdDev(values)[1][0, 0]), SMALLEST_RESPONSE)


def peak_to_sidelobe(value: float, deviation: float) -> float:
    """Peak-to-sidelobe ratio: a response / the standard deviation of its whole map, limited > 0.

    Source: Bolme et al. 2010, section 3.5, who exclude the peak from the deviation.
    """
    return max(value / deviation, _MIN_PEAK_TO_SIDELOBE)


# Standard deviation of the peak y, in target sizes.
_PEAK_WIDTH = 1.0 / 16.0
# The weight w inside and outside the target.
_INSIDE, _OUTSIDE = 1e-3, 1e5
# ADMM penalty in the first step, its factor from step to step, and the number of steps.
_FIRST_PENALTY, _PENALTY_GROWTH = 1.0, 10.0
_STEPS = 2
# Root mean square length of the cells' features after scaling. It sets the effect of the penalties:
# weak features make a filter that responds to what all samples have in common.
_FEATURE_SCALE = 0.294
# Energy of a window without contrast, relative to that of its channels' means: rounding has 1e-13,
# the faintest edge 1e-3.
_NO_CONTRAST = 1e-8
# Lobes of the interpolation between cells.
_LOBES = 3
# Cached peaks and weights; each shape of a target has its own.
_SHAPES = 64


def spectra_of(features: NDArray[np.float32], scale: float = 1.0) -> Spectrum:
    """(K, channels, cells, cells // 2 + 1) spectra of (K, channels, cells, cells) features.

    Each channel's mean is subtracted: it is similar in every window, so a filter trained with it
    would respond to any window. A cosine window lets the features fall to 0 at the borders. All
    channels together are scaled to a fixed energy. A window without contrast has the spectrum 0.

    With a scale, near 1, the spectra are those of windows whose sides are so many times as long,
    with features interpolated between these: cheaper than to read other windows.

    Source of the interpolation: Dollár, Appel, Belongie and Perona 2014, "Fast feature pyramids for
    object detection".
    """
    cells = features.shape[-1]
    windowed, flat = _windowed(cells, scale)
    spectra = windowed.apply(features)
    means = spectra[..., :1, :1] / flat[0, 0]
    spectra -= means * flat
    flat_energy = _half_energy(flat)
    for spectrum, its_means in zip(spectra, means, strict=True):
        energy = _half_energy(spectrum)
        if energy <= _NO_CONTRAST * flat_energy * _energy(its_means):
            spectrum[:] = 0.0
            continue
        factor = _FEATURE_SCALE * cells * cells / math.sqrt(energy)
        np.multiply(spectrum, np.float32(factor), out=spectrum)
    return spectra


def shifted(spectrum: Spectrum, shift: NDArray[np.float64]) -> Spectrum:
    """The spectrum of a window that is moved by a (2,) shift to the right and down, in cells."""
    cells = spectrum.shape[-2]
    down = np.exp(2j * np.pi * shift[1] * np.fft.fftfreq(cells)).astype(np.complex64)
    across = np.exp(2j * np.pi * shift[0] * np.fft.rfftfreq(cells)).astype(np.complex64)
    return spectrum * (down[:, None] * across)


def train(
    spectrum: Spectrum, target_cells: tuple[float, float], before: Spectrum | None, memory: float
) -> Spectrum:
    """Spectrum of the filter after one more sample, a window centered on the target.

    The target is (width, height) in cells. Without a filter before, this is the first. The memory
    is the weight mu, at least 0, of the change from it.

    Source: Li et al. 2018, equations (8) to (12).
    """
    cells = spectrum.shape[1]
    area = np.float32(cells * cells)
    peak, weight = _peak(cells, target_cells), _squared_weight(cells, target_cells)
    conjugate = np.conj(spectrum)
    energy = (conjugate * spectrum).real.sum(axis=0)
    past = np.zeros_like(spectrum) if before is None else before * np.float32(memory)
    memory = 0.0 if before is None else memory
    penalty = np.float32(_FIRST_PENALTY)
    pull = past
    dual = np.zeros_like(spectrum)
    for step in range(_STEPS):
        total = area * (penalty + np.float32(memory))
        # (x x^H + total I) f = x y + area * pull, solved for each frequency alone.
        projected = area * (conjugate * pull).sum(axis=0)
        error = (peak - (energy * peak + projected) / (energy + total)) / total
        trained = spectrum * error + pull * (area / total)
        if step < _STEPS - 1:
            inside = invert(penalty * trained + dual)
            inside *= area / (weight + area * penalty)
            inside_spectrum = transform(cells).apply(inside)
            dual = dual + penalty * (trained - inside_spectrum)
            penalty = penalty * np.float32(_PENALTY_GROWTH)
            pull = penalty * inside_spectrum - dual + past
    return trained


def response(trained: Spectrum, spectra: Spectrum, samples: int) -> NDArray[np.float32]:
    """Response maps: the correlation of filters with windows at every displacement.

    Filters and windows are (..., channels, cells, cells // 2 + 1) spectra, one filter for all or
    one per window. The maps are (..., samples, samples), with a multiple of the number of cells,
    and about 1 at the target; displacement (0, 0) is at [samples // 2, samples // 2].
    """
    cells = spectra.shape[-2]
    product = (np.conj(trained) * spectra).sum(axis=-3) * _to_middle(cells)
    refined = np.zeros((*product.shape[:-2], samples, samples // 2 + 1), dtype=np.complex64)
    half = cells // 2
    refined[..., :half, : half + 1] = product[..., :half, :]
    refined[..., -half:, : half + 1] = product[..., -half:, :]
    if samples > cells:
        # The highest frequency represents both signs, which are distinct in the refined map.
        refined[..., -half, :] *= 0.5
        refined[..., half, :] = refined[..., -half, :]
        refined[..., half] *= 0.5
    values = np.fft.irfft2(refined, s=(samples, samples))
    return np.asarray(values * np.float32((samples / cells) ** 2), dtype=np.float32)


def response_at_center(trained: Spectrum, spectrum: Spectrum) -> float:
    """The correlation of a filter with a window at displacement (0, 0)."""
    cells = spectrum.shape[1]
    product = (np.conj(trained) * spectrum).real
    total = 2.0 * product.sum() - product[..., 0].sum() - product[..., -1].sum()
    return float(total) / cells**2


def _half_energy(spectrum: Spectrum) -> float:
    """Energy of (..., n, n // 2 + 1) half spectra, and of the half that they leave out."""
    # Every column but the first and the last also represents its conjugate.
    return 2.0 * _energy(spectrum) - _energy(spectrum[..., 0]) - _energy(spectrum[..., -1])


def _energy(spectrum: Spectrum) -> float:
    return float(np.vdot(spectrum, spectrum).real)


@cache
def _windowed(cells: int, scale: float) -> tuple[SquareTransform, Spectrum]:
    """The transform with a cosine window, and its result for a square of ones."""
    windowed = SquareTransform(np.hanning(cells + 2)[1:-1, None] * _interpolation(cells, scale))
    return windowed, windowed.apply(np.ones((cells, cells), dtype=np.float32))


def _interpolation(cells: int, scale: float) -> NDArray[np.float64]:
    """(cells, cells) Lanczos weights of the cells of a row in one `scale` times as long."""
    position = np.arange(cells) - (cells - 1) / 2
    distance = scale * position[:, None] - position
    weights = np.sinc(distance) * np.sinc(distance / _LOBES) * (np.abs(distance) < _LOBES)
    return weights / weights.sum(axis=1, keepdims=True)


@cache
def _to_middle(cells: int) -> NDArray[np.float32]:
    """(cells, cells // 2 + 1) factors that move displacement (0, 0) to the middle of a map."""
    frequency = np.fft.fftfreq(cells, 1 / cells)
    signs = (-1.0) ** (frequency[:, None] + np.arange(cells // 2 + 1))
    return signs.astype(np.float32)


@lru_cache(maxsize=_SHAPES)
def _peak(cells: int, target_cells: tuple[float, float]) -> NDArray[np.float32]:
    """Real spectrum of a Gaussian peak at displacement (0, 0)."""
    displacement = np.fft.fftfreq(cells) * cells
    width = _PEAK_WIDTH * np.sqrt(target_cells[0] * target_cells[1])
    side = np.exp(-0.5 * np.square(displacement / width))
    return np.fft.rfft2(np.outer(side, side)).real.astype(np.float32)


@lru_cache(maxsize=_SHAPES)
def _squared_weight(cells: int, target_cells: tuple[float, float]) -> NDArray[np.float32]:
    """(cells, cells) w^2, small inside the target, interpolated in partly covered cells."""
    distance = np.abs(np.arange(cells) - (cells - 1) / 2)
    across, down = (np.clip(side / 2 - distance + 0.5, 0.0, 1.0) for side in target_cells)
    inside = np.outer(down, across)
    return np.square(_INSIDE * inside + _OUTSIDE * (1.0 - inside)).astype(np.float32)
