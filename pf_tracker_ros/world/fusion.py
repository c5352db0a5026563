"""Fused horizontal distance of a target, and the position that follows.

The target stands upright on a foot at the horizontal distance D; s is the slope of a pixel's ray,
the tangent of its angle below the horizon. Three measurements of 1 / D have errors that are nearly
Gaussian at any distance:

1. `ground`: s_foot / (height of the camera);
2. `height`: (s_foot - s_head) / (height of the target);
3. `depth`: 1 / (horizontal distance of the point in the depth image).

All three are of the target's near side; the middle is a little farther.

An error is linear in independent ones of variance 1: of the box's edges, the tilt of the ground,
the heights of camera and target, the foot's near side, and the depth. So it is a vector, and the
product of two is the covariance. Two measurements x and y with errors a and b give the best
linear unbiased estimate w x + (1 - w) y with w = (b - a) b / |a - b|^2, whose error is
w a + (1 - w) b. The errors of ground and height correlate through edges and tilt; that of the
depth is independent of both, so they are fused one after the other.

Source: Kay 1993, "Fundamentals of Statistical Signal Processing: Estimation Theory", section 6.5.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.world.view import View

# From the near side of the target to its middle, meters, and for the foot its standard deviation:
# people make steps.
TO_MIDDLE, _TO_MIDDLE_SD = 0.05, 0.15
# Least slope of a foot on the ground: 3 arc minutes below the horizon.
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

# Derivatives by three errors of edges, then tilt, height of the camera, height of the target, near
# side of the foot, depth.
_Error = list[float]
_TILT, _NEAR_SIDE = 3, 6


@dataclass(frozen=True)
class TargetHeight:
    """Height of targets in meters, with the standard deviation among them."""

    mean: float
    sd: float


@dataclass(frozen=True)
class FusedDistance:
    """Horizontal distance of a target's middle.

    Attributes:
        methods: Names of the measurements in it.
        distance: Meters.
        error: Its derivatives by the independent errors, meters.
    """

    methods: tuple[str, ...]
    distance: float
    error: _Error

    @property
    def sd(self) -> float:
        """Standard deviation of the distance, meters."""
        return math.sqrt(_product(self.error, self.error))


@dataclass(frozen=True, eq=False)
class Surface:
    """A point on the target's surface, from depth.

    Attributes:
        point: (3,) in camera coordinates, meters.
        distance: Horizontal distance of it, meters; the target's middle is a little farther.
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
        return float(np.linalg.norm(self.point)) < self.distance * math.hypot(1.0, _STEEPEST)


def box_measurements(view: View, target_height: TargetHeight) -> dict[str, float]:
    """Method to 1 / distance in 1/m of the middle of the target, of what the box itself allows."""
    inverses: dict[str, float] = {}
    if not view.has_foot:
        return inverses
    foot, head = view.slopes[:2]
    if view.plane.height is not None and foot > _LEAST_SLOPE:
        inverses["ground"] = foot / view.plane.height
    if view.has_head and foot > head:
        inverses["height"] = (foot - head) / target_height.mean
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
        inverses: Method to measured 1 / distance, at least one, 1/m; `depth` last.
        target_height: Height of targets.
        depth_sd: Standard deviation of the horizontal distance from depth, meters.
    """
    inverse = inverses.get("depth", sum(inverses.values()) / len(inverses))
    errors = _errors(view, inverses, target_height, depth_sd, inverse)
    if "depth" in inverses:
        # The depth is more direct than what it contradicts.
        inverses = {
            name: value
            for name, value in inverses.items()
            if _squared_distance(value - inverse, errors[name], errors["depth"]) < _CONTRADICTION
        }
    # Errors depend on the distance: those of each at its own would favor the nearer.
    scale = 1.0
    for _ in range(2):
        errors = _errors(view, inverses, target_height, depth_sd, inverse)
        names = iter(inverses)
        first = next(names)
        inverse, error = inverses[first], errors[first]
        for name in names:
            squared = _squared_distance(inverses[name] - inverse, errors[name], error)
            scale = max(scale, math.sqrt(squared / _CONTRADICTION))
            inverse, error = _combine(inverse, error, inverses[name], errors[name])
    factor = -scale / inverse**2
    return FusedDistance(tuple(inverses), 1.0 / inverse, [factor * one for one in error])


def foot_position(
    view: View, fused: FusedDistance
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(3,) position of the lower center in camera coordinates, and (3, 3) covariance."""
    ray, slope = view.rays[0], view.slopes[0]
    cosine = float(view.horizontal[0])
    forward = (ray - slope * cosine * view.plane.down) / cosine
    # On the ray to the near side, and from there level to the middle at the distance D:
    # P = (D - to middle) / cosine * ray + to middle * forward.
    length = (fused.distance - TO_MIDDLE) / cosine
    along = np.array(fused.error)
    along[_NEAR_SIDE] -= _TO_MIDDLE_SD
    along /= cosine
    # The cosine changes with the edges and with the tilt.
    along[:3] += length * slope * cosine * cosine * np.array(view.slope_errors[0])
    along[_TILT] += length * slope * view.plane.tilt_sd
    by_errors = ray[:, None] * along
    by_errors[:, :3] += length * view.ray_errors[0]
    by_errors[:, _NEAR_SIDE] += _TO_MIDDLE_SD * forward
    position = length * ray + TO_MIDDLE * forward
    return position, by_errors @ by_errors.T + _SMALLEST_COVARIANCE


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
        drop = plane.height - level
        drop_sd = math.hypot(plane.tilt_sd * surface.distance, plane.height_sd)
    elif view.has_head:
        drop = surface.distance * view.slopes[1] + target_height.mean - level
        drop_sd = target_height.sd
    else:
        drop = _UNSEEN_SHARE * target_height.mean
        drop_sd = _UNSEEN_SHARE_SD * target_height.mean
    forward = (surface.point - level * plane.down) / max(surface.distance, 1e-9)
    by_errors = np.column_stack(
        [
            surface.sd * forward,
            math.sqrt(view.edges.covariance[0, 0]) * surface.across,
            drop_sd * plane.down,
        ]
    )
    position = surface.point + TO_MIDDLE * forward + drop * plane.down
    return position, by_errors @ by_errors.T + _SMALLEST_COVARIANCE


