"""One image of a camera and its 8-bit views, computed on first use and only where they are read."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.background import BackgroundState
from pf_tracker_ros.frames.exposure import (
    UNCHANGED_ILLUMINATION,
    GrayRange,
    Illumination,
    gain_table,
    gray_range,
    to_8_bit,
)

# Pixels along each side of a tile.
_TILE = 16


class PixelRect(NamedTuple):
    """A rectangle of pixels, [top, bottom) x [left, right)."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Slices of an array for this part."""
        return slice(self.top, self.bottom), slice(self.left, self.right)


class TiledImage:
    """An image of a shape (h, w) or (h, w, 3) whose tiles are computed on first use."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._pixels = np.empty(shape, np.uint8)
        self._is_known = np.zeros((-(-shape[0] // _TILE), -(-shape[1] // _TILE)), np.bool_)

    def read(
        self, part: PixelRect, compute: Callable[[PixelRect], NDArray[np.uint8]]
    ) -> NDArray[np.uint8]:
        """The pixels of a part inside the image; do not write to them.

        `compute` computes the pixels of a part of whole tiles, which may be cut at the image's
        edge. It is not stored, since it refers back to the owner of this image.
        """
        rows = slice(part.top // _TILE, -(-part.bottom // _TILE))
        columns = slice(part.left // _TILE, -(-part.right // _TILE))
        known = self._is_known[rows, columns]
        if np.count_nonzero(known) < known.size:
            height, width = self._pixels.shape[:2]
            for tiles in _unknown(known, rows.start, columns.start):
                pixels = PixelRect(
                    tiles.top * _TILE,
                    min(tiles.bottom * _TILE, height),
                    tiles.left * _TILE,
                    min(tiles.right * _TILE, width),
                )
                self._pixels[pixels.slices] = compute(pixels)
            known[:] = True
        return self._pixels[part.slices]


def _unknown(known: NDArray[np.bool_], top: int, left: int) -> Iterator[PixelRect]:
    """Rectangles that cover the unknown tiles, numbered from the given first row and column."""
    rows, columns = known.shape
    if np.count_nonzero(known) == 0:
        yield PixelRect(top, top + rows, left, left + columns)
        return
    padded = np.ones((rows, columns + 2), np.bool_)
    padded[:, 1:-1] = known
    # In each row, starts and ends of runs of unknown tiles alternate.
    row_of, column_of = np.nonzero(padded[:, 1:] != padded[:, :-1])
    found: dict[tuple[int, int], PixelRect] = {}
    for row, start, end in zip(
        row_of[::2].tolist(), column_of[::2].tolist(), column_of[1::2].tolist(), strict=True
    ):
        above = found.get((start, end))
        if above is None or above.bottom < top + row:
            if above:
                yield above
            above = PixelRect(top + row, top + row, left + start, left + end)
        # A run of the same columns in the next row extends the rectangle.
        found[start, end] = above._replace(bottom=top + row + 1)
    yield from found.values()


Map = TypeVar("Map")

# Blocks larger than this are sampled by so many rows and columns, to bound the cost.
_LARGEST_AVERAGED = 8
_SAMPLED = 4


class Foreground(NamedTuple):
    """The foreground mask of a frame, from a background model.

    Attributes:
        mask: (h, w) uint8 over the whole image, 255 for foreground.
        reduction: Image pixels per mask pixel along each axis.
    """

    mask: NDArray[np.uint8]
    reduction: int


class Frame:
    """One image with its stamp, its 8-bit views and its maps.

    The 8-bit view and its reductions to a half, a third and so on are computed on first use, only
    where they are read, and shared by all targets.

    Args:
        image: (H, W, 3) uint8 BGR, or (H, W) uint8, uint16 or float32; do not change it afterwards.
        stamp: Time of the image in nanoseconds; 0 means unknown.

    Attributes:
        illumination: See `expose`.
        foreground: Mask of the background model; None without a usable one.
        background: State of the background model; None without a model.
        camera_motion: Camera motion, see `EgoMotion.update`; None if the camera stands still or its
            motion is not estimated.
        odds_factor: Factor of the odds that a box shows its target: below 1 after a cut, see
            `Continuity`.
    """

    def __init__(self, image: NDArray[np.generic], stamp: int = 0) -> None:
        self.image = image
        self.stamp = stamp
        self.expose()

    def with_image(self, image: NDArray[np.generic]) -> Frame:
        """The same frame with another image of equal shape and type."""
        other = copy.copy(self)
        other.image = image
        return other

    def expose(
        self,
        span: GrayRange | None = None,
        illumination: Illumination = UNCHANGED_ILLUMINATION,
    ) -> None:
        """Set the conversion to 8 bits and clear all views, maps and results of the frame.

        The span has the values of a 16-bit or 32-bit image that become 0 and 255; None means the
        image's own range. The view of an 8-bit image is divided by the gain of the illumination.
        """
        self.illumination = illumination
        self.foreground: Foreground | None = None
        self.background: BackgroundState | None = None
        self.camera_motion: NDArray[np.float64] | None = None
        self.odds_factor = 1.0
        self._span = span
        self._gain_table = None if illumination.gain == 1.0 else gain_table(illumination.gain)
        self.clear_cache()

    @property
    def size(self) -> tuple[int, int]:
        """(width, height), pixels."""
        return self.image.shape[1], self.image.shape[0]

    @property
    def pixels(self) -> NDArray[np.uint8]:
        """(H, W, 3) BGR or (H, W): the whole 8-bit view."""
        width, height = self.size
        return self.view(PixelRect(0, height, 0, width))

    def view(self, part: PixelRect, reduction: int = 1) -> NDArray[np.uint8]:
        """A part of the 8-bit view, reduced by a whole factor; do not write to it.

        A pixel of a reduced view is the mean of a block of reduction x reduction pixels, counted
        from the image's corner. Blocks that extend outside the image repeat its last row or column.
        Blocks larger than 8 x 8 are sampled by 4 x 4 pixels, spread evenly.

        Args:
            part: Part of the reduced view of (H / reduction, W / reduction) pixels, rounded up.
            reduction: At least 1.
        """
        if reduction == 1 and self.image.dtype == np.uint8 and self._gain_table is None:
            return self.image[part.slices]  # type: ignore[return-value]
        view = self._views.get(reduction)
        if view is None:
            height, width, *channels = self.image.shape
            shape = (-(-height // reduction), -(-width // reduction), *channels)
            self._views[reduction] = view = TiledImage(shape)
        compute = partial(self._reduced, reduction) if reduction > 1 else self._converted
        return view.read(part, compute)

    def cached(self, key: object, compute: Callable[[], Map]) -> Map:
        """The map stored under `key`, computed at the first call."""
        if key not in self._cache:
            self._cache[key] = compute()
        return self._cache[key]  # type: ignore[return-value]

    def clear_cache(self) -> None:
        """Free the memory of views and maps; they are computed again on use."""
        self._views: dict[int, TiledImage] = {}
        self._cache: dict[object, object] = {}

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_views": {}, "_cache": {}}

    def _converted(self, part: PixelRect) -> NDArray[np.uint8]:
        return self._to_8_bit(self.image[part.slices])

    def _to_8_bit(self, values: NDArray[np.generic]) -> NDArray[np.uint8]:
        if self._gain_table is not None:
            return cv2.LUT(values, self._gain_table)
        if self._span is None:
            self._span = gray_range(self.image)
        return to_8_bit(values, self._span)

    def _reduced(self, reduction: int, part: PixelRect) -> NDArray[np.uint8]:
        blocks = self._blocks if reduction <= _LARGEST_AVERAGED else self._sampled_blocks
        size = (part.right - part.left, part.bottom - part.top)
        return cv2.resize(blocks(part, reduction), size, interpolation=cv2.INTER_AREA)

    def _blocks(self, part: PixelRect, reduction: int) -> NDArray[np.uint8]:
        """All pixels of the blocks of a part of the reduced view."""
        height, width = self.image.shape[:2]
        source = self.view(
            PixelRect(
                part.top * reduction,
                min(part.bottom * reduction, height),
                part.left * reduction,
                min(part.right * reduction, width),
            )
        )
        missing_rows, missing_columns = (-side % reduction for side in source.shape[:2])
        if missing_rows or missing_columns:
            source = cv2.copyMakeBorder(
                source, 0, missing_rows, 0, missing_columns, cv2.BORDER_REPLICATE
            )
        return source

    def _sampled_blocks(self, part: PixelRect, reduction: int) -> NDArray[np.uint8]:
        """A fixed number of pixels of each of these blocks."""
        rows, columns = (
            np.minimum(
                ((np.arange(start * _SAMPLED, end * _SAMPLED) + 0.5) * reduction / _SAMPLED).astype(
                    np.intp
                ),
                length - 1,
            )
            for start, end, length in (
                (part.top, part.bottom, self.image.shape[0]),
                (part.left, part.right, self.image.shape[1]),
            )
        )
        # Rows first: they are copied as a whole.
        across = self.image[rows, columns[0] : columns[-1] + 1]
        return self._to_8_bit(across.take(columns - columns[0], axis=1))


def check_image(image: NDArray[np.generic]) -> None:
    """Check an image.

    Raises:
        ValueError: `image` is not (H, W, 3) uint8, or (H, W) uint8, uint16 or float32, or is empty.
    """
    allowed = "(H, W, 3) uint8 BGR, or (H, W) uint8, uint16 or float32"
    if image is None:
        raise ValueError("image is None: the video has ended, or cannot be opened")
    if not isinstance(image, np.ndarray):
        raise ValueError(f"image is a {type(image).__name__}; allowed: an array {allowed}")
    color = image.ndim == 3 and image.shape[2] == 3 and image.dtype == np.uint8
    gray = image.ndim == 2 and image.dtype in (np.uint8, np.uint16, np.float32)
    if not (color or gray):
        raise ValueError(f"image is {image.shape} {image.dtype}; allowed: {allowed}")
    if image.size == 0:
        raise ValueError(f"image is {image.shape}, without pixels; allowed: {allowed}")
