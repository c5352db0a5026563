"""Correlation filters that are kept inside the target and near their past.

A filter f is trained so that its correlation with the features x of a window around the target is
a given peak y. Found in the Fourier domain, it would also use the window's surroundings and its
periodic repetition; a weight on its values outside the target forbids that, and a weight on its
change from frame to frame lets it adapt without forgetting.

    f = argmin |y - sum_k x_k * f_k|^2 + sum_k |w f_k|^2 + mu |f - f_before|^2

Source: Li, Tian, Zuo, Zhang, Yang 2018, "Learning spatial-temporal regularized correlation filters
for visual tracking", section 3; Danelljan et al. 2015, "Learning spatially regularized correlation
filters for visual tracking" (w).
"""

from __future__ import annotations

import math
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.square_transform import Spectrum, SquareTransform, invert, transform

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
