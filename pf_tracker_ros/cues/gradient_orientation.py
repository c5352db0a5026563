"""Gradient orientation vector cue: which edge directions a box holds, and where in it.

Source: Li et al. 2007, section 2.2.2, after Lowe's keypoint descriptor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.maps import FrameMaps
from pf_tracker_ros.parameters import declared

# The Gaussian weight is constant over each of so many parts of a cell along an axis.
_PARTS = 2


@dataclass(frozen=True)
class GradientOrientationParameters:
    """The gradient orientation vector cue."""

    power: float = declared(
        0.4,
        "Power of this cue in the fused likelihood (1 - alpha); 0 switches it off. "
        "The powers of all cues are scaled to a sum of 1.",
        minimum=0.0,
        maximum=1.0,
    )
    cells: int = declared(
        4,
        "Cells along each side of the box.",
        minimum=1,
        maximum=16,
        read_only=True,
    )
    directions: int = declared(
        8,
        "Directions that the 360 degrees are divided into.",
        minimum=2,
        maximum=36,
        read_only=True,
    )
    gaussian_width: float = declared(
        0.5,
        "Standard deviation of the Gaussian weight around the center of the box.",
        unit="box sides",
        minimum=0.05,
        maximum=100.0,
        read_only=True,
    )
    sharpness: float = declared(
        10.0,
        "How fast the likelihood falls with the squared Euclidean distance (mu).",
        minimum=0.0,
        maximum=1000.0,
    )


class GradientOrientation:
    """Gradient orientation vector against a template vector by their Euclidean distance.

    The vector has one number for each cell and direction, the Gaussian-weighted sum of gradient
    magnitudes, and unit length, so that contrast does not matter. A box without any gradient has
    the zero vector. The template is such a (cells^2 * directions,) vector.

    Args:
        parameters: Cells, directions, Gaussian width and sharpness.
    """

    def __init__(self, parameters: GradientOrientationParameters) -> None:
        self._cells = parameters.cells
        self._directions = parameters.directions
        self._sharpness = parameters.sharpness
        self._corner_weights = _corner_weights(parameters.cells, parameters.gaussian_width)

    def learn(self, maps: FrameMaps, box: NDArray[np.float64]) -> NDArray[np.float64]:
        """See `Cue.learn`."""
        return self.vectors(maps, box[None])[:, 0]

    def log_likelihood(
        self, maps: FrameMaps, boxes: NDArray[np.float64], template: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """See `Cue.log_likelihood`; source: Li et al. 2007, equation (7)."""
        squared_distance = np.square(self.vectors(maps, boxes) - template[:, None]).sum(axis=0)
        return -self._sharpness * squared_distance

    def vectors(self, maps: FrameMaps, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(cells^2 * directions, N) gradient orientation vectors of (N, 4) boxes.

        A cell's sum is linear in the values of the integral image at the corners of its parts, so
        all cells of all boxes are one matrix product.
        """
        integral = maps.gradient_integral(self._directions)
        region_boxes = maps.region_boxes(boxes)
        fractions = np.arange(_PARTS * self._cells + 1)[:, None] / (_PARTS * self._cells)
        x, y, width, height = region_boxes.T
        columns = np.rint(x + fractions * width).astype(np.intp)
        rows = np.rint(y + fractions * height).astype(np.intp)
        corners = rows[:, None] * integral.shape[1] + columns[None]
        values = integral.reshape(-1, self._directions).take(corners, axis=0)
        sums = self._corner_weights @ values.reshape(len(self._corner_weights[0]), -1)
        vectors = sums.reshape(self._cells**2, len(boxes), self._directions)
        vectors = np.moveaxis(vectors, 2, 1).reshape(-1, len(boxes))
        # Differences of large sums leave a trace of rounding where there is no gradient at all.
        lengths = np.linalg.norm(vectors, axis=0)
        return np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 1e-6)

    def blend(
        self, template: NDArray[np.float64], seen: NDArray[np.float64], keep: float
    ) -> NDArray[np.float64]:
        """See `Cue.blend`; source: Li et al. 2007, equation (10)."""
        return keep * template + (1.0 - keep) * seen


def _corner_weights(cells: int, gaussian_width: float) -> NDArray[np.float64]:
    """(cells^2, corners) factors that turn integral image values into weighted cell sums.

    The box is divided into parts, `_PARTS` times `cells` along each axis; each counts with the
    Gaussian at its center. A part's sum is the integral at its lower right and upper left corners
    minus the other two.
    """
    parts = _PARTS * cells
    centers = (np.arange(parts) + 0.5) / parts - 0.5
    gaussian = np.exp(-0.5 * np.square(centers / gaussian_width))
    along_axis = np.zeros((cells, parts + 1))
    for part, weight in enumerate(gaussian):
        along_axis[part // _PARTS, part + 1] += weight
        along_axis[part // _PARTS, part] -= weight
    weights = np.kron(along_axis, along_axis)
    return weights.astype(np.float64, copy=False)
