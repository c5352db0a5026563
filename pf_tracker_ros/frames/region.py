"""What the cues read around the particles, each map computed once.

N particles overlap heavily, so pixels are turned into what a cue needs once a frame, and each
particle then only reads. A map is computed when a cue first asks for it.

Gradients of 8-bit gray levels are read from tables of the differences of a pixel's neighbors, which
is faster than working them out, and exact on the borders between two directions. Windows are parts
of a frame, brought to a number of pixels whatever their size.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, cached_property
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.frames.frame import Frame, PixelRect

_LARGEST = 255
_VALUES = 2 * _LARGEST + 1
NO_GRADIENT = _LARGEST * _VALUES + _LARGEST
"""The number of two differences of 0."""
# The gradient of the smallest possible window. All such numbers are exact in single precision.
_KERNEL = np.array([[0, -_VALUES, 0], [-1, 0, 1], [0, _VALUES, 0]], dtype=np.float32)


def paired_differences(gray: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(H, W) whole numbers for (H, W) gray levels, the rows of tables over `all_gradients`.

    That of a pixel is (down + 255) * 511 + right + 255, with the differences of its neighbors below
    and above, and of those to the right and to the left, both from -255 to 255.
    """
    return cv2.filter2D(gray, cv2.CV_32F, _KERNEL, delta=NO_GRADIENT)


