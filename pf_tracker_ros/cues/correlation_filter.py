"""Correlation filters that are kept inside the target and near their past.

A filter f is trained so that its correlation with the features x of a window around the target is
a given peak y. Found in the Fourier domain, it would also use the window's surroundings and its
periodic repetition; a weight on its values outside the target forbids that, and a weight on its
change from frame to frame lets it adapt without forgetting.

    f = argmin |y - sum_k x_k * f_k|^2 + sum_k |w f_k|^2 + mu |f - f_before|^2

Source: Li, Tian, Zuo, Zhang, Yang 2018, "Learning spatial-temporal regularized correlation filters
for visual tracking", section 3; Danelljan et al. 2015, "Learning spatially regularized correlation
filters for visual tracking" (w).

Windows of a few dozen points a side are transformed by products of matrices, which take less time
than a fast transform; whatever else is done to rows and columns, such as a window or a stretch, is
in the matrices. A response map is what the filter answers to windows of a frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

ONE_THREAD = 2**18
"""Multiplications in a matrix product up to which OpenBLAS starts no threads."""


def product(matrix: NDArray[np.float32], columns: NDArray[np.float32]) -> NDArray[np.float32]:
    """The matrix times the columns, in blocks that OpenBLAS computes on one thread.

    Its other threads would keep a processor busy for longer than a whole frame takes.
    """
    block = max(ONE_THREAD // matrix.size, 1)
    result = np.empty((len(matrix), columns.shape[1]), dtype=np.float32)
    for start in range(0, columns.shape[1], block):
        result[:, start : start + block] = matrix @ columns[:, start : start + block]
    return result


Spectrum = NDArray[np.complex64]


class SquareTransform:
    """The Fourier transform of squares to whose rows and columns a matrix is applied first.

    Args:
        matrix: (n, n), n even; the identity for the transform alone.
    """

    def __init__(self, matrix: NDArray[np.float64]) -> None:
        waves = _waves(len(matrix)) @ matrix
        self._down = waves.astype(np.complex64)
        across = waves[: len(matrix) // 2 + 1].T
        # Real and imaginary part side by side, as in the memory of complex numbers.
        parts = np.stack([across.real, across.imag], axis=-1)
        self._across = parts.reshape(len(matrix), -1).astype(np.float32)

    def apply(self, squares: NDArray[np.float32]) -> Spectrum:
        """(..., n, n // 2 + 1) spectra of (..., n, n) squares: the half that tells the other."""
        return self._down @ (squares @ self._across).view(np.complex64)


@cache
def transform(n: int) -> SquareTransform:
    """The Fourier transform of n x n squares, n even, and nothing else."""
    return SquareTransform(np.eye(n))


def invert(spectra: Spectrum) -> NDArray[np.float32]:
    """(..., n, n) squares of (..., n, n // 2 + 1) spectra."""
    down, across = _inverse(spectra.shape[-2])
    return (down @ spectra).view(np.float32) @ across


def _waves(n: int) -> NDArray[np.complex128]:
    return np.exp(-2j * np.pi / n * np.outer(np.arange(n), np.arange(n)))


@cache
def _inverse(n: int) -> tuple[NDArray[np.complex64], NDArray[np.float32]]:
    """The matrices for columns, and for rows with their halves of real and imaginary parts."""
    waves = np.conj(_waves(n)) / n
    # Those between stand for their counterparts in the other half, too.
    waves[1 : n // 2] *= 2.0
    half = waves[: n // 2 + 1]
    across = np.stack([half.real, -half.imag], axis=1).reshape(-1, n)
    return (np.conj(_waves(n)) / n).astype(np.complex64), across.astype(np.float32)


Value = TypeVar("Value", bound=np.inexact)

# How many boxes are read at once, well within what OpenCV can (2^15 - 2).
_READ_AT_ONCE = 2**14
# Responses below this share of the one to the trained window are as good as none.
SMALLEST_RESPONSE = 1e-9
_LEAST_STANDING_OUT = 0.1


class Windows(NamedTuple):
    """Square parts of the frame around the prediction.

    Attributes:
        spectra: (windows, channels, cells, cells // 2 + 1) of their features.
        expected: (channels, cells, cells // 2 + 1), of a window of the expected size, about.
        center: (2,) in image pixels.
        sides: Of each, image pixels, from small to large.
    """

    spectra: Spectrum
    expected: Spectrum
    center: NDArray[np.float64]
    sides: Sequence[float]


class ResponseMaps(NamedTuple):
    """What the filter answers to the windows around the prediction.

    Attributes:
        maps: (windows, S, S) responses.
        windows: That they are to.
        expected: (S, S) responses in the expected size.
        deviation: Their standard deviation, above 0.
        largest: Of all responses.
    """

    maps: NDArray[np.float32]
    windows: Windows
    expected: NDArray[np.float32]
    deviation: float
    largest: float

    @classmethod
    def of(cls, maps: NDArray[np.float32], windows: Windows) -> ResponseMaps:
        """Those that (windows, S, S) responses to some windows make."""
        expected = mean_of(maps)
        return cls(maps, windows, expected, deviation_of(expected), float(maps.max()))

    def read(
        self, centers: NDArray[np.float64], shares: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(N,) responses, 0 outside of the windows.

        Args:
            centers: (N, 2) in image pixels.
            shares: (N,) of the largest window in the response, 0 to 1; the rest is the smallest's.
        """

        def read_one(number: int) -> NDArray[np.float32]:
            values = self.maps[number]
            places = self._places(number, centers, self.windows.center)
            if len(places) <= _READ_AT_ONCE:
                return _interpolate(values, places[None])[0]
            parts = np.split(places, range(_READ_AT_ONCE, len(places), _READ_AT_ONCE))
            return np.concatenate([_interpolate(values, part[None])[0] for part in parts])

        return self._between(read_one, shares)

    def read_grid(
        self, x: NDArray[np.float64], y: NDArray[np.float64], share: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(rows, columns) the same of a grid, whose sides are below 2^15.

        Args:
            x: (columns,) of the centers, image pixels.
            y: (rows,) of the centers, image pixels.
            share: (1,) as in `read`.
        """
        center = self.windows.center

        def read_one(number: int) -> NDArray[np.float32]:
            places = np.empty((len(y), len(x), 2), dtype=np.float32)
            places[..., 0] = self._places(number, x, center[0])
            places[..., 1] = self._places(number, y, center[1])[:, None]
            return _interpolate(self.maps[number], places)

        return self._between(read_one, share)

    def _places(
        self, number: int, positions: NDArray[np.float64], center: NDArray[np.float64] | np.float64
    ) -> NDArray[np.float32]:
        """Positions in image pixels as those in a window's map."""
        samples = len(self.maps[number])
        scale = samples / self.windows.sides[number]
        return ((positions - center) * scale + samples // 2).astype(np.float32)

    def _between(
        self, read_one: Callable[[int], NDArray[np.float32]], shares: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """What is read of the smallest and of the largest window, by the shares of the latter."""
        smallest = read_one(0).astype(np.float64)
        if len(self.maps) == 1:
            return smallest
        return smallest + shares * (read_one(-1) - smallest)


def _interpolate(values: NDArray[np.float32], places: NDArray[np.float32]) -> NDArray[np.float32]:
    """(rows, columns) values of a map at (rows, columns, 2) places in it, 0 outside of it."""
    return cv2.remap(values, places, None, cv2.INTER_CUBIC)


def mean_of(windows: NDArray[Value]) -> NDArray[Value]:
    """The mean over one or two windows."""
    return windows[0] if len(windows) == 1 else (windows[0] + windows[1]) * np.float32(0.5)


def deviation_of(values: NDArray[np.float32]) -> float:
    """Standard deviation of a response map, above 0."""
    return max(float(cv2.meanStdDev(values)[1][0, 0]), SMALLEST_RESPONSE)


def peak_near(
    values: NDArray[np.float32], place: NDArray[np.float64], side: float, box: NDArray[np.float64]
) -> float:
    """The largest value of a response map within a quarter of a box around its center.

    Args:
        values: (S, S), of a window around a place.
        place: (4,) box, image pixels.
        side: Of the window, image pixels.
        box: (4,), image pixels.
    """
    samples = len(values)
    scale = samples / side
    center = (box[:2] + box[2:] / 2 - place[:2] - place[2:] / 2) * scale + samples // 2
    reach = np.maximum(box[2:] * scale / 4, 1.0)
    edges = np.rint([center - reach, center + reach]).astype(np.intp)
    (left, top), (right, bottom) = np.minimum(np.maximum(edges, 0), samples - 1).tolist()
    return float(values[top : bottom + 1, left : right + 1].max())


def peak_to_sidelobe(value: float, deviation: float) -> float:
    """A value of a response map in units of the map's standard deviation, kept from 0."""
    return max(value / deviation, _LEAST_STANDING_OUT)


# Width of the peak y, in target sizes.
_PEAK_WIDTH = 1.0 / 16.0
# The weights w inside and outside the target.
_INSIDE, _OUTSIDE = 1e-3, 1e5
# The penalty of the alternating direction method: at first, and its growth with every step.
_FIRST_PENALTY, _PENALTY_GROWTH = 1.0, 10.0
_STEPS = 2
# Root mean square length that the cells' features are brought to, which sets the strength of the
# penalties: weak features make a filter that answers to what the samples have in common.
_FEATURE_STRENGTH = 0.294
# Targets whose peak and weight are remembered; each new box has its own.
_TARGETS = 8


def spectra_of(features: NDArray[np.float32]) -> Spectrum:
    """(K, channels, cells, cells // 2 + 1) transforms of (K, channels, cells, cells) features.

    Each channel's mean, which is much the same in every window, is taken out: a filter that is
    trained with it answers to any window. A cosine window takes the features down to 0 at the
    borders; all channels together are then brought to one strength.
    """
    cells = features.shape[-1]
    windowed, flat = _windowed(cells)
    spectra = windowed.apply(features)
    spectra -= (spectra[..., :1, :1] / flat[0, 0]) * flat
    for seen in spectra:
        # Half of the spectrum stands for both, but for its first and its last column.
        energy = 2.0 * _energy(seen) - _energy(seen[..., 0]) - _energy(seen[..., -1])
        strength = _FEATURE_STRENGTH * cells * cells / math.sqrt(max(energy, 1e-9))
        np.multiply(seen, np.float32(strength), out=seen)
    return spectra


def train(
    seen: Spectrum, target_cells: tuple[float, float], before: Spectrum | None, memory: float
) -> Spectrum:
    """The filter after one more sample; source: Li et al. 2018, equations (8) to (12).

    Args:
        seen: Spectrum of the features of a window that is centered on the target.
        target_cells: (width, height) of the target in cells.
        before: The last filter, None for the first.
        memory: Weight mu of the change from the last filter, at least 0.

    Returns:
        The filter's spectrum.
    """
    cells = seen.shape[1]
    area = np.float32(cells * cells)
    peak, weight = _peak(cells, target_cells), _squared_weight(cells, target_cells)
    conjugate = np.conj(seen)
    energy = (conjugate * seen).real.sum(axis=0)
    past = np.zeros_like(seen) if before is None else before * np.float32(memory)
    memory = 0.0 if before is None else memory
    penalty = np.float32(_FIRST_PENALTY)
    pull = past
    dual = np.zeros_like(seen)
    for step in range(_STEPS):
        total = area * (penalty + np.float32(memory))
        # (x x^H + total I) f = x y + area * pull, solved for each frequency on its own.
        projected = area * (conjugate * pull).sum(axis=0)
        error = (peak - (energy * peak + projected) / (energy + total)) / total
        trained = seen * error + pull * (area / total)
        if step < _STEPS - 1:
            inside = invert(penalty * trained + dual)
            inside *= area / (weight + area * penalty)
            inside_spectrum = transform(cells).apply(inside)
            dual = dual + penalty * (trained - inside_spectrum)
            penalty = penalty * np.float32(_PENALTY_GROWTH)
            pull = penalty * inside_spectrum - dual + past
    return trained


def response(trained: Spectrum, seen: Spectrum, samples: int) -> NDArray[np.float32]:
    """Correlation of a filter with a window, or several, at every displacement.

    Args:
        trained: (..., channels, cells, cells // 2 + 1), as `train` gives it; one filter, or one for
            each window.
        seen: (..., channels, cells, cells // 2 + 1) spectra of the windows' features.
        samples: Along each side of the maps; a multiple of the number of cells, which it refines.

    Returns:
        (..., samples, samples), about 1 where a window holds the target, that displacement
        (0, 0) at [samples // 2, samples // 2].
    """
    cells = seen.shape[-2]
    product = (np.conj(trained) * seen).sum(axis=-3) * _to_middle(cells)
    refined = np.zeros((*product.shape[:-2], samples, samples // 2 + 1), dtype=np.complex64)
    half = cells // 2
    refined[..., :half, : half + 1] = product[..., :half, :]
    refined[..., -half:, : half + 1] = product[..., -half:, :]
    if samples > cells:
        # The highest frequency stands for both of its signs, which the refined map tells apart.
        refined[..., -half, :] *= 0.5
        refined[..., half, :] = refined[..., -half, :]
        refined[..., half] *= 0.5
    values = np.fft.irfft2(refined, s=(samples, samples))
    return np.asarray(values * np.float32((samples / cells) ** 2), dtype=np.float32)


def response_at_center(filter_spectrum: Spectrum, seen: Spectrum) -> float:
    """The correlation without any displacement."""
    cells = seen.shape[1]
    product = (np.conj(filter_spectrum) * seen).real
    total = 2.0 * product.sum() - product[..., 0].sum() - product[..., -1].sum()
    return float(total) / cells**2


def _energy(seen: Spectrum) -> float:
    return float(np.vdot(seen, seen).real)


@cache
def _windowed(cells: int) -> tuple[SquareTransform, Spectrum]:
    """The transform of squares under a cosine window, and what it makes of a square of ones."""
    windowed = SquareTransform(np.diag(np.hanning(cells + 2)[1:-1]))
    return windowed, windowed.apply(np.ones((cells, cells), dtype=np.float32))


@cache
def _to_middle(cells: int) -> NDArray[np.float32]:
    """(cells, cells // 2 + 1) factors that bring displacement (0, 0) to the middle of a map."""
    frequency = np.fft.fftfreq(cells, 1 / cells)
    signs = (-1.0) ** (frequency[:, None] + np.arange(cells // 2 + 1))
    return signs.astype(np.float32)


@lru_cache(maxsize=_TARGETS)
def _peak(cells: int, target_cells: tuple[float, float]) -> NDArray[np.float32]:
    """Spectrum, which is real, of a Gaussian peak at displacement (0, 0)."""
    place = np.fft.fftfreq(cells) * cells
    width = _PEAK_WIDTH * np.sqrt(target_cells[0] * target_cells[1])
    side = np.exp(-0.5 * np.square(place / width))
    return np.fft.rfft2(np.outer(side, side)).real.astype(np.float32)


@lru_cache(maxsize=_TARGETS)
def _squared_weight(cells: int, target_cells: tuple[float, float]) -> NDArray[np.float32]:
    """(cells, cells) w^2, small inside the target, cells that it covers in part between."""
    place = np.abs(np.arange(cells) - (cells - 1) / 2)
    across, down = (np.clip(side / 2 - place + 0.5, 0.0, 1.0) for side in target_cells)
    inside = np.outer(down, across)
    return np.square(_INSIDE * inside + _OUTSIDE * (1.0 - inside)).astype(np.float32)
