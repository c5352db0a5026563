"""The region around the particles and its maps, such as color bins and gradients.

The boxes of N particles overlap heavily. So a map is computed once per frame, when a cue first
requests it, and each box only reads from it.

Gradients of 8-bit gray levels are read from tables, indexed by the differences of a pixel's
neighbors. This is faster than computing them, and exact on the borders between two directions.
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
"""The table index of two differences of 0."""
# Central differences, combined into one table index; exact in single precision.
_KERNEL = np.array([[0, -_VALUES, 0], [-1, 0, 1], [0, _VALUES, 0]], dtype=np.float32)


def paired_differences(gray: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(H, W) table indices of (H, W) gray levels, for tables over `all_gradients`.

    The index of a pixel is (dy + 255) * 511 + dx + 255. dy is the neighbor below minus the one
    above, dx the one to the right minus the one to the left, both from -255 to 255.
    """
    return cv2.filter2D(gray, cv2.CV_32F, _KERNEL, delta=NO_GRADIENT)


def all_gradients() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(511 * 511,) magnitudes in gray levels and angles, -pi to pi, of all pairs of differences."""
    values = np.arange(-_LARGEST, _LARGEST + 1)
    magnitudes = np.hypot(values[:, None], values[None])
    angles = np.arctan2(values[:, None], values[None])
    return magnitudes.ravel(), angles.ravel()


# Up to so many image pixels for each window pixel, the image is not reduced before.
_UNREDUCED = 1.75


def read_window(
    frame: Frame,
    center: NDArray[np.float64],
    sides: NDArray[np.float64],
    pixels: int,
    gray: bool = False,
) -> NDArray[np.uint8]:
    """A part of a frame, resized to a square of a fixed number of pixels.

    When the window is shrunk, image pixels are averaged, not skipped.

    Args:
        frame: The frame.
        center: (2,) center of the window, image pixels; may be outside the image.
        sides: (2,) width and height of the window, image pixels.
        pixels: Pixels along each side of the result.
        gray: Return brightness only.

    Returns:
        (pixels, pixels, 3) or (pixels, pixels); outside the image, its border is repeated.
    """
    # As floats, which Python computes faster than arrays of two.
    (x, y), (across, down) = center.tolist(), sides.tolist()
    reduction = max(int(min(across, down) / pixels + 2.0 - _UNREDUCED), 1)
    # From here on, pixels are those of the reduced view.
    x, y, across, down = x / reduction, y / reduction, across / reduction, down / reduction
    width, height = frame.size
    left, right = pixel_range(x - across / 2, x + across / 2, -(-width // reduction))
    top, bottom = pixel_range(y - down / 2, y + down / 2, -(-height // reduction))
    crop = frame.view(PixelRect(top, bottom, left, right), reduction)
    if gray and crop.ndim == 3:
        crop = cv2.cvtColor(crop, cv2.COLOR_BGR2GRAY)
    step_across, step_down = across / pixels, down / pixels
    first_x = x - across / 2 + step_across / 2 - left - 0.5
    first_y = y - down / 2 + step_down / 2 - top - 0.5
    return cv2.warpAffine(
        crop,
        np.array([[step_across, 0.0, first_x], [0.0, step_down, first_y]]),
        (pixels, pixels),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )


def pixel_range(start: float, end: float, length: int) -> tuple[int, int]:
    """Pixel range [first, last) that covers start to end and one more, at least 1, in a length."""
    first = min(max(math.floor(start) - 1, 0), length - 1)
    return first, max(min(math.ceil(end) + 1, length), first + 1)


Map = TypeVar("Map")
Value = TypeVar("Value", bound=np.generic)

# Pixels around the boxes: derivatives read one more, smoothed derivatives two.
_MARGIN = 2
# Largest gradient magnitude, half gray levels.
_LARGEST_MAGNITUDE = 255
# Points of a map that are read at once; OpenCV's limit is 2^15 - 2.
_READ_AT_ONCE = 2**14
# Single precision represents all integers up to this.
_EXACT_UP_TO = 2**24


class Region:
    """The region of a frame that a set of boxes covers, and the maps computed from it.

    A region may extend outside the image; each map defines its values there.

    Args:
        frame: The whole image.
        boxes: (N, 4) boxes (x, y, width, height) in pixels, all inside the region; each overlaps
            the image.
        reduction: Whole number of image pixels that one region pixel averages along each axis;
            above 1 for large targets, to save time.
        context_margin: Margin of the region around each box, in box sides.
        center_box: See the property; None means the mean of the boxes. If given, the region also
            covers a box of this size around each center.
        estimates_size: Whether the target's size is estimated; if not, cues may read one size only.

    Attributes:
        pixels: The region inside the image, (h, w, 3) or (h, w) uint8, reduced.
        padding: (top, bottom, left, right) region pixels outside the image.
    """

    def __init__(
        self,
        frame: Frame,
        boxes: NDArray[np.float64],
        reduction: int = 1,
        context_margin: float = 0.0,
        *,
        center_box: NDArray[np.float64] | None = None,
        estimates_size: bool = True,
    ) -> None:
        width, height = frame.size
        self._boxes, self._center_box = boxes, center_box
        if center_box is not None:
            given, boxes = boxes, np.empty(boxes.shape)
            np.maximum(given[:, 2:], center_box[2:], out=boxes[:, 2:])
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
        self._cache: dict[object, object] = {}

    @cached_property
    def center_box(self) -> NDArray[np.float64]:
        """(4,) box in the middle of the region: the predicted box, or that of a search window."""
        return self._boxes.mean(axis=0) if self._center_box is None else self._center_box

    def region_boxes(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 4) boxes in region pixels, for (N, 4) boxes in image pixels."""
        if self._reduction > 1:
            boxes = boxes / self._reduction
        return boxes - self._corner

    def region_points(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., 2) points in region pixels, for points in image pixels."""
        return points / self._reduction - self._corner[:2]

    def cached(self, key: object, compute: Callable[[], Map]) -> Map:
        """The map stored under `key`, computed at the first call."""
        if key not in self._cache:
            self._cache[key] = compute()
        return self._cache[key]  # type: ignore[return-value]

    def store(self, key: object, value: object) -> None:
        """Store a map that was computed elsewhere; `cached` then returns it."""
        self._cache[key] = value

    @property
    def gray(self) -> NDArray[np.uint8]:
        """(h, w) uint8 brightness of `pixels`."""
        if self.pixels.ndim == 2:
            return self.pixels
        return self.cached("gray", lambda: cv2.cvtColor(self.pixels, cv2.COLOR_BGR2GRAY))

    @property
    def color(self) -> NDArray[np.uint8]:
        """(h, w, 3) uint8 BGR of `pixels`; gray pixels have equal channels."""
        if self.pixels.ndim == 3:
            return self.pixels
        return self.cached("color", lambda: cv2.cvtColor(self.pixels, cv2.COLOR_GRAY2BGR))

    @property
    def foreground_pixels(self) -> NDArray[np.bool_] | None:
        """(h, w) whether each of `pixels` is foreground; None without a background model.

        The mask has another scale: each pixel takes the mask's value at its center.
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
        """(h, w) histogram bin of each of `pixels`, red * levels^2 + green * levels + blue.

        The levels are equal steps of each channel, at most 256 (exact in single precision).
        """

        def compute() -> NDArray[np.intp]:
            steps = cv2.LUT(self.color, _color_steps(levels))
            return cv2.transform(steps, np.array([[1.0, levels, levels**2]])).astype(np.intp)

        return self.cached(("color bins", levels), compute)

    def pad(self, values: NDArray[Value]) -> NDArray[Value]:
        """(h, w) values of `pixels`, padded with zeros outside the image."""
        if not any(self.padding):
            return values
        return cv2.copyMakeBorder(values, *self.padding, cv2.BORDER_CONSTANT, value=0)

    def differences(self, smoothed: bool = False) -> NDArray[np.intp]:
        """(h, w) table indices of the padded region's gradients; see `paired_differences`.

        Outside the image the gradient is 0. If smoothed, each pixel is first averaged with its
        eight neighbors, with binomial weights 1, 2, 1 along each axis.
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

        A pixel adds its gradient magnitude, in half gray levels and at most 255, to the bin of its
        direction. The bins are `directions` equal parts of 360 degrees, starting at 0. Outside the
        image the gradient is 0.

        Returns:
            (h + 1, w + 1, directions) of the padded region: exact sums over all pixels above and
            left; in single precision if that is exact.
        """

        def compute() -> NDArray[np.float32] | NDArray[np.int32]:
            differences = self.differences()
            channels = _gradient_table(directions).take(differences, axis=0)
            is_small = _LARGEST_MAGNITUDE * differences.size <= _EXACT_UP_TO
            return cv2.integral(channels, sdepth=cv2.CV_32F if is_small else cv2.CV_32S)

        return self.cached(("gradient integral", directions), compute)


