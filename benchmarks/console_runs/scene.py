"""Images for the camera of the console's benchmarks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Amplitudes fall with this power of the spatial frequency, as in natural images.
_EXPONENT = 1.5
_MEAN, _CONTRAST = 110.0, 40.0
# Contrast of the colors relative to that of the brightness.
_COLOR_CONTRAST = 0.25
# Standard deviation of the sensor noise, gray levels.
_NOISE = 3.0


def camera_like(width: int, height: int) -> NDArray[np.uint8]:
    """(height, width, 3) image with the JPEG size of a camera's.

    With the console's quality a JPEG of 768 x 576 has 65 kB, and one of noise 122 kB; the first
    frames of 22 recordings have 27 to 135 kB, in proportion to that size, the median 56.
    """
    generator = np.random.default_rng(0)
    down, across = np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None]
    frequency = np.hypot(down, across)
    frequency[0, 0] = np.inf

    def field() -> NDArray[np.float64]:
        spectrum = generator.normal(size=(2, *frequency.shape)) / frequency**_EXPONENT
        values = np.fft.irfft2(spectrum[0] + 1j * spectrum[1], (height, width))
        normalized: NDArray[np.float64] = values / values.std()
        return normalized

    brightness = field()
    colors = np.stack([brightness + _COLOR_CONTRAST * field() for _ in range(3)], axis=-1)
    noise = generator.normal(scale=_NOISE, size=colors.shape)
    return (_MEAN + _CONTRAST * colors + noise).clip(0.0, 255.0).astype(np.uint8)
