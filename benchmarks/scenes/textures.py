"""Random textures of surfaces in a scene."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray


def fractal_noise(
    generator: np.random.Generator,
    shape: tuple[int, int],
    coarsest: float,
    octaves: int = 4,
    persistence: float = 0.55,
) -> NDArray[np.float32]:
    """Smooth noise with detail at several scales, as stone, plaster or foliage has.

    Args:
        generator: Source of randomness.
        shape: (height, width) of the texture in pixels.
        coarsest: Size of the largest blobs in pixels.
        octaves: Number of scales; each is half as large as the one before.
        persistence: Amplitude of a scale over that of the one before, 0 to 1.

    Returns:
        (height, width) float32, scaled to cover 0 to 1.
    """
    height, width = shape
    total = np.zeros(shape, np.float32)
    amplitude = 1.0
    for octave in range(octaves):
        cell = max(coarsest / 2**octave, 1.0)
        grid_shape = (int(height / cell) + 2, int(width / cell) + 2)
        grid = generator.random(grid_shape, dtype=np.float32)
        total += amplitude * cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC)
        amplitude *= persistence
    low, high = float(total.min()), float(total.max())
    return (total - low) / max(high - low, 1e-6)


def smooth_path(
    generator: np.random.Generator, frames: int, period: float, columns: int = 1
) -> NDArray[np.float64]:
    """(frames, columns) random curves without jumps, of unit standard deviation and zero mean.

    The period is the shortest time in frames over which a curve turns round, roughly.
    """
    sigma = period / 4.0
    reach = int(np.ceil(4.0 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    # White noise filtered by a kernel of unit energy keeps unit variance.
    kernel /= np.sqrt(np.sum(kernel**2))
    white = generator.standard_normal((frames + 2 * reach, columns))
    return np.stack([np.convolve(column, kernel, mode="valid") for column in white.T], axis=1)
