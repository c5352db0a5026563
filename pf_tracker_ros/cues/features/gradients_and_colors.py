"""Gradient directions (a compact HOG) and color names or gray levels as feature channels.

1. Gradients: a histogram of 9 unsigned directions per cell, normalized by each of the four blocks
   around it and truncated. The sums over blocks (9 directions) and over directions (4 textures) are
   projected to 11 channels.
2. Colors: the probabilities of 11 color names, projected to 5 principal components. Gray windows
   have 6 levels, relative to the window's own range, in 5 components instead.

Sources: Felzenszwalb et al. 2010, "Object detection with discriminatively trained part-based
models", section 6 (without signed directions, because the sign changes with the background; reduced
along fixed axes, as in 6.2); Berlin, Kay 1969, "Basic color terms", and van de Weijer et al. 2009,
"Learning color names for real-world applications" (the 11 color names).
"""

from __future__ import annotations

import math
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.correlation_filter import product
from pf_tracker_ros.cues.features.features import FEATURES, Calibration
from pf_tracker_ros.frames.region import all_gradients, paired_differences

_CELL_PIXELS = 4
# Direction bins over 180 degrees, and blocks of four cells around each cell.
_DIRECTIONS, _BLOCKS = 9, 4
# Channels: the mean, cosine and sine waves over the directions, and differences of the textures.
_WAVES, _DIFFERENCES = 4, 2
_GRADIENT_CHANNELS = 1 + 2 * _WAVES + _DIFFERENCES
# Steps of one gray level's gradient in integer sums; the factor of the upper direction, larger than
# any cell's sum, so that one number holds the sums of two directions.
_MAGNITUDE_STEPS, _UPPER = 2.0**15, 2.0**28
# Normalized histogram values are truncated at this.
_TRUNCATED_AT = 0.2
# Mean square gradient of sensor noise in a block, gray levels.
_NOISE = 4.0
# Weight of colors and gray levels relative to gradients.
_COLOR_WEIGHT = 0.6
# Gray levels, spread evenly over the range of the window's middle. Absolute gray values of thermal
# cameras have no meaning, and often a small range.
_GRAY_LEVELS = 6
_GRAY_PERCENTILES = (2, 98)
_SMALLEST_GRAY_RANGE = 16.0
# Levels of blue, green and red in the table of color names.
_COLOR_LEVELS = 32
# Standard deviation of the colors of one name, units of CIE Lab.
_NAME_STD = 22.0
# Color channels, and the standard deviation of the chroma of common colors, units of CIE Lab.
_COLORS, _COMMON_CHROMA = 5, 20.0
# A typical color (red, green, blue) of each name.
_NAMED_COLORS = (
    (0, 0, 0),
    (0, 0, 255),
    (139, 69, 19),
    (128, 128, 128),
    (0, 160, 0),
    (255, 140, 0),
    (255, 150, 190),
    (130, 0, 150),
    (220, 0, 0),
    (255, 255, 255),
    (255, 230, 0),
)


@FEATURES.register("gradients_and_colors")
class GradientsAndColors:
    """9 directions of gradients and 4 textures in 11 channels, 11 colors or 6 gray levels in 5."""

    cell_size = _CELL_PIXELS
    calibration = Calibration(
        even_clutter=0.135,
        even_level=0.4,
        exponent=6.5,
        odds_slope=1.38,
        even_peak_to_sidelobe=5.0,
    )

    def __init__(self) -> None:
        # Computed in advance: the tables take the time of several frames.
        _direction_tables()
        _name_table()

    def extract(self, windows: NDArray[np.uint8]) -> NDArray[np.float32]:
        """See `Features.extract`."""
        count, pixels = windows.shape[:2]
        cells, colored = pixels // _CELL_PIXELS, windows.ndim == 4
        # All windows in one column, so that operations on pixels and cells process one image.
        column = windows.reshape(count * pixels, *windows.shape[2:])
        gray = cv2.cvtColor(column, cv2.COLOR_BGR2GRAY) if colored else column
        half_size = (2 * cells, 2 * cells * count)
        half = cv2.resize(column, half_size, interpolation=cv2.INTER_AREA)
        shares = _name_shares(half) if colored else _level_shares(half, count)
        kinds = shares.shape[2]
        features = np.empty((count, _GRADIENT_CHANNELS + kinds, cells, cells), dtype=np.float32)
        _fill_gradient_channels(gray, features[:, :_GRADIENT_CHANNELS])
        rows = shares[0::2] + shares[1::2]
        sums = (rows[:, 0::2] + rows[:, 1::2]).reshape(count, cells, cells, kinds)
        features[:, _GRADIENT_CHANNELS:] = sums.transpose(0, 3, 1, 2)
        return features


