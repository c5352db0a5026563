"""Edge directions, and colors or gray levels, as channels.

Sources: Felzenszwalb et al. 2010, "Object detection with discriminatively trained part-based
models", section 6 (without the channels that tell a gradient's sign, which changes with the
background; reduced along fixed axes, as in 6.2); Berlin, Kay 1969, "Basic color terms", and van de
Weijer et al. 2009, "Learning color names for real-world applications" (the 11 colors that languages
have a name for).
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
# Over 180 degrees; and the blocks of four cells that each cell is in.
_DIRECTIONS, _BLOCKS = 9, 4
# Channels that tell the directions, as waves over them, and how the textures differ.
_WAVES, _DIFFERENCES = 4, 2
_GRADIENT_CHANNELS = 1 + 2 * _WAVES + _DIFFERENCES
# Steps that a gray level's gradient is counted in; and by how much more than all of a cell's may
# come to, the sums of two directions are told apart in one number.
_MAGNITUDE_STEPS, _UPPER = 2.0**15, 2.0**28
# Largest value of a channel after division by a block's length.
_CUT = 0.2
# Mean square gradient of a block, in gray levels, that counts as much as the sensor's noise.
_NOISE = 4.0
# Colors and gray levels have this weight beside gradients.
_COLOR_WEIGHT = 0.6
# Gray levels, evenly spread over the range of the window's middle: a thermal camera's gray values
# mean nothing in themselves, and often use a small part of their range.
_GRAY_LEVELS = 6
_GRAY_PERCENTILES = (2, 98)
_SMALLEST_GRAY_RANGE = 16.0
# Levels of blue, green and red in the table of color names.
_COLOR_LEVELS = 32
# How far, in units of CIE Lab, a color's name reaches.
_NAME_REACH = 22.0
# Channels that tell the colors' names apart, and how far from gray common colors are, in units of
# CIE Lab.
_COLORS, _COMMON_CHROMA = 5, 20.0
# A typical color of each name: red, green, blue.
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
        odds_slope=1.0,
        even_peak_to_sidelobe=8.0,
        first_odds_slope=2.0,
        even_first_peak_to_sidelobe=4.3,
        level_odds_slope=50.0,
        least_level=0.25,
    )

    def __init__(self) -> None:
        # They take several frames' time, which the first frame of a target does not have.
        _direction_tables()
        _name_table()

    def extract(self, windows: NDArray[np.uint8]) -> NDArray[np.float32]:
        """See `Features.extract`."""
        count, pixels = windows.shape[:2]
        cells, colored = pixels // _CELL_PIXELS, windows.ndim == 4
        # One below the other, so that what looks at single pixels and cells sees one image.
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
    """Fill (K, 11, rows, columns) channels of K windows one below the other."""
    count, _, rows, columns = channels.shape
    histogram = _direction_histogram(gray, (count, rows, columns))
    energy = np.einsum("dkyx,dkyx->kyx", histogram, histogram)
    padded = _with_border(energy)
    blocks = padded[:, :-1, :-1] + padded[:, 1:, :-1] + padded[:, :-1, 1:] + padded[:, 1:, 1:]
    inverse = 1.0 / np.sqrt(blocks + np.float32(_NOISE))
    cut = np.empty((_BLOCKS, *histogram.shape), dtype=np.float32)
    for number, (down, across) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        block = inverse[:, down : down + rows, across : across + columns]
        np.multiply(histogram, block, out=cut[number])
    np.minimum(cut, np.float32(_CUT), out=cut)
    sums = np.empty((_DIRECTIONS + _BLOCKS, count, rows * columns), dtype=np.float32)
    cut.sum(axis=0, out=sums[:_DIRECTIONS].reshape(histogram.shape))
    cut.sum(axis=1, out=sums[_DIRECTIONS:].reshape(cut.shape[:1] + cut.shape[2:]))
    for number, of_window in enumerate(channels):
        of_window[...] = product(_gradient_axes(), sums[:, number]).reshape(of_window.shape)


def _with_border(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """(K, rows + 2, columns + 2) of (K, rows, columns) values, those at the border repeated."""
    count, rows, columns = values.shape
    padded = np.empty((count, rows + 2, columns + 2), dtype=np.float32)
    padded[:, 1:-1, 1:-1] = values
    padded[:, 0, 1:-1], padded[:, -1, 1:-1] = values[:, 0], values[:, -1]
    padded[..., 0], padded[..., -1] = padded[..., 1], padded[..., -2]
    return padded


@cache
def _gradient_axes() -> NDArray[np.float32]:
    """(11, 13) what each channel takes of the sums of 9 directions and 4 textures.

    The axes are orthogonal, so that a filter of these channels answers as one of all 13 would, but
    for the least of them, which is left out. The mean of the directions is that of the textures,
    and stands for both.
    """
    turn = 2.0 * np.pi / _DIRECTIONS * np.arange(_DIRECTIONS)
    waves = [wave(cycles * turn) for cycles in range(1, _WAVES + 1) for wave in (np.cos, np.sin)]
    axes = np.zeros((_GRADIENT_CHANNELS, _DIRECTIONS + _BLOCKS))
    axes[0, :_DIRECTIONS] = math.sqrt(0.75)
    axes[1 : 1 + 2 * _WAVES, :_DIRECTIONS] = waves
    # The textures of the blocks above and below, and of those to the left and to the right.
    axes[-2, _DIRECTIONS:] = 0.5, 0.5, -0.5, -0.5
    axes[-1, _DIRECTIONS:] = 0.5, -0.5, 0.5, -0.5
    return (axes / math.sqrt(2 * _DIRECTIONS)).astype(np.float32)


def _direction_histogram(
    gray: NDArray[np.uint8], cells: tuple[int, int, int]
) -> NDArray[np.float32]:
    """(9, K, rows, columns) mean gradient magnitude, shared between the two nearest directions.

    Args:
        gray: (pixels, pixels) of K windows one below the other.
        cells: (K, rows, columns).
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
    # The direction after the last is the first.
    histogram[:, 0] += histogram[:, _DIRECTIONS]
    means = np.ascontiguousarray(histogram.T[:_DIRECTIONS], np.float32)
    means *= np.float32(1.0 / (_MAGNITUDE_STEPS * _CELL_PIXELS**2))
    return means.reshape(_DIRECTIONS, *cells)


