"""A hand-held camera: it shakes, its exposure drifts, its sensor is noisy."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from scenes.textures import smooth_path

_NOISE_MARGIN = 64
# OpenCV interpolates at multiples of 1/32 pixel; offsets on that grid are applied exactly.
_STEPS_PER_PIXEL = 32


class HandheldCamera:
    """Cuts images of a (width, height) out of a world that is larger by a margin on every side.

    The shake turns the camera, so near and far things move alike in the image. It and the margin
    are in pixels, the lighting is a share of the brightness, the noise is in gray levels; all three
    are standard deviations.
    """

    def __init__(
        self,
        generator: np.random.Generator,
        *,
        size: tuple[int, int],
        margin: int,
        frames: int,
        shake: float,
        lighting: float,
        noise: float,
    ):
        self._size = size
        sway = smooth_path(generator, frames, period=24.0, columns=2)
        tremor = smooth_path(generator, frames, period=5.0, columns=2)
        reach = margin - 1.0
        offsets = np.clip(shake * (sway + 0.12 * tremor), -reach, reach) + margin
        self.offsets = np.round(offsets * _STEPS_PER_PIXEL) / _STEPS_PER_PIXEL
        """(frames, 2): (x, y) of the image's top-left pixel in the world, in pixel indices."""
        drift = smooth_path(generator, frames, period=60.0)[:, 0]
        self.gains = np.clip(1.0 + lighting * drift, 0.5, 1.5)
        """(frames,): brightness of each image over the world's."""
        self._noise_starts = generator.integers(0, _NOISE_MARGIN, (frames, 2))
        pool_shape = (size[1] + _NOISE_MARGIN, size[0] + _NOISE_MARGIN, 3)
        pool = noise * generator.standard_normal(pool_shape, dtype=np.float32)
        self._noise_pool = np.round(pool).astype(np.int16)

    def shoot(self, world: NDArray[np.uint8], index: int) -> NDArray[np.uint8]:
        """The image of frame `index`: (height, width, 3) uint8, blue, green, red."""
        x, y = self.offsets[index]
        transform = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        image = cv2.warpAffine(world, transform, self._size, flags=flags)
        image = cv2.convertScaleAbs(image, alpha=float(self.gains[index]))
        row, column = self._noise_starts[index]
        width, height = self._size
        noise = self._noise_pool[row : row + height, column : column + width]
        return np.asarray(cv2.add(image, noise, dtype=cv2.CV_8U), np.uint8)
