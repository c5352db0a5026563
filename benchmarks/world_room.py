"""A rendered room with exact truth: a robot that drives and turns, people who walk, and a pillar.

The room is a cylinder around the origin of the fixed frame (x forward at the start, y left, z up).
The camera is a pin-hole camera with distortion, above the robot's base. Each frame has a color
image, depth with holes and noise, and where everybody is and is seen. A person is an elliptic
cylinder; noise of the depth grows with its square, and holes are squares.

Source of the noise: Khoshelham and Elberink 2012, "Accuracy and Resolution of Kinect Depth Data".
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from scenes.textures import fractal_noise

from pf_tracker_ros.world import CameraModel, GroundPlane

Array = NDArray[np.float64]
Path = Callable[[float], tuple[float, float]]

CAMERA = CameraModel(
    300.0, 300.0, 199.5, 149.5, 400, 300, distortion=(-0.25, 0.07, 0.0005, -0.0003, 0.0)
)
CAMERA_HEIGHT, CAMERA_PITCH = 1.2, 0.05
_RADIUS = 9.0
# Side of the textures, pixels, and pixels in a meter.
_TEXTURE, _SCALE = 512, 40.0
_NOISE = 3.0
# Shares of a person's height where shirt and head begin.
_WAIST, _NECK = 0.48, 0.84
_SKIN = (130, 160, 205)
# Half the width and half the thickness of a body, meters.
_HALF_WIDTH, _HALF_THICKNESS = 0.22, 0.12
# Standard deviation of the depth at 1 m, meters, and side of a hole, pixels.
_DEPTH_NOISE, _HOLE = 0.0015, 8


@dataclass(frozen=True)
class Walker:
    """A person, or a pillar that stands."""

    path: Path  # time in seconds to (x, y), meters
    shirt: tuple[int, int, int]  # color, BGR
    trousers: tuple[int, int, int]  # color, BGR
    height: float = 1.75  # meters
    is_pillar: bool = False  # whether it is a pillar, in the color of the shirt


@dataclass(frozen=True)
class Base:
    """Pose of the robot's base: x, y in meters, yaw in radians."""

    x: float
    y: float
    yaw: float


@dataclass(frozen=True, eq=False)
class RoomFrame:
    """A frame of a room."""

    time: float  # seconds since the first frame
    image: NDArray[np.uint8]  # (H, W, 3) uint8 BGR
    depth: NDArray[np.float32]  # (H, W) float32 in meters, NaN where it has holes
    base: Base  # pose of the robot
    positions: Array  # (walkers, 2) in the fixed frame, meters
    # (x, y, width, height) of each walker as if nobody stood before it, or None where it is out of
    # sight
    boxes: tuple[tuple[float, float, float, float] | None, ...]
    visible: tuple[float, ...]  # share of each walker's pixels that is not hidden

    @property
    def millimeters(self) -> NDArray[np.uint16]:
        """The depth image of a driver: (H, W) uint16, 0 in holes."""
        return np.nan_to_num(1e3 * self.depth).clip(0, 65535).astype(np.uint16)


def circling(center: tuple[float, float], radius: float, period: float, phase: float) -> Path:
    """A walk around a center, in meters, seconds and radians."""

    def path(time: float) -> tuple[float, float]:
        angle = phase + 2.0 * np.pi * time / period
        return center[0] + radius * np.cos(angle), center[1] + radius * np.sin(angle)

    return path


def standing(x: float, y: float) -> Path:
    """A place that does not change, in meters."""
    return lambda time: (x, y)


def driving(speed: float, swing: float, rate: float) -> Callable[[float], Base]:
    """A robot that drives along x in m/s, and looks to both sides by an angle, with rad/s."""

    def base(time: float) -> Base:
        # A triangle from 0 to the left, to the right and back: constant rates between its corners.
        turn = (rate * time / swing + 1.0) % 4.0 - 1.0 if rate else 0.0
        return Base(speed * time, 0.0, swing * (turn if turn <= 1.0 else 2.0 - turn))

    return base


WALKERS = (
    Walker(circling((5.0, 0.0), 1.3, 9.0, 2.6), (50, 60, 200), (90, 60, 40)),
    Walker(circling((5.6, -0.4), 1.9, 14.0, -1.2), (170, 140, 60), (60, 60, 60), 1.68),
)
PILLAR = Walker(standing(3.4, 0.9), (150, 160, 165), (0, 0, 0), 2.2, is_pillar=True)


