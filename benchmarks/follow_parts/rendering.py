"""Images and depth of a room with people, as a camera on a robot takes them.

1. Rays in the plane of the floor find which part of which wall each column shows. As all walls
   reach the ceiling, these parts do not cover each other.
2. Floor, ceiling and each part of a wall are textures, mapped by a homography.
3. People are sprites, upright on the floor at one depth, drawn from far to near.
4. Light, motion blur and noise follow. Depth has half the resolution, noise and holes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scenes.textures import fractal_noise

from follow_parts.layout import Layout, crossings
from follow_parts.people import SCALE, Sprites
from pf_tracker_ros.boxes import Box
from pf_tracker_ros.localization.camera_pose import mounted_pose
from pf_tracker_ros.localization.rigid_pose import RigidPose
from pf_tracker_ros.world import CameraModel, GroundPlane

Array = NDArray[np.float64]

CAMERA = CameraModel(460.0, 460.0, 319.5, 239.5, 640, 480)
CAMERA_HEIGHT, CAMERA_PITCH = 0.8, 0.03
CEILING = 2.6
_SIZE = CAMERA.width, CAMERA.height
# Depth has one pixel for so many of the image.
REDUCTION = 2
# Pixels in a meter of the textures of walls, floor and ceiling.
_WALL_SCALE, _FLOOR_SCALE = 90.0, 60.0
_FLOOR_SIDE = 1024
# Rays: one for so many columns, and so many columns beyond the image.
_RAY_STEP, _BEYOND = 2, 24
# Nearest depth of a person that is drawn, and depths that the sensor measures, meters.
_NEAREST, _DEPTHS = 0.25, (0.3, 8.0)
# Distance from which sprites have half the resolution, meters.
_FAR = 5.0
# Exposure time, seconds; noise of the image, levels; relative noise and holes of the depth.
_EXPOSURE, _NOISE, _DEPTH_NOISE, _HOLES = 0.012, 2.5, 0.01, 0.1
_NOISE_FIELDS = 5


@dataclass(frozen=True)
class Placed:
    """Somebody at a moment."""

    sprites: Sprites  # what they look like
    x: float  # meters
    y: float  # meters
    heading: float  # radians
    phase: float  # of the gait, 0 to 1
    is_walking: bool  # whether they walk


@dataclass(frozen=True)
class CameraState:
    """Where the camera is."""

    x: float  # meters
    y: float  # meters
    yaw: float  # of the robot, radians
    pitch: float  # radians, positive looks down
    roll: float  # radians, positive lowers the right side
    yaw_rate: float = 0.0  # radians per second


class Seen(NamedTuple):
    """How a person is seen."""

    # x, y, width, height as if nothing were in front, also outside of the image; None behind the
    # camera
    box: Box | None
    visible: float  # share of the person inside the image that nothing hides
    in_view: float  # share of the box inside the image

    @property
    def box_in_image(self) -> Box | None:
        """The part of the box inside the image; None outside."""
        if self.box is None:
            return None
        x, y, width, height = self.box
        x0, y0 = max(x, 0.0), max(y, 0.0)
        x1, y1 = min(x + width, float(CAMERA.width)), min(y + height, float(CAMERA.height))
        return (x0, y0, x1 - x0, y1 - y0) if x1 - x0 > 1.0 and y1 - y0 > 1.0 else None

    @property
    def shown(self) -> float:
        """Share that is seen; half of the box in the image is enough for all of it."""
        return self.visible * min(1.0, 2.0 * self.in_view)


@dataclass(frozen=True, eq=False)
class View:
    """What a camera sees."""

    image: NDArray[np.uint8]  # (480, 640, 3) uint8 BGR
    depth: NDArray[np.uint16]  # (240, 320) uint16 in millimeters, 0 in holes
    people: tuple[Seen, ...]  # everybody, in the given order


class Renderer:
    """Renders one room."""

    def __init__(self, layout: Layout, generator: np.random.Generator, noise_seed: int) -> None:
        self._layout = layout
        count = int(layout.surfaces.max()) + 1
        self._walls = [_wall_texture(generator) for _ in range(count)]
        self._offsets = generator.uniform(0.0, 4.0, len(layout.walls))
        self._floor = _floor_texture(generator)
        ceiling = generator.uniform(170.0, 225.0) * np.array([0.95, 1.0, 1.0])
        self._blank = np.full((CAMERA.height, CAMERA.width, 3), ceiling.astype(np.uint8))
        noise = np.random.default_rng(noise_seed)
        self._noise_generator = noise
        shape = (CAMERA.height + 64, CAMERA.width + 64, 3)
        self._noise = [
            noise.normal(0.0, _NOISE, shape).round().astype(np.int16) for _ in range(_NOISE_FIELDS)
        ]
        rows, columns = CAMERA.height // REDUCTION, CAMERA.width // REDUCTION
        self._depth_factors = [
            noise.normal(1.0, _DEPTH_NOISE, (rows, columns)).astype(np.float32)
            for _ in range(_NOISE_FIELDS)
        ]
        self._holes = [_holes(noise, (rows, columns)) for _ in range(_NOISE_FIELDS)]
        middle = (REDUCTION - 1) / 2.0
        across, down = (np.arange(count) * REDUCTION + middle for count in (columns, rows))
        self._across = ((across - CAMERA.cx) / CAMERA.fx).astype(np.float32)
        self._down = ((down - CAMERA.cy) / CAMERA.fy).astype(np.float32)
        # The renderer's own arrays, filled in each frame.
        self._inverse = np.empty((rows, columns), np.float32)
        self._owner = np.empty((rows, columns), np.int8)

    def render(self, camera: CameraState, people: Sequence[Placed], light: float) -> View:
        """What the camera sees; the light is a brightness, 1 for the mean."""
        pose = camera_pose(camera)
        image = self._blank.copy()
        self._draw_floor(image, pose)
        self._draw_walls(image, pose, camera)
        walls = self._inverse.copy()
        seen = self._draw_people(image, pose, people, walls)
        image = cv2.convertScaleAbs(image, alpha=light)
        length = round(abs(camera.yaw_rate) * _EXPOSURE * CAMERA.fx)
        if length >= 2:
            image = cv2.blur(image, (length, 1))
        return View(self._noisy(image), self._measured(), tuple(seen))

    # Room

    def _draw_floor(self, image: NDArray[np.uint8], pose: RigidPose) -> None:
        """Draw the floor, and set the inverse depths to its own; walls cover the horizon."""
        axes = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).T
        slope = _floor_slope(pose)
        self._inverse[:] = self._inverse_depth(slope, slice(None), slice(None))
        is_floor = (self._inverse > 0.02).all(axis=1)
        top = int(is_floor.argmax()) * REDUCTION
        cv2.warpPerspective(
            self._floor,
            _moved(0, -top) @ _homography(pose, np.zeros(3), axes, _FLOOR_SCALE),
            (CAMERA.width, CAMERA.height - top),
            image[top:],
            cv2.INTER_LINEAR,
            cv2.BORDER_WRAP,
        )
        slope = -slope * pose.translation[2] / (CEILING - pose.translation[2])
        ceiling = self._inverse_depth(slope, slice(top // REDUCTION), slice(None))
        self._inverse[: top // REDUCTION] = np.maximum(ceiling, 1e-3)

    def _draw_walls(self, image: NDArray[np.uint8], pose: RigidPose, camera: CameraState) -> None:
        columns = np.arange(-_BEYOND, CAMERA.width + _BEYOND + 1, _RAY_STEP)
        across = (columns - CAMERA.cx) / CAMERA.fx
        cosine, sine = math.cos(camera.yaw), math.sin(camera.yaw)
        rays = np.stack([cosine + across * sine, sine - across * cosine], axis=1)
        ranges, numbers = self._layout.ranges((camera.x, camera.y), rays)
        ends = np.flatnonzero(np.diff(numbers)) + 1
        parts = []
        for first, last in zip([0, *ends], [*ends, len(numbers)], strict=True):
            if np.isfinite(ranges[first]):
                parts.append((float(ranges[first:last].max()), int(first), int(last)))
        position = np.array([camera.x, camera.y])
        # From far to near: each part is drawn a ray too wide, and nearer ones cover that.
        for _, first, last in sorted(parts, reverse=True):
            number = int(numbers[first])
            shares = self._shares(
                number, position, rays[[max(first - 1, 0), min(last, len(rays) - 1)]]
            )
            self._draw_wall(image, pose, number, shares)

    def _shares(self, number: int, position: Array, rays: Array) -> tuple[float, float]:
        """The part of a wall between two rays, in meters from its begin."""
        wall = self._layout.walls[number : number + 1]
        length = float(np.linalg.norm(wall[0, 1] - wall[0, 0]))
        ranges, shares = (one[:, 0] for one in crossings(wall, position, rays))
        # A ray beside the wall may meet its line far away, or behind.
        shares = np.where(ranges > 0.0, np.clip(shares, 0.0, 1.0), np.round(shares.clip(0, 1)))
        low, high = sorted(shares.tolist())
        return low * length, high * length

    def _draw_wall(
        self,
        image: NDArray[np.uint8],
        pose: RigidPose,
        number: int,
        part: tuple[float, float],
    ) -> None:
        begin, end = self._layout.walls[number]
        along = (end - begin) / np.linalg.norm(end - begin)
        low, high = part
        origin = np.array([*(begin + low * along), CEILING])
        axes = np.array([[*along, 0.0], [0.0, 0.0, -1.0]]).T
        corners = [(0.0, 0.0), (high - low, 0.0), (high - low, CEILING), (0.0, CEILING)]
        homography = _homography(pose, origin, axes, 1.0)
        projected = homography @ np.array([[x, y, 1.0] for x, y in corners]).T
        if (projected[2] < 0.02).any():
            return
        quad = (projected[:2] / projected[2]).T
        left, top = np.floor(quad.min(axis=0)).astype(int) - 1
        right, bottom = np.ceil(quad.max(axis=0)).astype(int) + 2
        x0, x1 = max(left, 0), min(right, CAMERA.width)
        y0, y1 = max(top, 0), min(bottom, CAMERA.height)
        if x1 <= x0 or y1 <= y0:
            return
        surface = int(self._layout.surfaces[number])
        texture = self._walls[surface]
        first = self._offsets[number] + low
        scaled = _homography(pose, origin, axes, _WALL_SCALE)
        # The texture repeats along the wall: its column 0 is `first` before the part.
        width = texture.shape[1] / _WALL_SCALE
        shift = first % width
        drawn = cv2.warpPerspective(
            texture,
            _moved(-x0, -y0) @ scaled @ _moved(-shift * _WALL_SCALE, 0),
            (int(x1 - x0), int(y1 - y0)),
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_WRAP,
        )
        mask = np.zeros((y1 - y0, x1 - x0), np.uint8)
        fixed = np.rint((quad - (x0, y0)).clip(-8000, 8000) * 16).astype(np.int32)
        cv2.fillConvexPoly(mask, fixed, 255, cv2.LINE_8, 4)
        cv2.copyTo(drawn, mask, image[y0:y1, x0:x1])
        normal = pose.rotation.T @ [-along[1], along[0], 0.0]
        distance = float(normal @ (pose.rotation.T @ (origin - pose.translation)))
        if abs(distance) < 1e-3:
            return
        small = mask[(-y0) % REDUCTION :: REDUCTION, (-x0) % REDUCTION :: REDUCTION] > 0
        row, column = -(-y0 // REDUCTION), -(-x0 // REDUCTION)
        rows = slice(row, row + small.shape[0])
        columns = slice(column, column + small.shape[1])
        inverse = self._inverse_depth(normal / distance, rows, columns)
        np.copyto(self._inverse[rows, columns], inverse, where=small)

    def _inverse_depth(self, slope: Array, rows: slice, columns: slice) -> NDArray[np.float32]:
        """1 / z of a plane with `slope` times a point being 1, in a part of the depth image."""
        x, y, z = slope.astype(np.float32)
        return x * self._across[columns] + (y * self._down[rows] + z)[:, None]

    # People

    def _draw_people(
        self,
        image: NDArray[np.uint8],
        pose: RigidPose,
        people: Sequence[Placed],
        walls: NDArray[np.float32],
    ) -> list[Seen]:
        self._owner[:] = -1
        feet = np.array([[one.x, one.y, 0.0] for one in people])
        inside = (feet - pose.translation) @ pose.rotation
        seen = [Seen(None, 0.0, 0.0)] * len(people)
        sizes = [0] * len(people)
        for index in np.argsort(-inside[:, 2]).tolist():
            if inside[index, 2] > _NEAREST:
                seen[index], sizes[index] = self._draw_person(
                    image, pose, people[index], index, walls
                )
        return [
            one._replace(visible=float(np.count_nonzero(self._owner == index) / size))
            if (size := sizes[index])
            else one
            for index, one in enumerate(seen)
        ]

    def _draw_person(
        self,
        image: NDArray[np.uint8],
        pose: RigidPose,
        person: Placed,
        index: int,
        walls: NDArray[np.float32],
    ) -> tuple[Seen, int]:
        """Draw a person; returns how they are seen, and their pixels of the depth image."""
        foot = pose.rotation.T @ ([person.x, person.y, 0.0] - pose.translation)
        head = foot + pose.rotation.T @ [0.0, 0.0, person.sprites.body.height]
        if head[2] <= _NEAREST:
            return Seen(None, 0.0, 0.0), 0
        below, above = _project(foot), _project(head)
        x, y, _ = pose.translation
        to_camera = math.atan2(y - person.y, x - person.x)
        # Seen from the camera, a heading to the left of the direction to it goes to the right.
        sprite = person.sprites.seen(
            person.heading - to_camera,
            person.phase,
            is_walking=person.is_walking,
            is_far=foot[2] > _FAR,
        )
        scale = SCALE if foot[2] <= _FAR else SCALE / 2.0
        down = (below - above) / (person.sprites.body.height * scale)
        # Columns of the sprite go to the right, rows down.
        axes = np.array([[down[1], down[0]], [-down[0], down[1]]])
        offset = below - axes @ sprite.foot
        x, y, width, height = sprite.box
        corners = np.array([[x, y], [x + width, y], [x, y + height], [x + width, y + height]])
        quad = corners @ axes.T + offset
        (left, top), (right, bottom) = quad.min(axis=0).tolist(), quad.max(axis=0).tolist()
        box = (left, top, right - left, bottom - top)
        x0, x1 = max(int(left) - 3, 0), min(int(right) + 4, CAMERA.width)
        y0, y1 = max(int(top) - 3, 0), min(int(bottom) + 4, CAMERA.height)
        x0, y0 = x0 // REDUCTION * REDUCTION, y0 // REDUCTION * REDUCTION
        shown_width = min(right, CAMERA.width) - max(left, 0.0)
        shown_height = min(bottom, CAMERA.height) - max(top, 0.0)
        if x1 - x0 < 4 or y1 - y0 < 4 or shown_width <= 0.0 or shown_height <= 0.0:
            return Seen(box, 0.0, 0.0), 0
        matrix = np.column_stack([axes, offset - (x0, y0)])
        warped = cv2.warpAffine(sprite.pixels, matrix, (x1 - x0, y1 - y0), flags=cv2.INTER_LINEAR)
        solid = warped[REDUCTION // 2 :: REDUCTION, REDUCTION // 2 :: REDUCTION, 3] > 127
        rows = slice(y0 // REDUCTION, y0 // REDUCTION + solid.shape[0])
        columns = slice(x0 // REDUCTION, x0 // REDUCTION + solid.shape[1])
        inverse = np.float32(1.0 / foot[2])
        covered = walls[rows, columns] > inverse * np.float32(1.0 + 1e-3)
        # The floor is never in front of somebody who stands on it.
        covered &= self._is_wall(pose, rows, columns, walls)
        if (covered & solid).any():
            mask = cv2.resize(
                covered.astype(np.uint8), (x1 - x0, y1 - y0), interpolation=cv2.INTER_NEAREST
            )
            warped[mask > 0] = 0
        shown = solid & ~covered
        self._owner[rows, columns][shown] = index
        self._inverse[rows, columns][shown] = inverse
        _blend(image[y0:y1, x0:x1], warped)
        share = shown_width * shown_height / (box[2] * box[3])
        return Seen(box, 0.0, share), int(np.count_nonzero(solid))

    def _is_wall(
        self, pose: RigidPose, rows: slice, columns: slice, walls: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """Whether what is seen without people is nearer than the floor there."""
        floor = self._inverse_depth(_floor_slope(pose), rows, columns)
        return walls[rows, columns] > floor + np.float32(2e-3)

    # Sensors

    def _noisy(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        generator = self._noise_generator
        field = self._noise[int(generator.integers(_NOISE_FIELDS))]
        y, x = generator.integers(0, 64, 2).tolist()
        noise = field[y : y + CAMERA.height, x : x + CAMERA.width]
        return np.asarray(cv2.add(image, noise, dtype=cv2.CV_8U), np.uint8)

    def _measured(self) -> NDArray[np.uint16]:
        generator = self._noise_generator
        depth = self._depth_factors[int(generator.integers(_NOISE_FIELDS))] / self._inverse
        near, far = _DEPTHS
        depth[(depth < near) | (depth > far)] = 0.0
        holes = self._holes[int(generator.integers(_NOISE_FIELDS))]
        y, x = generator.integers(0, 64, 2).tolist()
        depth[np.roll(holes, (y, x), (0, 1))] = 0.0
        return (1000.0 * depth).astype(np.uint16)


def camera_pose(camera: CameraState) -> RigidPose:
    """Pose of the camera's optical frame in the fixed frame of the room."""
    plane = GroundPlane.from_angles(CAMERA_HEIGHT, camera.pitch, camera.roll)
    cosine, sine = math.cos(camera.yaw), math.sin(camera.yaw)
    base = RigidPose(
        np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]),
        np.array([camera.x, camera.y, 0.0]),
    )
    return base @ mounted_pose(plane)