def _paired_differences(gray: NDArray[np.uint8], count: int) -> NDArray[np.float32]:
    """Those of `paired_differences`, none across the border between two of so many windows."""
    if count == 1:
        return paired_differences(gray)
    windows = gray.reshape(count, -1, gray.shape[1])
    apart = np.empty((count, windows.shape[1] + 2, gray.shape[1]), dtype=np.uint8)
    apart[:, 1:-1] = windows
    # A window's first and last row then have the same on either side, as at an image's border.
    apart[:, 0], apart[:, -1] = windows[:, 1], windows[:, -2]
    return paired_differences(apart.reshape(-1, gray.shape[1])).reshape(apart.shape)[:, 1:-1]


@cache
def _first_bins(rows: int, columns: int) -> NDArray[np.intp]:
    """(pixels,) number of the first bin of each pixel's cell."""
    row = np.repeat(np.arange(rows), _CELL_PIXELS)
    column = np.repeat(np.arange(columns), _CELL_PIXELS)
    return ((row[:, None] * columns + column) * (_DIRECTIONS + 1)).ravel()


@cache
def _direction_tables() -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """For any two 8-bit differences the direction below, and the magnitude's shares.

    Both shares are whole numbers of steps in one number: that of the direction above counts
    `_UPPER`. So one sum adds up both.
    """
    magnitude, angles = all_gradients()
    place = angles % np.pi * (_DIRECTIONS / np.pi)
    first = np.minimum(np.floor(place), _DIRECTIONS - 1)
    share = place - first
    upper = np.rint(_MAGNITUDE_STEPS * magnitude * share)
    lower = np.rint(_MAGNITUDE_STEPS * magnitude * (1.0 - share))
    return first.astype(np.uint8), lower + _UPPER * upper


def _name_shares(half: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(h, w, 5) which names fit each of (h, w, 3) pixels."""
    blue, green, red = cv2.split(half // (256 // _COLOR_LEVELS))
    number = (blue.astype(np.intp) * _COLOR_LEVELS + green) * _COLOR_LEVELS + red
    return _name_table().take(number, axis=0)


def _level_shares(half: NDArray[np.uint8], count: int) -> NDArray[np.float32]:
    """(K * h, h, 5) which levels of the middle's range are near each pixel of K windows."""
    side = half.shape[1]
    windows, border = half.reshape(count, side, side), side // 4
    middle = windows[:, border : side - border, border : side - border].reshape(count, -1)
    low, high = np.percentile(middle, _GRAY_PERCENTILES, axis=1)[..., None, None]
    scale = 255.0 / np.maximum(high - low, _SMALLEST_GRAY_RANGE)
    place = np.rint(np.clip((windows - low) * scale, 0.0, 255.0)).astype(np.intp)
    return _level_table().take(place.reshape(half.shape), axis=0)


@cache
def _name_table() -> NDArray[np.float32]:
    """(colors, 5) the principal components of how well each name fits each color.

    All names come to a quarter of `_COLOR_WEIGHT`.
    """
    step = 256 // _COLOR_LEVELS
    level = (np.arange(_COLOR_LEVELS) * step + step / 2) / 255
    blue, green, red = np.meshgrid(level, level, level, indexing="ij")
    colors = np.stack([red, green, blue], axis=-1).reshape(-1, 3)
    named = np.array(_NAMED_COLORS) / 255
    lab = _lab(colors)
    distance = np.linalg.norm(lab[:, None] - _lab(named)[None], axis=2)
    fit = np.exp(-0.5 * np.square(distance / _NAME_REACH))
    fit /= fit.sum(axis=1, keepdims=True) + 1e-9
    chroma = np.linalg.norm(lab[:, 1:], axis=1)
    commonness = np.exp(-0.5 * np.square(chroma / _COMMON_CHROMA))
    return (0.25 * _COLOR_WEIGHT * _principal(fit, commonness, _COLORS)).astype(np.float32)


@cache
def _level_table() -> NDArray[np.float32]:
    """(256, 5) the same of how near each place in the range is to each level."""
    place = np.linspace(0.0, _GRAY_LEVELS - 1, 256)[:, None]
    near = np.clip(1.0 - np.abs(place - np.arange(_GRAY_LEVELS)), 0.0, 1.0)
    # The shares come to 1 everywhere, so that one of them follows from the others.
    principal = _principal(near, np.ones(len(near)), _GRAY_LEVELS - 1)
    return (0.25 * _COLOR_WEIGHT * principal).astype(np.float32)


def _principal(
    entries: NDArray[np.float64], commonness: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """(N, count) principal components of (N, D) entries, each of which is (N,) common."""
    centered = entries - np.average(entries, axis=0, weights=commonness)
    _, axes = np.linalg.eigh((centered * commonness[:, None]).T @ centered)
    # The largest come last.
    components: NDArray[np.float64] = centered @ axes[:, : -count - 1 : -1]
    return components


def _lab(colors: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3) CIE Lab of (N, 3) red, green, blue from 0 to 1."""
    return cv2.cvtColor(colors[None].astype(np.float32), cv2.COLOR_RGB2Lab)[0].astype(np.float64)