@dataclass(frozen=True)
class Room:
    """A room with a robot and walkers; the same frames for the same seed."""

    walkers: Sequence[Walker] = (*WALKERS, PILLAR)  # the people, and pillars
    # time in seconds to the pose of the robot
    base: Callable[[float], Base] = field(
        default_factory=lambda: driving(0.15, 0.2, np.radians(7.0))
    )
    rate: float = 15.0  # frames per second
    holes: float = 0.15  # share of the depth without a measurement
    seed: int = 0  # of textures and noise
    camera: CameraModel = CAMERA  # calibration

    def frames(self, count: int) -> Iterator[RoomFrame]:
        """The first frames."""
        generator = np.random.default_rng(self.seed)
        rays = horizontal_rays(self.camera)
        textures = [fractal_noise(generator, (_TEXTURE, _TEXTURE), 96.0) for _ in ("floor", "wall")]
        for index in range(count):
            time = index / self.rate
            yield self._frame(time, rays, textures, generator)

    def _frame(
        self,
        time: float,
        rays: Array,
        textures: Sequence[NDArray[np.float32]],
        generator: np.random.Generator,
    ) -> RoomFrame:
        base = self.base(time)
        image, depth = _background(rays, base, textures)
        positions = np.array([walker.path(time) for walker in self.walkers])
        owner = np.full(depth.shape, -1)
        boxes, sizes = [], []
        for number, walker in enumerate(self.walkers):
            alone = cylinder(rays, *_seen_from(base, positions[number], walker, time))
            mask = np.isfinite(alone)
            boxes.append(box_around(mask) if mask.any() else None)
            sizes.append(int(mask.sum()))
            shown = alone < depth
            depth[shown] = alone[shown]
            owner[shown] = number
            level = (CAMERA_HEIGHT - depth[shown] * rays[shown][:, 2]) / walker.height
            image[shown] = _colors(walker, level, generator)
        visible = [
            float((owner == number).sum() / size) if size else 0.0
            for number, size in enumerate(sizes)
        ]
        image += generator.normal(0.0, _NOISE, image.shape)
        return RoomFrame(
            time,
            np.clip(image, 0, 255).astype(np.uint8),
            corrupted(depth, self.holes, generator),
            base,
            positions,
            tuple(boxes),
            tuple(visible),
        )


def horizontal_rays(camera: CameraModel) -> Array:
    """(H, W, 3) rays of the pixels: horizontally forward, right, and down; 1 along the axis."""
    down = GroundPlane.from_angles(CAMERA_HEIGHT, CAMERA_PITCH).down
    forward = np.array([0.0, 0.0, 1.0]) - down[2] * down
    forward /= np.linalg.norm(forward)
    axes = np.column_stack([forward, np.cross(down, forward), down])
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = camera.rays(np.column_stack([columns.ravel(), rows.ravel()]))
    return ((rays / rays[:, 2:]) @ axes).reshape(camera.height, camera.width, 3)


def cylinder(rays: Array, distance: float, bearing: float, height: float, turn: float) -> Array:
    """(H, W) depth of a person, infinite beside them.

    The middle is at a horizontal distance in meters and a bearing to the right. The turn is the
    angle between the body's wide side and the image plane, radians.
    """
    # Axes of the ellipse: thickness along the line of sight, turned.
    cosine, sine = np.cos(bearing + turn), np.sin(bearing + turn)
    thick, wide = np.array([cosine, sine]) / _HALF_THICKNESS, np.array([-sine, cosine])
    to_ellipse = np.array([thick, wide / _HALF_WIDTH])
    direction = rays[..., :2] @ to_ellipse.T
    center = to_ellipse @ (distance * np.array([np.cos(bearing), np.sin(bearing)]))
    # |t direction - center|^2 = 1.
    square = np.square(direction).sum(axis=-1)
    half = direction @ center
    discriminant = half**2 - square * (center @ center - 1.0)
    depth = (half - np.sqrt(np.maximum(discriminant, 0.0))) / square
    below = depth * rays[..., 2]
    is_hit = (discriminant > 0.0) & (below < CAMERA_HEIGHT) & (below > CAMERA_HEIGHT - height)
    return np.where(is_hit, depth, np.inf)


