"""The ground plane from boxes of people of a known height.

A person's distance follows from the foot's slope s_foot and the camera's height H, and from both
ends' slopes and the person's height h (see `fusion`). Both are equal, so for each box

    log((s_foot - s_head) / h) - log(s_foot / H) = 0,

up to an error of the variance p^2 + e^2 (1 + (1 - h / H)^2): p is the deviation of the person's
height, e that of an edge, both relative; the foot's edge is in both terms. The slopes depend on
pitch and roll. The
Levenberg-Marquardt method finds H, pitch and roll with the least sum of Huber's loss, within
bounds: without any, boxes at similar distances also agree with a camera that looks straight down.
It starts from the line of the heights over the lower edges (see `height_line`), which is the ground
before a level camera.

Where the direction down is known, as from gravity, each box gives H by itself. The result is the
mean of the logarithms without outliers, each weighted by p, e and the effect of the tilt's error
on its slope; boxes at one distance are enough.

Sources: Hoiem, Efros and Hebert 2008, "Putting Objects in Perspective"; Huber 1964, "Robust
Estimation of a Location Parameter".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros.world.box_edges import BoxEdges
from pf_tracker_ros.world.camera_model import CameraModel
from pf_tracker_ros.world.ground_plane import GroundPlane, default_tilt_sd
from pf_tracker_ros.world.height_line import HeightLine

MIN_BOXES = 50
# Bounds of height (meters), pitch and roll (radians).
_BOUNDS = np.array([[math.log(0.2), -0.35, -0.26], [math.log(50.0), 1.2, 0.26]])
# Standard deviation of a roll: cameras are mounted about level.
_ROLL_SD = 0.1
# Standard deviations of the logarithm of a person's height, and of a detector's edge, box heights.
_PERSON_SD, _EDGE_SD = 0.05, 0.08
_STEPS, _TOLERANCE = 60, 1e-7
# Smallest slope of a foot, and difference of slopes.
_LEAST_SLOPE = 1e-3
# Residual beyond which Huber's loss grows linearly, in standard deviations, and beyond which a box
# does not agree with the plane.
_HUBER, _AGREES_WITHIN = 2.0, 3.0
# Smallest standard deviation of a residual, in units of the expected one.
_LEAST_SD = 0.2
# Smallest information of a direction of the parameters, against a division by zero.
_LEAST_INFORMATION = 1e-9
# Standard deviation of the logarithm of the people's true mean height.
_MEAN_HEIGHT_SD = 0.03
# Largest standard deviations in a usable fit: of the logarithm of the height, of the pitch
# (radians), and of a residual in units of the expected one.
_LARGEST_SDS = 0.15, 0.06, 1.5
# Share of the boxes left out at each end, and least ratio of the farthest other box's distance to
# the nearest's. Edge errors alone give less. Where they give most of the variety, the fit takes
# them for the ground: it has a bias that the covariance does not contain.
_ENDS, _LEAST_RATIO = 10.0, 1.5


@dataclass(frozen=True, eq=False)
class PeopleGround:
    """A ground plane that was learned.

    Attributes:
        plane: The ground, its `tilt_sd` and `height_sd` from the fit.
        boxes: Number of boxes that agree with it.

    Example:
        See `fit_ground_plane`:

        >>> from pf_tracker_ros.world import GroundPlane, PeopleGround
        >>> learned = PeopleGround(GroundPlane.from_angles(2.0), boxes=80)
        >>> learned.plane.height, learned.boxes
        (2.0, 80)
    """

    plane: GroundPlane
    boxes: int


def fit_ground_plane(
    camera: CameraModel,
    boxes: ArrayLike,
    target_height: float = 1.75,
    *,
    down: ArrayLike | None = None,
) -> PeopleGround:
    """Fit height, pitch and roll of a camera to people who stand on the ground.

    Args:
        camera: Its calibration.
        boxes: (N, 4) x, y, width, height in pixels, at least 50 that are whole, best of various
            people; boxes that the border cuts are left out. Without the nearest and the farthest
            tenth, the farthest is at least 1.5 times as far as the nearest.
        target_height: Mean height of the people, meters.
        down: (3,) direction down in camera coordinates, or (N, 3) of each box, where it is known:
            only the height is fitted, and boxes at one distance are enough. The plane has the last
            of them.

    Raises:
        ValueError: Fewer than 50 whole boxes, an argument has a wrong shape or range, or the
            boxes do not determine a plane.

    Example:
        People of 1.75 m, 4 to 12 m before a level camera, 2 m above the ground:

        >>> import numpy as np
        >>> from pf_tracker_ros.world import CameraModel, fit_ground_plane
        >>> camera = CameraModel(500.0, 500.0, 320.0, 240.0, 640, 480)
        >>> random = np.random.default_rng(0)
        >>> z, x = random.uniform(4.5, 12.0, 80), random.uniform(-2.0, 2.0, 80)
        >>> top, bottom = 240 + 500 * 0.25 / z, 240 + 500 * 2.0 / z
        >>> width = 500 * 0.5 / z
        >>> boxes = np.column_stack([320 + 500 * x / z - width / 2, top, width, bottom - top])
        >>> learned = fit_ground_plane(camera, boxes)
        >>> bool(abs(learned.plane.height - 2.0) < 0.1)
        True
    """
    if not 0.0 < target_height < math.inf:
        raise ValueError(
            f"target_height is {target_height!r}; expected a positive number of meters"
        )
    values = np.asarray(boxes, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != 4:
        raise ValueError(f"boxes have shape {values.shape}; expected (N, 4)")
    rays, is_whole = _rays(camera, values)
    if len(rays[0]) < MIN_BOXES:
        raise ValueError(
            f"{len(rays[0])} of {len(values)} boxes are whole; a plane needs at least {MIN_BOXES}"
        )
    if down is not None:
        return _fit_height(rays, _directions(down, len(values))[is_whole], target_height)
    fit = _Fit.of(rays, target_height, camera.fy)
    height_sd, pitch_sd = fit.standard_deviations()[:2]
    at_bound = (fit.parameters <= _BOUNDS[0]) | (fit.parameters >= _BOUNDS[1])
    ratio = _distance_ratio(fit.parameters, rays)
    if (
        at_bound.any()
        or (np.array([height_sd, pitch_sd, fit.scale]) > _LARGEST_SDS).any()
        or ratio < _LEAST_RATIO
    ):
        raise ValueError(
            "the boxes do not determine the ground; expected people who stand on one plane, at "
            f"various distances, the far ones at least {_LEAST_RATIO:g} times as far as the near "
            f"ones (here {ratio:.2f} times)"
        )
    log_height, pitch, roll = fit.parameters.tolist()
    height = math.exp(log_height)
    plane = GroundPlane.from_angles(height, pitch, roll)
    # Height and pitch correlate: at the boxes' distances their errors cancel, and each for itself
    # is as sure as with the other one known.
    alone = 1.0 / np.sqrt(np.diagonal(fit.information))
    tilt_sd = math.hypot(plane.tilt_sd, float(alone[1]))
    height_sd = height * math.hypot(_MEAN_HEIGHT_SD, float(alone[0]))
    return PeopleGround(
        GroundPlane(plane.down, height, tilt_sd, height_sd),
        int((np.abs(fit.residuals) < _AGREES_WITHIN * fit.scale).sum()),
    )


def _directions(down: ArrayLike, count: int) -> NDArray[np.float64]:
    """(count, 3) unit vectors from one for all, or one for each."""
    given = np.asarray(down, dtype=np.float64)
    if given.shape not in ((3,), (count, 3)):
        raise ValueError(f"down has shape {given.shape}; expected (3,) or ({count}, 3)")
    lengths = np.linalg.norm(given, axis=-1, keepdims=True)
    if not (np.isfinite(lengths) & (lengths > 0.0)).all():
        raise ValueError("down must be finite, and not zero")
    return np.broadcast_to(given / lengths, (count, 3))


def _fit_height(
    rays: tuple[NDArray[np.float64], NDArray[np.float64]],
    downs: NDArray[np.float64],
    target_height: float,
) -> PeopleGround:
    """The ground below a camera whose direction down is known at each box."""
    foot, head = (_slopes(np.einsum("ni,ni->n", one, downs)) for one in rays)
    is_below = (foot > _LEAST_SLOPE) & (foot - head > _LEAST_SLOPE)
    if is_below.sum() < MIN_BOXES:
        raise ValueError(
            f"{is_below.sum()} of {len(foot)} boxes have their foot below the horizon; with a "
            f"known direction down, the ground needs at least {MIN_BOXES}. Is that direction right?"
        )
    foot, head = foot[is_below], head[is_below]
    logs = np.log(target_height * foot / (foot - head))
    median = float(np.median(logs))
    share = target_height * math.exp(-median)
    expected = math.hypot(_PERSON_SD, _EDGE_SD, _EDGE_SD * (1.0 - share))
    scale = expected * _scale((logs - median) / expected)
    tilt_sd = default_tilt_sd(math.exp(median))
    sds = np.hypot(scale, tilt_sd * (1.0 + foot * foot) / foot)
    agrees = np.abs(logs - median) < _AGREES_WITHIN * sds
    if scale > _LARGEST_SDS[2] * expected:
        raise ValueError(
            f"the boxes do not determine the ground: the heights of the camera that they give "
            f"differ by {100.0 * scale:.0f} %; expected people who stand on one plane"
        )
    height = math.exp(float(np.average(logs[agrees], weights=sds[agrees] ** -2.0)))
    # The people may be few, or one.
    height_sd = height * math.hypot(_PERSON_SD, scale / math.sqrt(agrees.sum()))
    return PeopleGround(GroundPlane(downs[-1], height, tilt_sd, height_sd), int(agrees.sum()))


@dataclass(frozen=True, eq=False)
class _Fit:
    """A local minimum.

    Attributes:
        parameters: (3,) logarithm of the height, pitch, roll.
        residuals: (N,) in units of the expected standard deviation.
        scale: Standard deviation of a residual, from their median.
        information: (3, 3) inverse of the parameters' covariance.
    """

    parameters: NDArray[np.float64]
    residuals: NDArray[np.float64]
    scale: float
    information: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        rays: tuple[NDArray[np.float64], NDArray[np.float64]],
        target_height: float,
        focal_length: float,
    ) -> _Fit:
        """The minimum that is reached from the line of the heights over the lower edges.

        Args:
            rays: To feet and heads.
            target_height: Mean height of the people, meters.
            focal_length: Pixels.
        """
        parameters = _before_level_camera(rays, target_height, focal_length)
        # Outliers change the line, but hardly the median.
        parameters[0] -= float(np.median(_log_ratios(parameters, rays, target_height)))
        parameters = np.clip(parameters, *_BOUNDS)
        damping = 1e-3
        prior = np.array([0.0, 0.0, 1.0 / _ROLL_SD])
        residuals = _residuals(parameters, rays, target_height)
        scale = _scale(residuals)
        loss = _loss(residuals, scale) + float(np.square(prior * parameters).sum())
        for _ in range(_STEPS):
            jacobian = _jacobian(parameters, rays, target_height) / scale
            weights = np.minimum(1.0, _HUBER * scale / np.maximum(np.abs(residuals), 1e-12))
            normal = jacobian.T @ (weights[:, None] * jacobian) + np.diag(prior**2)
            gradient = jacobian.T @ (weights * residuals / scale) + prior**2 * parameters
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-9), gradient)
            tried = np.clip(parameters - step, *_BOUNDS)
            tried_residuals = _residuals(tried, rays, target_height)
            tried_loss = _loss(tried_residuals, scale) + float(np.square(prior * tried).sum())
            if tried_loss < loss:
                change = float(np.abs(tried - parameters).max())
                parameters, residuals, damping = tried, tried_residuals, damping / 5.0
                scale = _scale(residuals)
                loss = _loss(residuals, scale) + float(np.square(prior * parameters).sum())
                if change < _TOLERANCE:
                    break
            else:
                damping *= 5.0
                if damping > 1e6:
                    break
        jacobian = _jacobian(parameters, rays, target_height) / scale
        information = jacobian.T @ jacobian + np.diag(prior**2)
        return cls(parameters, residuals, scale, information)

    def standard_deviations(self) -> NDArray[np.float64]:
        """(3,) of the parameters; huge where the boxes say nothing of one."""
        values, vectors = np.linalg.eigh(self.information)
        variances = np.square(vectors) / np.maximum(values, _LEAST_INFORMATION)
        return np.sqrt(variances.sum(axis=1))


def _rays(
    camera: CameraModel, boxes: NDArray[np.float64]
) -> tuple[tuple[NDArray[np.float64], NDArray[np.float64]], NDArray[np.bool_]]:
    """Unit vectors (M, 3) to the feet, and to the heads, of whole boxes, and which these are."""
    pixels = np.full((len(boxes), 2, 2), np.nan)
    for index, box in enumerate(boxes):
        edges = BoxEdges.of(box, None, (camera.width, camera.height))
        if edges is not None and edges.is_whole:
            pixels[index] = edges.points()[:2]
    is_whole = np.isfinite(pixels).all(axis=(1, 2))
    rays = camera.rays(pixels[is_whole]).reshape(-1, 2, 3)
    has_rays = np.isfinite(rays).all(axis=(1, 2))
    is_whole[is_whole] = has_rays
    return (rays[has_rays, 0], rays[has_rays, 1]), is_whole


def _before_level_camera(
    rays: tuple[NDArray[np.float64], NDArray[np.float64]],
    target_height: float,
    focal_length: float,
) -> NDArray[np.float64]:
    """(3,) parameters from the boxes that a level camera would see."""
    foot, head = (focal_length * _slopes(one[:, 1]) for one in rays)
    line = HeightLine.fit(foot, foot - head)
    # The higher the camera, the less slope.
    slope = max(line.slope, target_height / math.exp(_BOUNDS[1, 0]))
    horizon = line.lower_edge - line.height / slope
    start = math.log(target_height / slope), math.atan(-horizon / focal_length), 0.0
    return np.clip(start, *_BOUNDS)


def _distance_ratio(
    parameters: NDArray[np.float64],
    rays: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> float:
    """Distance of the far boxes over that of the near ones, by the people's height."""
    near, far = np.percentile(_extents(parameters, rays)[0], (100.0 - _ENDS, _ENDS))
    return float(near / far)


