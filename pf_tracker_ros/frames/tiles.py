"""Images that are computed where they are looked at, and there only once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

# Pixels along each side of a tile: few enough to compute little that nobody looks at.
_TILE = 16


class Part(NamedTuple):
    """A rectangle of pixels, [top, bottom) x [left, right)."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """To take the part of an array."""
        return slice(self.top, self.bottom), slice(self.left, self.right)


class TiledImage:
    """An image whose tiles are computed when a part of it is first read.

    Args:
        shape: (h, w) or (h, w, 3).
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._pixels = np.empty(shape, np.uint8)
        self._is_known = np.zeros((-(-shape[0] // _TILE), -(-shape[1] // _TILE)), np.bool_)

    def read(self, part: Part, compute: Callable[[Part], NDArray[np.uint8]]) -> NDArray[np.uint8]:
        """The pixels of a part inside the image, not to be written to.

        Args:
            part: Inside the image.
            compute: The pixels of a part that is made of whole tiles, but at the image's end. It is
                not kept: whoever can compute holds this, and would live on in a circle with it.
        """
        rows = slice(part.top // _TILE, -(-part.bottom // _TILE))
        columns = slice(part.left // _TILE, -(-part.right // _TILE))
        known = self._is_known[rows, columns]
        if np.count_nonzero(known) < known.size:
            height, width = self._pixels.shape[:2]
            for tiles in _unknown(known, rows.start, columns.start):
                pixels = Part(
                    tiles.top * _TILE,
                    min(tiles.bottom * _TILE, height),
                    tiles.left * _TILE,
                    min(tiles.right * _TILE, width),
                )
                self._pixels[pixels.slices] = compute(pixels)
            known[:] = True
        return self._pixels[part.slices]


def _unknown(known: NDArray[np.bool_], top: int, left: int) -> Iterator[Part]:
    """Rectangles of tiles that together are those unknown, counted from a first row and column."""
    rows, columns = known.shape
    if np.count_nonzero(known) == 0:
        yield Part(top, top + rows, left, left + columns)
        return
    padded = np.ones((rows, columns + 2), np.bool_)
    padded[:, 1:-1] = known
    # Of each row, where unknown tiles start and end by turns.
    row_of, column_of = np.nonzero(padded[:, 1:] != padded[:, :-1])
    found: dict[tuple[int, int], Part] = {}
    for row, start, end in zip(
        row_of[::2].tolist(), column_of[::2].tolist(), column_of[1::2].tolist(), strict=True
    ):
        above = found.get((start, end))
        if above is None or above.bottom < top + row:
            if above:
                yield above
            above = Part(top + row, top + row, left + start, left + end)
        # The same columns in the next row make it higher.
        found[start, end] = above._replace(bottom=top + row + 1)
    yield from found.values()