def _errors(
    view: View,
    inverses: Mapping[str, float],
    target_height: TargetHeight,
    depth_sd: float,
    inverse: float,
) -> dict[str, _Error]:
    """Method to the error of its 1 / distance, at an estimate of that."""
    (foot, head), plane = view.slopes[:2], view.plane
    # 1 / distance of the near side, and the derivative of that of the middle by it.
    near = inverse / max(1.0 - TO_MIDDLE * inverse, 0.1)
    by_near = (inverse / near) ** 2
    of_middle = -(inverse**2) * _TO_MIDDLE_SD
    errors: dict[str, _Error] = {}
    for name in inverses:
        if name == "ground":
            scale = by_near / (plane.height or 1.0)
            edges = [scale * one for one in view.slope_errors[0]]
            tilt = scale * (1.0 + foot * foot) * plane.tilt_sd
            camera = -scale * near * plane.height_sd
            errors[name] = [*edges, tilt, camera, 0.0, of_middle, 0.0]
        elif name == "height":
            scale = by_near / target_height.mean
            of_foot, of_head = view.slope_errors
            edges = [scale * (one - other) for one, other in zip(of_foot, of_head, strict=True)]
            tilt = scale * (foot * foot - head * head) * plane.tilt_sd
            target = -scale * near * target_height.sd
            errors[name] = [*edges, tilt, 0.0, target, of_middle, 0.0]
        else:
            errors[name] = [0.0] * 7 + [-(inverse**2) * depth_sd]
    return errors


def _combine(one: float, error: _Error, other: float, other_error: _Error) -> tuple[float, _Error]:
    """The best linear unbiased estimate from two, and its error."""
    difference = [a - b for a, b in zip(error, other_error, strict=True)]
    variance = _product(difference, difference)
    weight = -_product(difference, other_error) / variance if variance > 0.0 else 0.5
    combined = other + weight * (one - other)
    if combined <= 0.0:
        # The weights of correlated measurements may leave 0 to 1.
        weight = min(max(weight, 0.0), 1.0)
        combined = other + weight * (one - other)
    return combined, [b + weight * d for b, d in zip(other_error, difference, strict=True)]


def _squared_distance(difference: float, error: _Error, other: _Error) -> float:
    """Squared difference of two measurements in standard deviations."""
    between = [a - b for a, b in zip(error, other, strict=True)]
    return difference**2 / max(_product(between, between), 1e-300)


def _product(one: _Error, other: _Error) -> float:
    return sum(map(operator.mul, one, other))


_SMALLEST_COVARIANCE = _SMALLEST_SD**2 * np.eye(3)