def _residuals(
    parameters: NDArray[np.float64],
    rays: tuple[NDArray[np.float64], NDArray[np.float64]],
    target_height: float,
) -> NDArray[np.float64]:
    """(N,) logarithms of the ratio of both distances, in expected standard deviations."""
    share = target_height * math.exp(-float(parameters[0]))
    sd = math.hypot(_PERSON_SD, _EDGE_SD, _EDGE_SD * (1.0 - share))
    return _log_ratios(parameters, rays, target_height) / sd


def _log_ratios(
    parameters: NDArray[np.float64],
    rays: tuple[NDArray[np.float64], NDArray[np.float64]],
    target_height: float,
) -> NDArray[np.float64]:
    """(N,) logarithms of the distance by the ground over that by the height."""
    extent, foot = _extents(parameters, rays)
    return np.log(extent / target_height) - np.log(foot) + float(parameters[0])


def _extents(
    parameters: NDArray[np.float64],
    rays: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N,) slopes of the feet less those of the heads, and (N,) slopes of the feet."""
    _, pitch, roll = parameters.tolist()
    down = GroundPlane.from_angles(None, pitch, roll, 0.0).down
    foot, head = (_slopes(one @ down) for one in rays)
    return np.maximum(foot - head, _LEAST_SLOPE), np.maximum(foot, _LEAST_SLOPE)


def _slopes(sines: NDArray[np.float64]) -> NDArray[np.float64]:
    return sines / np.sqrt(np.maximum(1.0 - sines * sines, 1e-6))


def _jacobian(
    parameters: NDArray[np.float64],
    rays: tuple[NDArray[np.float64], NDArray[np.float64]],
    target_height: float,
) -> NDArray[np.float64]:
    """(N, 3) derivatives of the residuals by the parameters, by central differences."""
    columns = [
        _residuals(parameters + step, rays, target_height)
        - _residuals(parameters - step, rays, target_height)
        for step in 1e-5 * np.eye(3)
    ]
    return np.column_stack(columns) / 2e-5


def _scale(residuals: NDArray[np.float64]) -> float:
    """Standard deviation of residuals of which some are outliers."""
    return max(1.4826 * float(np.median(np.abs(residuals))), _LEAST_SD)


def _loss(residuals: NDArray[np.float64], scale: float) -> float:
    """Twice the sum of Huber's loss."""
    relative = np.abs(residuals) / scale
    return float(np.where(relative < _HUBER, relative**2, _HUBER * (2.0 * relative - _HUBER)).sum())
