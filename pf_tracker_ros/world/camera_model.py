"""Camera model: pixels to rays and points to pixels, with lens distortion.

A point (X, Y, Z) in camera coordinates (x right, y down, z forward) has the normalized coordinates
x = X / Z, y = Y / Z. The distortion moves these, and u = fx x' + cx, v = fy y' + cy.

- `plumb_bob` and `rational_polynomial`: x' and y' are rational functions of x and y; OpenCV's
  `projectPoints` computes them and their derivatives.
- `equidistant`: the angle t from the optical axis becomes
  t' = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8), as in OpenCV's `fisheye`.

The inverses have no closed form; Newton's method iterates until it has converged.

Pixels count as in CameraInfo: (0, 0) is the center of the first pixel. A box counts from that
pixel's corner, so its edges are half a pixel less here.

Sources: Brown 1966, "Decentering Distortion of Lenses"; Kannala and Brandt 2006, "A Generic Camera
Model and Calibration Method"; ROS REP 104 and `sensor_msgs/CameraInfo`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

# Number of distortion coefficients of each model.
_COEFFICIENTS = {
    "plumb_bob": (0, 4, 5),
    "rational_polynomial": (0, 8, 12, 14),
    "equidistant": (0, 4),
}
# Steps of Newton's method, and its tolerance in normalized coordinates or radians: .00006 degrees.
_STEPS, _TOLERANCE = 50, 1e-6
# The same in pixels, from which on the inverse of OpenCV needs no step.
_PIXEL_TOLERANCE = 1e-5
# Most pixels, as those of a box, that are computed one by one: for these, the calls of NumPy take
# longer than the arithmetic.
_FEW = 8
# OpenCV's fixed-point iteration, from which Newton's method starts.
_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-9)
_ACROSS = np.eye(3)[:, :2]
_ZERO = np.zeros(3)
# From a 2 x 2 matrix, row by row, to its adjugate.
_ADJUGATE = np.array([[0, 0, 0, 1], [0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0]], np.float64)
# Largest side of an image, least and largest focal length (a telephoto lens of 1 m has about 3e5),
# and largest distance of the principal point from the first pixel, pixels.
_LARGEST_SIDE, _LEAST_FOCAL, _LARGEST_FOCAL, _FARTHEST_CENTER = 1e5, 1.0, 1e6, 1e5
_LARGEST_COEFFICIENT = 1e6
# Of a grid of pixels, least share that the model sees, and least median of their angles from the
# optical axis over those without distortion. A circular fisheye fills .4 of a wide image.
_GRID, _LEAST_SEEN, _LEAST_ANGLE = 8, 0.25, 0.5


class CameraModel:
    """A calibrated camera.

    Args:
        fx: Focal length along x, pixels.
        fy: Likewise along y.
        cx: Column of the principal point, pixels; 0 is the center of the first.
        cy: Row of the principal point.
        width: Of the image, pixels.
        height: Likewise.
        distortion: Coefficients in the order of OpenCV and CameraInfo; none for a rectified image.
        model: `plumb_bob`, `rational_polynomial` or `equidistant`.

    Raises:
        ValueError: A number is not finite or no camera has it, or the model does not have that
            many coefficients.

    Example:
        >>> from pf_tracker_ros.world import CameraModel
        >>> camera = CameraModel(500.0, 500.0, 320.0, 240.0, 640, 480)
        >>> camera.project([(0.0, 0.0, 5.0), (1.0, 0.0, 5.0)]).tolist()
        [[320.0, 240.0], [420.0, 240.0]]
    """

    def __init__(  # noqa: PLR0917 (the fixed order of a calibration)
        self,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        width: int,
        height: int,
        distortion: Sequence[float] = (),
        model: str = "plumb_bob",
    ) -> None:
        if model not in _COEFFICIENTS:
            raise ValueError(
                f"the distortion model is '{model}'; allowed: {', '.join(_COEFFICIENTS)}"
            )
        coefficients = np.array(distortion, dtype=np.float64).reshape(-1)
        numbers = np.array([fx, fy, cx, cy, width, height, *coefficients], dtype=np.float64)
        if not np.isfinite(numbers).all():
            raise ValueError(
                "the calibration has numbers that are not finite; calibrate the camera"
            )
        if fx <= 0.0 or fy <= 0.0:
            raise ValueError(
                f"the focal lengths are {fx:g} and {fy:g} px; they are positive once the camera is "
                "calibrated"
            )
        if min(width, height) < 1 or max(width, height) > _LARGEST_SIDE:
            raise ValueError(
                f"the calibration is for {width} x {height} px; expected at least 1 x 1, and sides "
                f"up to {_LARGEST_SIDE:.0f}"
            )
        if min(fx, fy) < _LEAST_FOCAL or max(fx, fy) > _LARGEST_FOCAL:
            raise ValueError(
                f"the focal lengths are {fx:g} and {fy:g} px; expected {_LEAST_FOCAL:g} to "
                f"{_LARGEST_FOCAL:.0f}, calibrate the camera"
            )
        if max(abs(cx), abs(cy)) > _FARTHEST_CENTER:
            raise ValueError(
                f"the principal point is ({cx:g}, {cy:g}) px; expected at most "
                f"{_FARTHEST_CENTER:.0f} px from the first pixel, calibrate the camera"
            )
        if (np.abs(coefficients) > _LARGEST_COEFFICIENT).any():
            raise ValueError(
                f"a distortion coefficient is {coefficients[np.argmax(np.abs(coefficients))]:g}; "
                f"expected at most {_LARGEST_COEFFICIENT:g}, calibrate the camera"
            )
        if len(coefficients) not in _COEFFICIENTS[model]:
            allowed = " or ".join(map(str, _COEFFICIENTS[model]))
            raise ValueError(
                f"{model} has {len(coefficients)} distortion coefficients; expected {allowed}"
            )
        self.fx, self.fy, self.cx, self.cy = float(fx), float(fy), float(cx), float(cy)
        self.width, self.height = int(width), int(height)
        self.model = model
        self.distortion = coefficients if coefficients.any() else np.empty(0)
        self.distortion.setflags(write=False)
        self._center = np.array([cx, cy], dtype=np.float64)
        self._scale = np.array([1.0 / fx, 1.0 / fy])
        self._inverse = np.diag(self._scale)
        self._matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        if len(self.distortion):
            self._check_distortion()

    @classmethod
    def from_calibration(
        cls,
        width: int,
        height: int,
        model: str,
        distortion: Sequence[float],
        intrinsics: Sequence[float],
        *,
        projection: Sequence[float] | None = None,
        binning: tuple[int, int] = (1, 1),
        region: tuple[int, int, int, int] = (0, 0, 0, 0),
        image_size: tuple[int, int] | None = None,
    ) -> CameraModel:
        """The camera of the images that come with a CameraInfo.

        Args:
            width: Of the calibrated image, pixels.
            height: Likewise.
            model: `distortion_model`; empty means `plumb_bob`.
            distortion: `d`.
            intrinsics: `k`, row by row.
            projection: `p`, row by row, for rectified images: it replaces `k` and `d`. None for raw
                images.
            binning: `binning_x` and `binning_y`; 0 means 1.
            region: `roi` as x, y, width, height in unbinned pixels; a side of 0 means the image.
            image_size: (width, height) of the images, to check them; None checks nothing.

        Raises:
            ValueError: The calibration is empty, no camera has it, or it is of another image size.
        """
        matrix = np.array(intrinsics if projection is None else projection, dtype=np.float64)
        if matrix.size not in ((9,) if projection is None else (12,)):
            raise ValueError(
                f"the camera matrix has {matrix.size} numbers; expected k (9) or p (12)"
            )
        matrix = matrix.reshape(3, -1)
        binning_x, binning_y = max(int(binning[0]), 1), max(int(binning[1]), 1)
        x, y, region_width, region_height = region
        if not (region_width and region_height):
            x, y, region_width, region_height = 0, 0, width, height
        if min(x, y) < 0 or x + region_width > width or y + region_height > height:
            raise ValueError(
                f"the region of interest is {region_width} x {region_height} px at ({x}, {y}), "
                f"outside of the calibrated image of {width} x {height} px"
            )
        made = cls(
            matrix[0, 0] / binning_x,
            matrix[1, 1] / binning_y,
            # The center of a binned pixel is between the centers of those that it consists of.
            (matrix[0, 2] - x + 0.5) / binning_x - 0.5,
            (matrix[1, 2] - y + 0.5) / binning_y - 0.5,
            region_width // binning_x,
            region_height // binning_y,
            distortion if projection is None else (),
            (model or "plumb_bob") if projection is None else "plumb_bob",
        )
        if image_size is not None and image_size != (made.width, made.height):
            raise ValueError(
                f"the calibration is for images of {made.width} x {made.height} px, but these have "
                f"{image_size[0]} x {image_size[1]}; publish the CameraInfo of this image size"
            )
        return made

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """(N, 2) pixels of (N, 3) points in camera coordinates; NaN behind the camera."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        if self.model == "equidistant":
            radius = np.hypot(points[:, 0], points[:, 1])
            angle = np.arctan2(radius, points[:, 2])
            scale = self._distorted_angle(angle)[0] / np.maximum(radius, 1e-12)
            pixels = points[:, :2] * scale[:, None]
        else:
            depth = np.where(points[:, 2] > 0.0, points[:, 2], np.nan)
            pixels = points[:, :2] / depth[:, None]
            if len(self.distortion):
                return self._distort(pixels)[0]
        return pixels / self._scale + self._center

    def rays(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """(N, 3) unit vectors to (N, 2) pixels; NaN where the model has no inverse."""
        return self.rays_with_jacobians(pixels)[0]

    def rays_with_jacobians(
        self, pixels: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Rays, and their derivatives by the pixel.

        Args:
            pixels: (N, 2).

        Returns:
            (N, 3) unit vectors, NaN where the model has no inverse, and (N, 3, 2) Jacobians.
        """
        pixels = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        if self.model == "equidistant":
            return self._equidistant_rays(pixels)
        if 0 < len(pixels) <= _FEW and (found := self._rays_of_few(pixels)):
            return found
        rays = np.ones((len(pixels), 3))
        if len(self.distortion):
            rays[:, :2], inverse = self._undistort(pixels)
        else:
            rays[:, :2], inverse = (pixels - self._center) * self._scale, self._inverse
        inverse_length = 1.0 / np.sqrt(np.einsum("ni,ni->n", rays, rays))
        rays *= inverse_length[:, None]
        # d(r / |r|) = (I - r r^T) dr / |r| with unit r in the product; dr is in the first two rows.
        across = _ACROSS - rays[:, :, None] * rays[:, None, :2]
        across *= inverse_length[:, None, None]
        return rays, across @ inverse

    def _check_distortion(self) -> None:
        """Raise a ValueError for a distortion that no lens has."""
        shares = (np.arange(_GRID) + 0.5) / _GRID
        columns, rows = np.meshgrid(shares * self.width - 0.5, shares * self.height - 0.5)
        pixels = np.column_stack([columns.ravel(), rows.ravel()])
        rays = self.rays(pixels)
        is_seen = np.isfinite(rays).all(axis=1)
        ideal = np.hypot(*((pixels - self._center) * self._scale).T)
        if self.model != "equidistant":
            ideal = np.arctan(ideal)
        angles = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
        seen = float(is_seen.mean())
        ratio = float(np.median((angles / np.maximum(ideal, 1e-12))[is_seen])) if seen else 0.0
        if seen < _LEAST_SEEN or ratio < _LEAST_ANGLE:
            raise ValueError(
                f"no lens has the distortion {self.distortion.tolist()}: it gives directions to "
                f"{100.0 * seen:.0f} % of the image (expected at least {100.0 * _LEAST_SEEN:.0f}), "
                f"{ratio:.2g} times as far from the axis as without it (expected at least "
                f"{_LEAST_ANGLE:g}); calibrate the camera"
            )

    def _distort(
        self, normalized: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(N, 2) pixels of undistorted normalized coordinates, and (N, 2, 2) derivatives."""
        if not len(normalized):
            # OpenCV takes no empty array.
            return np.empty((0, 2)), np.empty((0, 2, 2))
        points = cv2.convertPointsToHomogeneous(normalized)
        pixels, jacobian = cv2.projectPoints(points, _ZERO, _ZERO, self._matrix, self.distortion)
        # Columns 3 and 4 are the derivatives by the translation along x and y, at depth 1.
        return pixels.reshape(-1, 2), jacobian[:, 3:5].reshape(-1, 2, 2)

    def _rays_of_few(
        self, pixels: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Rays with their derivatives; None where OpenCV's inverse is not exact, which is rare."""
        if len(self.distortion):
            normalized = self._first_undistorted(pixels)
            distorted, derivatives = self._distort(normalized)
            errors = (pixels - distorted).tolist()
            matrices = derivatives.reshape(-1, 4).tolist()
        else:
            normalized = (pixels - self._center) * self._scale
            errors = [[0.0, 0.0]] * len(pixels)
            matrices = [[self.fx, 0.0, 0.0, self.fy]] * len(pixels)
        rays, jacobians = [], []
        for (u, v), (x, y), error, (a, b, c, d) in zip(
            pixels.tolist(), normalized.tolist(), errors, matrices, strict=True
        ):
            determinant = a * d - b * c
            # A comparison with NaN is false.
            if not (
                abs(error[0]) <= _PIXEL_TOLERANCE
                and abs(error[1]) <= _PIXEL_TOLERANCE
                and determinant > 0.0
                and (u - self.cx) * x + (v - self.cy) * y >= 0.0
            ):
                return None
            # r = (right, down, z) = (x, y, 1) / length, and dr = (I - r r^T) (dx, dy, 0) / length.
            z = 1.0 / math.sqrt(x * x + y * y + 1.0)
            right, down, scale = x * z, y * z, z / determinant
            xx, yy = scale * (1.0 - right * right), scale * (1.0 - down * down)
            xy, xz, yz = -scale * right * down, -scale * right * z, -scale * down * z
            rays.append((right, down, z))
            jacobians.append(
                (
                    (xx * d - xy * c, xy * a - xx * b),
                    (xy * d - yy * c, yy * a - xy * b),
                    (xz * d - yz * c, yz * a - xz * b),
                )
            )
        return np.array(rays), np.array(jacobians)

    def _first_undistorted(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 2) undistorted normalized coordinates by OpenCV, which may not have converged."""
        undistorted: NDArray[np.float64] = cv2.undistortPointsIter(
            pixels[:, None], self._matrix, self.distortion, None, None, _CRITERIA
        ).reshape(-1, 2)
        return undistorted

    def _undistort(
        self, pixels: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(N, 2) undistorted normalized coordinates, and (N, 2, 2) derivatives by the pixel."""
        if not len(pixels):
            return np.empty((0, 2)), np.empty((0, 2, 2))
        normalized = self._first_undistorted(pixels)
        with np.errstate(divide="ignore", invalid="ignore"):
            for _ in range(_STEPS):
                projected, jacobian = self._distort(normalized)
                determinant = (
                    jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0]
                )
                flat = jacobian.reshape(-1, 4) @ _ADJUGATE / determinant[:, None]
                inverse = flat.reshape(-1, 2, 2)
                step = np.einsum("nij,nj->ni", inverse, pixels - projected)
                size = np.abs(step).max(axis=1)
                if not np.count_nonzero(size > _TOLERANCE):
                    break
                normalized = normalized + step
        # Beyond the fold of the polynomial, pixels have no ray, or one on the other side.
        side = np.einsum("ni,ni->n", pixels - self._center, normalized)
        solved = (size <= _TOLERANCE) & (determinant > 0.0) & (side > -_TOLERANCE)
        if np.count_nonzero(solved) < len(solved):
            normalized = np.where(solved[:, None], normalized, np.nan)
        return normalized, inverse

    def _distorted_angle(
        self, angle: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(N,) distorted angles of the equidistant model, and their derivatives by the angle."""
        if not len(self.distortion):
            return angle, np.ones_like(angle)
        square = angle * angle
        k1, k2, k3, k4 = self.distortion
        value = angle * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
        slope = 1.0 + square * (
            3.0 * k1 + square * (5.0 * k2 + square * (7.0 * k3 + square * 9.0 * k4))
        )
        return value, slope

    def _equidistant_rays(
        self, pixels: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        offsets = (pixels - self._center) * self._scale
        distorted = np.maximum(np.sqrt(np.einsum("ni,ni->n", offsets, offsets)), 1e-12)
        angle = np.minimum(distorted, math.pi)
        for _ in range(_STEPS):
            value, slope = self._distorted_angle(angle)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = (distorted - value) / slope
            if not (np.abs(step) > _TOLERANCE).any():
                break
            angle = np.clip(angle + step, 0.0, math.pi)
        unsolved = ~((np.abs(step) <= _TOLERANCE) & (slope > 0.0))
        angle = np.where(unsolved, np.nan, angle)
        direction = offsets / distorted[:, None]
        sine, cosine = np.sin(angle), np.cos(angle)
        rays = np.column_stack([direction * sine[:, None], cosine])
        # Along the radius the angle changes by 1 / slope, across it the direction turns.
        jacobian = np.empty((len(pixels), 3, 2))
        along = np.column_stack([direction * cosine[:, None], -sine]) / slope[:, None]
        turned = np.column_stack([-direction[:, 1], direction[:, 0]])
        across = turned * (sine / distorted)[:, None]
        jacobian[:] = along[:, :, None] * direction[:, None, :]
        jacobian[:, :2] += across[:, :, None] * turned[:, None, :]
        return rays, jacobian * self._scale
