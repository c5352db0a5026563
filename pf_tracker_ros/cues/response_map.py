"""What a correlation filter answers to windows of a frame, and what is read from it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.square_transform import Spectrum

Value = TypeVar("Value", bound=np.inexact)

# How many boxes are read at once, well within what OpenCV can (2^15 - 2).
_READ_AT_ONCE = 2**14
# Responses below this share of the one to the trained window are as good as none.
SMALLEST_RESPONSE = 1e-9
_LEAST_STANDING_OUT = 0.1


class Windows(NamedTuple):
    """Square parts of the frame around the prediction.

    Attributes:
        spectra: (windows, channels, cells, cells // 2 + 1) of their features.
        expected: (channels, cells, cells // 2 + 1), of a window of the expected size, about.
        center: (2,) in image pixels.
        sides: Of each, image pixels, from small to large.
    """

    spectra: Spectrum
    expected: Spectrum
    center: NDArray[np.float64]
    sides: Sequence[float]


class Answers(NamedTuple):
    """What the filter answers to the windows around the prediction.

    Attributes:
        maps: (windows, S, S) responses.
        windows: That they are to.
        expected: (S, S) responses in the expected size.
        deviation: Their standard deviation, above 0.
        largest: Of all responses.
    """

    maps: NDArray[np.float32]
    windows: Windows
    expected: NDArray[np.float32]
    deviation: float
    largest: float

    @classmethod
    def of(cls, maps: NDArray[np.float32], windows: Windows) -> Answers:
        """Those that (windows, S, S) responses to some windows make."""
        expected = mean_of(maps)
        return cls(maps, windows, expected, deviation_of(expected), float(maps.max()))

    def read(
        self, centers: NDArray[np.float64], shares: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(N,) responses, 0 outside of the windows.

        Args:
            centers: (N, 2) in image pixels.
            shares: (N,) of the largest window in the response, 0 to 1; the rest is the smallest's.
        """

        def read_one(number: int) -> NDArray[np.float32]:
            values = self.maps[number]
            places = self._places(number, centers, self.windows.center)
            if len(places) <= _READ_AT_ONCE:
                return _interpolate(values, places[None])[0]
            parts = np.split(places, range(_READ_AT_ONCE, len(places), _READ_AT_ONCE))
            return np.concatenate([_interpolate(values, part[None])[0] for part in parts])

        return self._between(read_one, shares)

    def read_grid(
        self, x: NDArray[np.float64], y: NDArray[np.float64], share: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(rows, columns) the same of a grid, whose sides are below 2^15.

        Args:
            x: (columns,) of the centers, image pixels.
            y: (rows,) of the centers, image pixels.
            share: (1,) as in `read`.
        """
        center = self.windows.center

        def read_one(number: int) -> NDArray[np.float32]:
            places = np.empty((len(y), len(x), 2), dtype=np.float32)
            places[..., 0] = self._places(number, x, center[0])
            places[..., 1] = self._places(number, y, center[1])[:, None]
            return _interpolate(self.maps[number], places)

        return self._between(read_one, share)

    def _places(
        self, number: int, positions: NDArray[np.float64], center: NDArray[np.float64] | np.float64
    ) -> NDArray[np.float32]:
        """Positions in image pixels as those in a window's map."""
        samples = len(self.maps[number])
        scale = samples / self.windows.sides[number]
        return ((positions - center) * scale + samples // 2).astype(np.float32)

    def _between(
        self, read_one: Callable[[int], NDArray[np.float32]], shares: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """What is read of the smallest and of the largest window, by the shares of the latter."""
        smallest = read_one(0).astype(np.float64)
        if len(self.maps) == 1:
            return smallest
        return smallest + shares * (read_one(-1) - smallest)


def _interpolate(values: NDArray[np.float32], places: NDArray[np.float32]) -> NDArray[np.float32]:
    """(rows, columns) values of a map at (rows, columns, 2) places in it, 0 outside of it."""
    return cv2.remap(values, places, None, cv2.INTER_CUBIC)


def mean_of(windows: NDArray[Value]) -> NDArray[Value]:
    """The mean over one or two windows."""
    return windows[0] if len(windows) == 1 else (windows[0] + windows[1]) * np.float32(0.5)


def deviation_of(values: NDArray[np.float32]) -> float:
    """Standard deviation of a response map, above 0."""
    return max(float(cv2.meanStdDev(values)[1][0, 0]), SMALLEST_RESPONSE)


def peak_near(
    values: NDArray[np.float32], place: NDArray[np.float64], side: float, box: NDArray[np.float64]
) -> float:
    """The largest value of a response map within a quarter of a box around its center.

    Args:
        values: (S, S), of a window around a place.
        place: (4,) box, image pixels.
        side: Of the window, image pixels.
        box: (4,), image pixels.
    """
    samples = len(values)
    scale = samples / side
    center = (box[:2] + box[2:] / 2 - place[:2] - place[2:] / 2) * scale + samples // 2
    reach = np.maximum(box[2:] * scale / 4, 1.0)
    edges = np.rint([center - reach, center + reach]).astype(np.intp)
    (left, top), (right, bottom) = np.minimum(np.maximum(edges, 0), samples - 1).tolist()
    return float(values[top : bottom + 1, left : right + 1].max())


def standing_out(value: float, deviation: float) -> float:
    """A value of a response map in units of the map's standard deviation, kept from 0."""
    return max(value / deviation, _LEAST_STANDING_OUT)