def read_map(
    values: NDArray[np.float32], points: NDArray[np.float32], interpolation: int = cv2.INTER_LINEAR
) -> NDArray[np.float32]:
    """(N,) values of a map at (N, 2) points, interpolated; 0 outside of it."""
    if len(points) <= _READ_AT_ONCE:
        return cv2.remap(values, points[None], None, interpolation)[0]
    parts = np.split(points, range(_READ_AT_ONCE, len(points), _READ_AT_ONCE))
    return np.concatenate([cv2.remap(values, part[None], None, interpolation)[0] for part in parts])


def nearest_pixel(edges: NDArray[np.float64]) -> NDArray[np.intp]:
    """Positive edges in region pixels, rounded to whole pixels; halves are rounded up.

    Rounding halves to even would make the result depend on the region's corner.
    """
    return (edges + 0.5).astype(np.intp)


def _covered(
    starts: NDArray[np.float64], sides: NDArray[np.float64], context_margin: float, reduction: int
) -> tuple[int, int]:
    """First and last edge of the region along an axis, region pixels; see `Region`."""
    first, last = starts - context_margin * sides, starts + (1.0 + context_margin) * sides
    return (
        math.floor(first.min() / reduction) - _MARGIN,
        math.ceil(last.max() / reduction) + _MARGIN,
    )


@cache
def _color_steps(levels: int) -> NDArray[np.float32]:
    """(256,) step, from 0, of each value of a channel."""
    return (np.arange(256) * levels // 256).astype(np.float32)


@cache
def _gradient_table(directions: int) -> NDArray[np.uint8]:
    """(511 * 511, directions) magnitudes in the column of their direction, 0 elsewhere.

    Rows are the indices of `paired_differences`.
    """
    magnitudes, angles = all_gradients()
    turns = angles % (2 * np.pi) * (directions / (2 * np.pi))
    direction = np.floor(turns + 1e-9).astype(np.intp) % directions
    table = np.zeros((len(magnitudes), directions), dtype=np.uint8)
    counted = np.minimum(np.rint(2 * magnitudes), _LARGEST_MAGNITUDE)
    table[np.arange(len(table)), direction] = counted
    return table