def _fill_gradient_channels(gray: NDArray[np.uint8], channels: NDArray[np.float32]) -> None:
    """Fill the (K, 11, rows, columns) channels of a column of K windows."""
    count, _, rows, columns = channels.shape
    histogram = _direction_histogram(gray, (count, rows, columns))
    energy = np.einsum("dkyx,dkyx->kyx", histogram, histogram)
    padded = _with_border(energy)
    blocks = padded[:, :-1, :-1] + padded[:, 1:, :-1] + padded[:, :-1, 1:] + padded[:, 1:, 1:]
    inverse = 1.0 / np.sqrt(blocks + np.float32(_NOISE))
    normalized = np.empty((_BLOCKS, *histogram.shape), dtype=np.float32)
    for number, (down, across) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        block = inverse[:, down : down + rows, across : across + columns]
        np.multiply(histogram, block, out=normalized[number])
    np.minimum(normalized, np.float32(_TRUNCATED_AT), out=normalized)
    sums = np.empty((_DIRECTIONS + _BLOCKS, count, rows * columns), dtype=np.float32)
    normalized.sum(axis=0, out=sums[:_DIRECTIONS].reshape(histogram.shape))
    textures_shape = normalized.shape[:1] + normalized.shape[2:]
    normalized.sum(axis=1, out=sums[_DIRECTIONS:].reshape(textures_shape))
    for number, window_channels in enumerate(channels):
        projected = product(_gradient_axes(), sums[:, number])
        window_channels[...] = projected.reshape(window_channels.shape)


