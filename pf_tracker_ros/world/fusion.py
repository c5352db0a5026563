"""Fused horizontal distance of a target, and the position that follows.

The target stands upright on a foot at the horizontal distance D; s is the slope of a pixel's ray,
the tangent of its angle below the horizon. Three measurements of 1 / D have errors that are nearly
Gaussian at any distance:

1. `ground`: s_foot / (height of the camera);
2. `height`: (s_foot - s_head) / (height of the target);
3. `depth`: 1 / (horizontal distance of the point in the depth image).

The first two are of the foot's near side, where the box ends; the middle is a little farther.

The errors are linear in independent ones: of the box's edges, the tilt of the ground, the heights of
camera and target, the foot's near side, and the depth. The fused 1 / D is the best linear unbiased
estimate, and its covariance contains the correlation through edges and tilt that the measurements
share. The same errors give the covariance of the position.

Source: Kay 1993, "Fundamentals of Statistical Signal Processing: Estimation Theory", section 6.5.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.world.view import View

# Columns of the independent errors: middle, lower and upper edge of the box (pixels), tilt (radians),
# height of the camera, of the target, near side of the foot, and distance from the depth (meters).
_EDGES, _TILT, _CAMERA, _TARGET, _NEAR_SIDE, _DEPTH = slice(0, 3), 3, 4, 5, 6, 7
_ERRORS = 8
# From the near side of the foot to the middle of the target and its standard deviation, meters: half
# a step.
TO_MIDDLE, _TO_MIDDLE_SD = 0.07, 0.15
# Least slope of a foot on the ground: 57 arc minutes below the horizon.
_LEAST_SLOPE = 1e-3
# Squared distance in standard deviations from which two measurements contradict each other.
_CONTRADICTION = 9.0


# A point of the target shows how far the foot below it is up to this slope: 70 degrees.
_STEEPEST = 2.75
# Smallest standard deviation of a position, meters.
_SMALLEST_SD = 0.02
# Unseen foot of a target with unknown ground and head: below the point by this share of its height,
# with this standard deviation.
_UNSEEN_SHARE, _UNSEEN_SHARE_SD = 0.5, 0.25


@dataclass(frozen=True)
class TargetHeight:
    """Height of targets in meters, with the standard deviation among them."""

    mean: float
    sd: float


@dataclass(frozen=True, eq=False)
class FusedDistance:
    """Horizontal distance of a target's middle.

    Attributes:
        methods: Names of the measurements in it.
        distance: Meters.
        gradient: (8,) of the distance by the independent errors.
        errors: (8, 8) covariance of these.
    """

    methods: tuple[str, ...]
    distance: float
    gradient: NDArray[np.float64]
    errors: NDArray[np.float64]

    @property
    def sd(self) -> float:
        """Standard deviation of the distance, meters."""
        return math.sqrt(float(self.gradient @ self.errors @ self.gradient))


@dataclass(frozen=True, eq=False)
class Surface:
    """A point on the target's surface, from depth.

    Attributes:
        point: (3,) in camera coordinates, meters.
        distance: Horizontal distance of it, meters.
        sd: Standard deviation of that, meters.
        across: (3,) derivative of the point by the pixel's column, meters per pixel.
    """

    point: NDArray[np.float64]
    distance: float
    sd: float
    across: NDArray[np.float64]

    @property
    def shows_distance(self) -> bool:
        """Whether the camera does not look down on it from nearly above."""
        return float(np.linalg.norm(self.point)) < self.distance * (1.0 + _STEEPEST**2) ** 0.5


def box_measurements(view: View, target_height: TargetHeight) -> dict[str, float]:
    """Method to 1 / distance in 1/m of the middle of the target, of what the box itself allows."""
    inverses: dict[str, float] = {}
    if not view.has_foot:
        return inverses
    foot = float(view.slopes[0])
    if view.plane.height is not None and foot > _LEAST_SLOPE:
        inverses["ground"] = foot / view.plane.height
    if view.has_head:
        inverse = (foot - float(view.slopes[1])) / target_height.mean
        if inverse > 0.0:
            inverses["height"] = inverse
    return {name: one / (1.0 + TO_MIDDLE * one) for name, one in inverses.items()}


def fuse(
    view: View,
    inverses: Mapping[str, float],
    target_height: TargetHeight,
    depth_sd: float = 0.0,
) -> FusedDistance:
    """The best linear unbiased estimate of the distance.

    Args:
        view: Of the box; its foot is visible.
        inverses: Method to measured 1 / distance, at least one, 1/m.
        target_height: Height of targets.
        depth_sd: Standard deviation of the horizontal distance from depth, meters.
    """
    errors = _error_covariance(view, target_height, depth_sd)
    if "depth" in inverses:
        inverses = _without_contradictions(view, inverses, target_height, errors)
    values = np.array(list(inverses.values()))
    inverse = inverses.get("depth", float(values.mean()))
    scale = 1.0
    # Variances depend on the distance: those of each at its own would favor the nearer.
    for _ in range(2):
        gradients = _gradients(view, inverses, target_height, inverse)
        if len(values) == 1:
            weights = np.ones(1)
            break
        covariance = gradients @ errors @ gradients.T
        information = np.linalg.inv(covariance)
        weights = information.sum(axis=0)
        weights /= weights.sum()
        inverse = float(weights @ values)
        if inverse <= 0.0:
            inverse = float(values.min())
        residuals = values - inverse
        squared = float(residuals @ information @ residuals) / (len(values) - 1)
        scale = max(1.0, squared / _CONTRADICTION) ** 0.5
    gradient = -(weights @ gradients) / inverse**2
    return FusedDistance(tuple(inverses), 1.0 / inverse, scale * gradient, errors)


def foot_position(
    view: View, fused: FusedDistance
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(3,) position of the lower center in camera coordinates, and (3, 3) covariance."""
    ray, jacobian = view.rays[0], view.jacobians[0]
    cosine, slope = float(view.horizontals[0]), float(view.slopes[0])
    length = fused.distance / cosine
    # P = D / cos(angle) * ray: by the distance, the pixel, and the tilt of the horizon.
    by_errors = np.outer(ray / cosine, fused.gradient)
    by_errors[:, :2] += length * jacobian
    by_errors[:, :2] += np.outer(ray, length * slope / cosine * (view.plane.down @ jacobian))
    by_errors[:, _TILT] += length * slope * ray
    covariance = by_errors @ fused.errors @ by_errors.T
    return length * ray, (covariance + covariance.T) / 2.0