def _project(point: Array) -> Array:
    """(2,) pixel of a (3,) point in camera coordinates."""
    x, y, z = point
    return np.array([CAMERA.fx * x / z + CAMERA.cx, CAMERA.fy * y / z + CAMERA.cy])


def _floor_slope(pose: RigidPose) -> Array:
    """(3,) of the floor: its product with a point of the floor in camera coordinates is 1."""
    return -(pose.rotation.T @ [0.0, 0.0, 1.0]) / pose.translation[2]


def _moved(x: float, y: float) -> Array:
    """(3, 3) homography that moves by x and y."""
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


def _homography(pose: RigidPose, origin: Array, axes: Array, scale: float) -> Array:
    """(3, 3) homography of a plane's texture to the image.

    Its first pixel is at the (3,) origin, its columns and rows go along the (3, 2) axes; the scale
    is in pixels per meter.
    """
    matrix = np.array([[CAMERA.fx, 0.0, CAMERA.cx], [0.0, CAMERA.fy, CAMERA.cy], [0.0, 0.0, 1.0]])
    columns = np.column_stack([axes / scale, origin - pose.translation])
    return matrix @ pose.rotation.T @ columns


def _blend(image: NDArray[np.uint8], sprite: NDArray[np.uint8]) -> None:
    """Draw premultiplied pixels over a part of an image."""
    left = cv2.cvtColor(255 - sprite[..., 3], cv2.COLOR_GRAY2BGR)
    cv2.multiply(image, left, image, 1.0 / 255.0)
    cv2.add(image, np.ascontiguousarray(sprite[..., :3]), image)


