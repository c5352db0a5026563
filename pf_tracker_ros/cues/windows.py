"""Parts of an image, brought to a number of pixels whatever their size."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

# How many image pixels one pixel of a window may stand for before they are averaged first.
_UNREDUCED = 1.75


class Crop:
    """A rectangular part of an image from which windows are read.

    Where a window has fewer pixels than the image, the image's are averaged, not skipped: the crop
    is reduced by whole factors that suit windows of its own size.

    Args:
        image: (H, W, 3) BGR or (H, W) gray, uint8.
        center: (2,) x and y of the middle, image pixels; may be outside the image.
        sides: (2,) width and height, image pixels.
        pixels: Along each side of the windows to be read.
        gray: Whether colors are of no interest.
    """

    def __init__(
        self,
        image: NDArray[np.uint8],
        center: NDArray[np.float64],
        sides: NDArray[np.float64],
        pixels: int,
        gray: bool = False,
    ) -> None:
        image_size = np.array([image.shape[1], image.shape[0]])
        start = np.floor(center - sides / 2).astype(np.intp) - 1
        start = np.minimum(np.maximum(start, 0), image_size - 1)
        end = np.ceil(center + sides / 2).astype(np.intp) + 1
        end = np.maximum(np.minimum(end, image_size), start + 1)
        crop = image[start[1] : end[1], start[0] : end[0]]
        if gray and crop.ndim == 3:
            crop = cv2.cvtColor(crop, cv2.COLOR_BGR2GRAY)
        reduction = np.maximum((sides / pixels + 2.0 - _UNREDUCED).astype(np.intp), 1)
        if (reduction > 1).any():
            width, height = np.maximum((end - start) // reduction, 1).tolist()
            crop = cv2.resize(crop, (width, height), interpolation=cv2.INTER_AREA)
        self._pixels = crop
        self._start = start
        self._scale = np.array([crop.shape[1], crop.shape[0]]) / (end - start)

    def window(
        self, center: NDArray[np.float64], sides: NDArray[np.float64], pixels: int
    ) -> NDArray[np.uint8]:
        """The window of a (2,) center and (2,) sides, in image pixels.

        Returns:
            (pixels, pixels, 3) or (pixels, pixels); what is outside repeats the crop's border.
        """
        step = sides / pixels
        first = (center - sides / 2 + step / 2 - self._start) * self._scale - 0.5
        across, down = step * self._scale
        return cv2.warpAffine(
            self._pixels,
            np.array([[across, 0.0, first[0]], [0.0, down, first[1]]]),
            (pixels, pixels),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