def _with_border(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """(K, rows + 2, columns + 2) of (K, rows, columns) values, with the border repeated."""
    count, rows, columns = values.shape
    padded = np.empty((count, rows + 2, columns + 2), dtype=np.float32)
    padded[:, 1:-1, 1:-1] = values
    padded[:, 0, 1:-1], padded[:, -1, 1:-1] = values[:, 0], values[:, -1]
    padded[..., 0], padded[..., -1] = padded[..., 1], padded[..., -2]
    return padded


@cache
def _gradient_axes() -> NDArray[np.float32]:
    """(11, 13) projection of the sums of 9 directions and 4 textures to the channels.

    The axes are orthogonal, so a filter of the 11 channels responds almost as one of all 13. The
    mean of the directions equals that of the textures, so one axis represents both; the least axis
    is omitted.
    """
    turn = 2.0 * np.pi / _DIRECTIONS * np.arange(_DIRECTIONS)
    waves = [wave(cycles * turn) for cycles in range(1, _WAVES + 1) for wave in (np.cos, np.sin)]
    axes = np.zeros((_GRADIENT_CHANNELS, _DIRECTIONS + _BLOCKS))
    axes[0, :_DIRECTIONS] = math.sqrt(0.75)
    axes[1 : 1 + 2 * _WAVES, :_DIRECTIONS] = waves
    # Upper minus lower blocks, left minus right blocks.
    axes[-2, _DIRECTIONS:] = 0.5, 0.5, -0.5, -0.5
    axes[-1, _DIRECTIONS:] = 0.5, -0.5, 0.5, -0.5
    return (axes / math.sqrt(2 * _DIRECTIONS)).astype(np.float32)


def _direction_histogram(
    gray: NDArray[np.uint8], cells: tuple[int, int, int]
) -> NDArray[np.float32]:
    """(9, K, rows, columns) mean gradient magnitudes, shared by the two nearest directions.

    The gray levels are a (K * pixels, pixels) column of K windows of (rows, columns) cells.
    """
    count, rows, columns = cells
    pair = _paired_differences(gray, count).ravel().astype(np.intp)
    first, shares = _direction_tables()
    bins = _first_bins(count * rows, columns) + first.take(pair)
    sums = np.bincount(bins, shares.take(pair), count * rows * columns * (_DIRECTIONS + 1))
    upper = np.floor(sums * (1.0 / _UPPER))
    lower = sums - upper * _UPPER
    lower[1:] += upper[:-1]
    histogram = lower.reshape(-1, _DIRECTIONS + 1)
    # Directions are cyclic: the one after the last is the first.
    histogram[:, 0] += histogram[:, _DIRECTIONS]
    means = np.ascontiguousarray(histogram.T[:_DIRECTIONS], np.float32)
    means *= np.float32(1.0 / (_MAGNITUDE_STEPS * _CELL_PIXELS**2))
    return means.reshape(_DIRECTIONS, *cells)


def _paired_differences(gray: NDArray[np.uint8], count: int) -> NDArray[np.float32]:
    """`paired_differences` of a column of windows, without gradients between windows."""
    if count == 1:
        return paired_differences(gray)
    windows = gray.reshape(count, -1, gray.shape[1])
    padded = np.empty((count, windows.shape[1] + 2, gray.shape[1]), dtype=np.uint8)
    padded[:, 1:-1] = windows
    # The border is reflected, as at an image's border.
    padded[:, 0], padded[:, -1] = windows[:, 1], windows[:, -2]
    return paired_differences(padded.reshape(-1, gray.shape[1])).reshape(padded.shape)[:, 1:-1]


@cache
def _first_bins(rows: int, columns: int) -> NDArray[np.intp]:
    """(pixels,) index of the first bin of each pixel's cell."""
    row = np.repeat(np.arange(rows), _CELL_PIXELS)
    column = np.repeat(np.arange(columns), _CELL_PIXELS)
    return ((row[:, None] * columns + column) * (_DIRECTIONS + 1)).ravel()


@cache
def _direction_tables() -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """By `paired_differences` index: the lower direction, and the magnitude's two shares.

    The shares of the lower and the upper direction are integers a and b, combined as
    a + b * `_UPPER`, so that one sum adds both.
    """
    magnitude, angles = all_gradients()
    position = angles % np.pi * (_DIRECTIONS / np.pi)
    first = np.minimum(np.floor(position), _DIRECTIONS - 1)
    share = position - first
    upper = np.rint(_MAGNITUDE_STEPS * magnitude * share)
    lower = np.rint(_MAGNITUDE_STEPS * magnitude * (1.0 - share))
    return first.astype(np.uint8), lower + _UPPER * upper


def _name_shares(half: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(h, w, 5) color channels of (h, w, 3) pixels."""
    blue, green, red = cv2.split(half // (256 // _COLOR_LEVELS))
    index = (blue.astype(np.intp) * _COLOR_LEVELS + green) * _COLOR_LEVELS + red
    return _name_table().take(index, axis=0)


def _level_shares(half: NDArray[np.uint8], count: int) -> NDArray[np.float32]:
    """(K * h, h, 5) gray channels of K windows, relative to the range of each one's middle."""
    side = half.shape[1]
    windows, border = half.reshape(count, side, side), side // 4
    middle = windows[:, border : side - border, border : side - border].reshape(count, -1)
    low, high = np.percentile(middle, _GRAY_PERCENTILES, axis=1)[..., None, None]
    scale = 255.0 / np.maximum(high - low, _SMALLEST_GRAY_RANGE)
    value = np.rint(np.clip((windows - low) * scale, 0.0, 255.0)).astype(np.intp)
    return _level_table().take(value.reshape(half.shape), axis=0)


@cache
def _name_table() -> NDArray[np.float32]:
    """(colors, 5) principal components of the probabilities of the names of each color.

    They are scaled to a quarter of `_COLOR_WEIGHT`; a cell sums four values.
    """
    step = 256 // _COLOR_LEVELS
    level = (np.arange(_COLOR_LEVELS) * step + step / 2) / 255
    blue, green, red = np.meshgrid(level, level, level, indexing="ij")
    colors = np.stack([red, green, blue], axis=-1).reshape(-1, 3)
    named = np.array(_NAMED_COLORS) / 255
    lab = _lab(colors)
    distance = np.linalg.norm(lab[:, None] - _lab(named)[None], axis=2)
    probability = np.exp(-0.5 * np.square(distance / _NAME_STD))
    probability /= probability.sum(axis=1, keepdims=True) + 1e-9
    chroma = np.linalg.norm(lab[:, 1:], axis=1)
    frequency = np.exp(-0.5 * np.square(chroma / _COMMON_CHROMA))
    principal = _principal_components(probability, frequency, _COLORS)
    return (0.25 * _COLOR_WEIGHT * principal).astype(np.float32)


@cache
def _level_table() -> NDArray[np.float32]:
    """(256, 5) principal components of the shares of the levels of each gray value."""
    value = np.linspace(0.0, _GRAY_LEVELS - 1, 256)[:, None]
    shares = np.clip(1.0 - np.abs(value - np.arange(_GRAY_LEVELS)), 0.0, 1.0)
    # The shares sum to 1, so one component less represents them all.
    principal = _principal_components(shares, np.ones(len(shares)), _GRAY_LEVELS - 1)
    return (0.25 * _COLOR_WEIGHT * principal).astype(np.float32)


def _principal_components(
    entries: NDArray[np.float64], weights: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """(N, count) principal components of (N, D) entries with (N,) weights."""
    centered = entries - np.average(entries, axis=0, weights=weights)
    _, axes = np.linalg.eigh((centered * weights[:, None]).T @ centered)
    # The largest come last.
    return centered @ axes[:, : -count - 1 : -1]


def _lab(colors: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3) CIE Lab of (N, 3) red, green, blue from 0 to 1."""
    return cv2.cvtColor(colors[None].astype(np.float32), cv2.COLOR_RGB2Lab)[0].astype(np.float64)