def _wall_texture(generator: np.random.Generator) -> NDArray[np.uint8]:
    """A wall of 12 m that repeats: plaster with a skirting, and pictures, doors and shelves."""
    rows, columns = round(CEILING * _WALL_SCALE), round(12.0 * _WALL_SCALE)
    color = generator.uniform(110.0, 215.0) * generator.uniform(0.85, 1.0, 3)
    half = fractal_noise(generator, (rows, columns // 2), 120.0)
    # Mirrored, so that it repeats without a seam.
    noise = np.hstack([half, half[:, ::-1]])
    texture = color * (0.88 + 0.2 * noise[..., None])
    x = 0.3
    while True:
        width = generator.uniform(0.4, 1.4)
        x += generator.uniform(0.3, 1.8)
        if x + width > 11.7:
            break
        kind = generator.random()
        if kind < 0.3:
            low, high = 0.0, 2.05
            width = min(0.9, columns / _WALL_SCALE - x)
        elif kind < 0.7:
            low = generator.uniform(1.0, 1.5)
            high = low + generator.uniform(0.4, 0.8)
        else:
            low, high = 0.0, generator.uniform(0.7, 1.9)
        _panel(texture, generator, (x, x + width), (low, high))
        x += width
    skirting = round(0.1 * _WALL_SCALE)
    texture[-skirting:] *= 0.6
    # Below and above the wall it goes on: pixels at the edges are mixed with that.
    texture = np.vstack([texture, *[texture[-1:]] * 2, *[texture[:1]] * 2])
    return np.clip(texture, 0, 255).astype(np.uint8)


def _panel(
    texture: Array,
    generator: np.random.Generator,
    across: tuple[float, float],
    upward: tuple[float, float],
) -> None:
    """Draw a door, picture or shelf on a wall; meters along the wall and above the floor."""
    x0, x1 = (round(one * _WALL_SCALE) for one in across)
    y0, y1 = (round((CEILING - one) * _WALL_SCALE) for one in upward[::-1])
    if y1 - y0 < 8 or x1 - x0 < 8:
        return
    color = generator.uniform(35.0, 220.0, 3)
    inner = fractal_noise(generator, (y1 - y0, x1 - x0), 24.0)
    texture[y0:y1, x0:x1] = color * (0.6 + 0.6 * inner[..., None])
    frame = texture[y0:y1, x0:x1]
    frame[:3] = frame[-3:] = frame[:, :3] = frame[:, -3:] = color * 0.4


def _floor_texture(generator: np.random.Generator) -> NDArray[np.uint8]:
    """A floor of about 17 m that repeats: carpet, or tiles."""
    side = _FLOOR_SIDE
    color = generator.uniform(70.0, 150.0) * generator.uniform(0.85, 1.0, 3)
    quarter = fractal_noise(generator, (side // 2, side // 2), 90.0)
    # Mirrored, so that it repeats without a seam.
    half = np.hstack([quarter, quarter[:, ::-1]])
    noise = np.vstack([half, half[::-1]])
    texture = color * (0.8 + 0.35 * noise[..., None])
    if generator.random() < 0.5:
        tile = 32 if generator.random() < 0.5 else 64
        y, x = np.indices((side, side))
        texture *= np.where((x // tile + y // tile) % 2, 1.0, 0.88)[..., None]
        texture[(x % tile < 2) | (y % tile < 2)] *= 0.85
    return np.clip(texture, 0, 255).astype(np.uint8)


def _holes(generator: np.random.Generator, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Holes of a depth image: half of them in blobs, half of them single pixels."""
    blobs = fractal_noise(generator, shape, 24.0)
    return (blobs > np.quantile(blobs, 1.0 - _HOLES / 2.0)) | (
        generator.random(shape) < _HOLES / 2.0
    )