def corrupted(depth: Array, holes: float, generator: np.random.Generator) -> NDArray[np.float32]:
    """A depth image with noise, and with a share of holes."""
    noisy = depth + generator.normal(0.0, 1.0, depth.shape) * _DEPTH_NOISE * depth**2
    rows, columns = (side // _HOLE + 1 for side in depth.shape)
    coarse = (generator.random((rows, columns)) < holes).astype(np.uint8)
    large = cv2.resize(coarse, (columns * _HOLE, rows * _HOLE), interpolation=cv2.INTER_NEAREST)
    noisy[large[: depth.shape[0], : depth.shape[1]] > 0] = np.nan
    return noisy.astype(np.float32)


def box_around(mask: NDArray[np.bool_]) -> tuple[float, float, float, float]:
    """The smallest box around a mask with pixels."""
    x, y, width, height = cv2.boundingRect(mask.astype(np.uint8))
    return float(x), float(y), float(width), float(height)


def _seen_from(
    base: Base, position: Array, walker: Walker, time: float
) -> tuple[float, float, float, float]:
    """Distance, bearing to the right, height and turn of a walker before the camera."""
    x, y = position - (base.x, base.y)
    bearing = base.yaw - np.arctan2(y, x)
    # People look where they go.
    ahead = np.subtract(walker.path(time + 0.1), position)
    heading = base.yaw - np.arctan2(ahead[1], ahead[0]) if ahead.any() else bearing
    return float(np.hypot(x, y)), float(bearing), walker.height, float(heading - bearing)


def _background(
    rays: Array, base: Base, textures: Sequence[NDArray[np.float32]]
) -> tuple[Array, Array]:
    """(H, W, 3) colors and (H, W) depth of floor and wall."""
    cosine, sine = np.cos(base.yaw), np.sin(base.yaw)
    forward, right = rays[..., 0], rays[..., 1]
    along_x = cosine * forward + sine * right
    along_y = sine * forward - cosine * right
    # |base + depth * ray| is the radius: the positive root.
    square = along_x**2 + along_y**2
    half = along_x * base.x + along_y * base.y
    inside = _RADIUS**2 - base.x**2 - base.y**2
    wall = (-half + np.sqrt(half**2 + square * inside)) / square
    with np.errstate(divide="ignore"):
        floor = np.where(rays[..., 2] > 0.0, CAMERA_HEIGHT / rays[..., 2], np.inf)
    depth = np.minimum(wall, floor)
    x, y = base.x + depth * along_x, base.y + depth * along_y
    height = CAMERA_HEIGHT - depth * rays[..., 2]
    is_wall = wall < floor
    across = np.where(is_wall, _RADIUS * np.arctan2(y, x), x)
    upward = np.where(is_wall, height, y)
    maps = [_folded(_SCALE * one) for one in (across, upward)]
    shades = [
        cv2.remap(one, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT) for one in textures
    ]
    colors = np.where(
        is_wall[..., None],
        np.array([150.0, 165.0, 170.0]) * (0.5 + 0.6 * shades[1][..., None]),
        np.array([95.0, 105.0, 115.0]) * (0.4 + 0.8 * shades[0][..., None]),
    )
    return colors, depth


def _folded(coordinates: Array) -> NDArray[np.float32]:
    """Coordinates in a texture that is mirrored at its edges, and so has no seams."""
    last = _TEXTURE - 1
    return (last - np.abs(np.mod(coordinates, 2 * last) - last)).astype(np.float32)


def _colors(walker: Walker, level: Array, generator: np.random.Generator) -> Array:
    """(N, 3) colors of a walker's pixels at N shares of the height."""
    shirt = np.array(walker.shirt, dtype=float)
    if walker.is_pillar:
        return shirt * (0.8 + 0.2 * np.cos(40.0 * level))[:, None]
    # Stripes of a shirt.
    striped = shirt * np.where(np.sin(90.0 * level) > 0.6, 0.55, 1.0)[:, None]
    colors = np.where((level < _WAIST)[:, None], np.array(walker.trousers, dtype=float), striped)
    return np.where((level > _NECK)[:, None], np.array(_SKIN, dtype=float), colors)