def position_below(
    view: View, surface: Surface, target_height: TargetHeight
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position of the lower center where no foot is visible: below a point on the surface.

    Args:
        view: Of the box.
        surface: The point.
        target_height: Height of targets.

    Returns:
        (3,) in camera coordinates, and (3, 3) covariance.
    """
    plane = view.plane
    level = float(surface.point @ plane.down)
    if plane.height is not None:
        drop, drop_sd = (
            plane.height - level,
            math.hypot(plane.tilt_sd * surface.distance, plane.height_sd),
        )
    elif view.has_head:
        drop = surface.distance * float(view.slopes[1]) + target_height.mean - level
        drop_sd = target_height.sd
    else:
        drop = _UNSEEN_SHARE * target_height.mean
        drop_sd = _UNSEEN_SHARE_SD * target_height.mean
    forward = surface.point - level * plane.down
    forward = forward / max(surface.distance, 1e-9)
    across_variance = float(view.edges.covariance[0, 0])
    covariance = surface.sd**2 * np.outer(forward, forward)
    covariance += across_variance * np.outer(surface.across, surface.across)
    covariance += drop_sd**2 * np.outer(plane.down, plane.down)
    # A person's middle is known to some centimeters at best, also across.
    covariance += _SMALLEST_SD**2 * np.eye(3)
    return surface.point + drop * plane.down, covariance


def _error_covariance(
    view: View, target_height: TargetHeight, depth_sd: float
) -> NDArray[np.float64]:
    """(8, 8) of the independent errors."""
    plane = view.plane
    errors = np.zeros((_ERRORS, _ERRORS))
    errors[_EDGES, _EDGES] = view.edges.covariance
    sds = (plane.tilt_sd, plane.height_sd, target_height.sd, _TO_MIDDLE_SD, depth_sd)
    for column, sd in zip((_TILT, _CAMERA, _TARGET, _NEAR_SIDE, _DEPTH), sds, strict=True):
        errors[column, column] = sd * sd
    return errors


def _gradients(
    view: View, inverses: Mapping[str, float], target_height: TargetHeight, inverse: float
) -> NDArray[np.float64]:
    """(M, 8) derivatives of the measured 1 / distance by the errors, at an estimate of it."""
    (foot, head), (foot_gradient, head_gradient) = view.slopes[:2], view.slope_gradients[:2]
    # 1 / distance of the near side, and the derivative of that of the middle by it.
    near = inverse / max(1.0 - TO_MIDDLE * inverse, 0.1)
    by_near = (inverse / near) ** 2
    gradients = np.zeros((len(inverses), _ERRORS))
    for row, name in zip(gradients, inverses, strict=True):
        if name == "depth":
            row[_DEPTH] = -inverse * inverse
            continue
        if name == "ground":
            height = view.plane.height or 1.0
            row[:2] = foot_gradient
            row[_TILT] = 1.0 + foot * foot
            row[_CAMERA] = -near
        else:
            height = target_height.mean
            row[0] = foot_gradient[0] - head_gradient[0]
            row[1], row[2] = foot_gradient[1], -head_gradient[1]
            row[_TILT] = foot * foot - head * head
            row[_TARGET] = -near
        row *= by_near / height
        row[_NEAR_SIDE] = -inverse * inverse
    return gradients


def _without_contradictions(
    view: View,
    inverses: Mapping[str, float],
    target_height: TargetHeight,
    errors: NDArray[np.float64],
) -> dict[str, float]:
    """The measurements that the depth does not contradict: it is the more direct one."""
    names, depth = list(inverses), inverses["depth"]
    gradients = _gradients(view, inverses, target_height, depth)
    differences = gradients - gradients[names.index("depth")]
    variances = np.einsum("ni,ij,nj->n", differences, errors, differences)
    return {
        name: value
        for (name, value), variance in zip(inverses.items(), variances.tolist(), strict=True)
        if name == "depth" or (value - depth) ** 2 <= _CONTRADICTION * variance
    }