def all_gradients() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(511 * 511,) magnitudes, gray levels, and angles, -pi to pi, of any two differences."""
    values = np.arange(-_LARGEST, _LARGEST + 1)
    magnitudes = np.hypot(values[:, None], values[None])
    angles = np.arctan2(values[:, None], values[None])
    return magnitudes.ravel(), angles.ravel()


# How many image pixels one pixel of a window may stand for before they are averaged first.
_UNREDUCED = 1.75


def read_window(
    frame: Frame, center: NDArray[np.float64], side: float, pixels: int, gray: bool = False
) -> NDArray[np.uint8]:
    """A square part of a frame, with as many pixels as asked for.

    Where that is fewer than the image has, the image's are averaged, not skipped.

    Args:
        frame: To look at.
        center: (2,) x and y of the middle, image pixels; may be outside the image.
        side: Image pixels.
        pixels: Along each side of the window.
        gray: Whether colors are of no interest.

    Returns:
        (pixels, pixels, 3) or (pixels, pixels); what is outside repeats the image's border.
    """
    reduction = max(int(side / pixels + 2.0 - _UNREDUCED), 1)
    # From here on in pixels of the reduced view.
    center, side = center / reduction, side / reduction
    (left, right), (top, bottom) = (
        _inside(middle - side / 2, middle + side / 2, -(-length // reduction))
        for middle, length in zip(center, frame.size, strict=True)
    )
    crop = frame.view(PixelRect(top, bottom, left, right), reduction)
    if gray and crop.ndim == 3:
        crop = cv2.cvtColor(crop, cv2.COLOR_BGR2GRAY)
    step = side / pixels
    first = center - side / 2 + step / 2 - (left, top) - 0.5
    return cv2.warpAffine(
        crop,
        np.array([[step, 0.0, first[0]], [0.0, step, first[1]]]),
        (pixels, pixels),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )


def _inside(start: float, end: float, length: int) -> tuple[int, int]:
    """The whole pixels from before the start to behind the end, at least one, inside a length."""
    first = min(max(math.floor(start) - 1, 0), length - 1)
    return first, max(min(math.ceil(end) + 1, length), first + 1)


Map = TypeVar("Map")
Value = TypeVar("Value", bound=np.generic)

# Derivatives look one pixel further than the boxes do, smoothed ones two.
_MARGIN = 2
# Of a gradient, in halves of a gray level.
_LARGEST_MAGNITUDE = 255
# Whole numbers that single precision tells apart.
_EXACT_UP_TO = 2**24


class Region:
    """The region of a frame that a set of boxes covers, and the maps computed from it.

    Pixels outside the image belong to the region too where a box reaches there: maps say what they
    hold for them.

    Args:
        frame: The whole image.
        boxes: (N, 4) boxes (x, y, width, height) in pixels, all of which the region covers; each
            overlaps the image.
        reduction: Whole number of image pixels that one region pixel averages along each axis;
            above 1 for targets so large that full resolution would only cost time.
        context_margin: How far beyond each side of a box the region covers, in box sides.
        predicted_box: See the property; None for the mean of the boxes. Where it is given, the region
            covers every box in its size too, for the cues that look at it so.
        estimates_size: Whether the target's size is asked for, too; a cue that reads the image once
            for each size reads it only once where it is not.

    Attributes:
        frame: As given.
        pixels: The region inside the image, (h, w, 3) or (h, w) uint8, reduced.
        padding: (top, bottom, left, right) region pixels outside the image.
        estimates_size: As given.
    """

    def __init__(
        self,
        frame: Frame,
        boxes: NDArray[np.float64],
        reduction: int = 1,
        context_margin: float = 0.0,
        *,
        predicted_box: NDArray[np.float64] | None = None,
        estimates_size: bool = True,
    ) -> None:
        width, height = frame.size
        self._boxes, self._place = boxes, predicted_box
        if predicted_box is not None:
            given, boxes = boxes, np.empty(boxes.shape)
            np.maximum(given[:, 2:], predicted_box[2:], out=boxes[:, 2:])
            boxes[:, :2] = given[:, :2] + (given[:, 2:] - boxes[:, 2:]) / 2
        x, y, widths, heights = boxes.T
        left, right = _covered(x, widths, context_margin, reduction)
        top, bottom = _covered(y, heights, context_margin, reduction)
        inside = PixelRect(
            max(top, 0),
            min(bottom, -(-height // reduction)),
            max(left, 0),
            min(right, -(-width // reduction)),
        )
        self.frame = frame
        self.estimates_size = estimates_size
        self.pixels: NDArray[np.uint8] = frame.view(inside, reduction)
        self.padding = (
            inside.top - top,
            bottom - inside.bottom,
            inside.left - left,
            right - inside.right,
        )
        self._corner = np.array([left, top, 0.0, 0.0])
        self._reduction = reduction
        self._shared: dict[object, object] = {}

    @cached_property
    def predicted_box(self) -> NDArray[np.float64]:
        """(4,) box of the target as it is expected in this frame."""
        return self._boxes.mean(axis=0) if self._place is None else self._place

    def region_boxes(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 4) boxes in image pixels as (x, y, width, height) in region pixels."""
        if self._reduction > 1:
            boxes = boxes / self._reduction
        return boxes - self._corner

    def cached(self, key: object, compute: Callable[[], Map]) -> Map:
        """The map stored under `key`, computed at the first call and shared by all who ask."""
        if key not in self._shared:
            self._shared[key] = compute()
        return self._shared[key]  # type: ignore[return-value]

    def store(self, key: object, value: object) -> None:
        """Store what was computed elsewhere, for all who ask for it by `cached`."""
        self._shared[key] = value

    @property
    def gray(self) -> NDArray[np.uint8]:
        """(h, w) uint8 brightness of `pixels`."""
        if self.pixels.ndim == 2:
            return self.pixels
        return self.cached("gray", lambda: cv2.cvtColor(self.pixels, cv2.COLOR_BGR2GRAY))

    @property
    def color(self) -> NDArray[np.uint8]:
        """(h, w, 3) uint8 BGR of `pixels`, a gray one with equal channels."""
        if self.pixels.ndim == 3:
            return self.pixels
        return self.cached("color", lambda: cv2.cvtColor(self.pixels, cv2.COLOR_GRAY2BGR))

    @property
    def foreground_pixels(self) -> NDArray[np.bool_] | None:
        """(h, w) whether each of `pixels` is foreground; None where there is no model.

        The mask has a scale of its own: the pixel of it below the center of each is asked.
        """
        if self.frame.foreground is None:
            return None
        mask, reduction = self.frame.foreground
        corner = self._corner[:2] + (self.padding[2], self.padding[0])
        rows, columns = (
            np.minimum(
                ((start + np.arange(count) + 0.5) * self._reduction / reduction).astype(np.intp),
                last - 1,
            )
            for start, count, last in zip(
                corner[::-1], self.pixels.shape[:2], mask.shape, strict=True
            )
        )
        return mask[np.ix_(rows, columns)] > 0

    def color_bins(self, levels: int) -> NDArray[np.intp]:
        """(h, w) color of each of `pixels`, each of R, G and B in `levels` equal steps.

        A color's number is red * levels^2 + green * levels + blue.

        Args:
            levels: At most 256, so that single precision tells all colors apart.
        """

        def compute() -> NDArray[np.intp]:
            steps = cv2.LUT(self.color, _color_steps(levels))
            return cv2.transform(steps, np.array([[1.0, levels, levels**2]])).astype(np.intp)

        return self.cached(("color bins", levels), compute)

    def pad(self, values: NDArray[Value]) -> NDArray[Value]:
        """(h, w) values of `pixels` with zeros around for what is outside the image."""
        if not any(self.padding):
            return values
        return cv2.copyMakeBorder(values, *self.padding, cv2.BORDER_CONSTANT, value=0)

    def differences(self, smoothed: bool = False) -> NDArray[np.intp]:
        """(h, w) differences of each pixel's neighbors, over the padded region, as one number.

        The number is that of `paired_differences`. Outside the image both are 0.

        Args:
            smoothed: Whether each pixel is first averaged with its eight neighbors, with the
                binomial weights 1, 2, 1 along each axis.
        """

        def compute() -> NDArray[np.intp]:
            gray = cv2.GaussianBlur(self.gray, (3, 3), 0.0) if smoothed else self.gray
            numbers = paired_differences(gray)
            if any(self.padding):
                numbers = cv2.copyMakeBorder(
                    numbers, *self.padding, cv2.BORDER_CONSTANT, value=NO_GRADIENT
                )
            return numbers.astype(np.intp)

        return self.cached(("differences", smoothed), compute)

    def gradient_integral(self, directions: int) -> NDArray[np.float32] | NDArray[np.int32]:
        """Integral image of the gradient magnitude in each direction.

        A pixel's gradient magnitude, in halves of a gray level and at most 255, counts for the
        direction, of `directions` equal ones over 360 degrees starting at 0, that its gradient
        falls into. Outside the image there is none.

        Returns:
            (h + 1, w + 1, directions) of the padded region: the sum over all pixels above and left,
            exact; in single precision where that is enough for any pixels.
        """

        def compute() -> NDArray[np.float32] | NDArray[np.int32]:
            differences = self.differences()
            channels = _gradient_table(directions).take(differences, axis=0)
            is_small = _LARGEST_MAGNITUDE * differences.size <= _EXACT_UP_TO
            return cv2.integral(channels, sdepth=cv2.CV_32F if is_small else cv2.CV_32S)

        return self.cached(("gradient integral", directions), compute)


def nearest_pixel(edges: NDArray[np.float64]) -> NDArray[np.intp]:
    """The pixel edges next to edges in region pixels, which are above 0; halves go up.

    Rounding halves to even numbers would make the edge depend on where the region begins.
    """
    return (edges + 0.5).astype(np.intp)


def _covered(
    starts: NDArray[np.float64], sides: NDArray[np.float64], context_margin: float, reduction: int
) -> tuple[int, int]:
    """First and last edge, in region pixels, of what covers boxes along an axis; see `Region`."""
    first, last = starts - context_margin * sides, starts + (1.0 + context_margin) * sides
    return (
        math.floor(first.min() / reduction) - _MARGIN,
        math.ceil(last.max() / reduction) + _MARGIN,
    )


@cache
def _color_steps(levels: int) -> NDArray[np.float32]:
    """(256,) the step, from 0, that each value of a channel falls into."""
    return (np.arange(256) * levels // 256).astype(np.float32)


@cache
def _gradient_table(directions: int) -> NDArray[np.uint8]:
    """(511 * 511, directions) magnitude of any two 8-bit differences, in their direction's column.

    Rows are numbered as in `Region.differences`.
    """
    magnitudes, angles = all_gradients()
    turns = angles % (2 * np.pi) * (directions / (2 * np.pi))
    direction = np.floor(turns + 1e-9).astype(np.intp) % directions
    table = np.zeros((len(magnitudes), directions), dtype=np.uint8)
    counted = np.minimum(np.rint(2 * magnitudes), _LARGEST_MAGNITUDE)
    table[np.arange(len(table)), direction] = counted
    return table
