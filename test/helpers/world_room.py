"""A drawn room with exact truth: a robot that drives and turns, and people who walk.

`benchmarks/follow_parts/rendering.py` draws it. The robot starts at the origin of the fixed frame
(x forward at the start, y left). Each frame has a color image, depth with holes and noise, and
where everybody is and is seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from follow_parts.layout import Layout, walls_of
from follow_parts.people import Body, Clothes, Color, Sprites
from follow_parts.rendering import CAMERA_PITCH, CameraState, Placed, Renderer
from follow_parts.robot import Pose2D
from numpy.typing import NDArray

Array = NDArray[np.float64]
Path = Callable[[float], tuple[float, float]]

# Of the square room, meters, and where the robot starts in it.
_SIDE, _START = 18.0, np.array([6.0, 9.0])
# Seconds in which the gait repeats.
_GAIT = 1.1


@dataclass(frozen=True)
class Walker:
    """A person."""

    path: Path  # time in seconds to (x, y), meters
    shirt: Color
    trousers: Color
    height: float = 1.75  # meters


@dataclass(frozen=True, eq=False)
class RoomFrame:
    """A frame of a room."""

    time: float  # seconds since the first frame
    image: NDArray[np.uint8]  # (H, W, 3) BGR
    depth: NDArray[np.uint16]  # in millimeters, 0 in holes
    base: Pose2D  # of the robot
    positions: Array  # (walkers, 2) in the fixed frame, meters
    # (x, y, width, height) of each walker as if nobody stood before it, or None out of sight
    boxes: tuple[tuple[float, float, float, float] | None, ...]
    visible: tuple[float, ...]  # share of each walker's pixels that is not hidden


def circling(center: tuple[float, float], radius: float, period: float, phase: float) -> Path:
    """A walk around a center, in meters, seconds and radians."""

    def path(time: float) -> tuple[float, float]:
        angle = phase + 2.0 * math.pi * time / period
        return center[0] + radius * math.cos(angle), center[1] + radius * math.sin(angle)

    return path


def standing(x: float, y: float) -> Path:
    """A place that does not change, in meters."""
    return lambda time: (x, y)


def driving(speed: float, swing: float, rate: float) -> Callable[[float], Pose2D]:
    """A robot that drives along x in m/s, and looks to both sides by an angle, with rad/s."""

    def base(time: float) -> Pose2D:
        # A triangle from 0 to the left, to the right and back: constant rates between its corners.
        turn = (rate * time / swing + 1.0) % 4.0 - 1.0 if rate else 0.0
        return Pose2D(speed * time, 0.0, swing * (turn if turn <= 1.0 else 2.0 - turn))

    return base


@dataclass(frozen=True)
class Room:
    """A room with a robot and walkers; the same frames for the same seed."""

    walkers: Sequence[Walker]
    base: Callable[[float], Pose2D]  # time in seconds to the pose of the robot
    rate: float = 15.0  # frames per second
    seed: int = 0  # of textures and noise

    def frames(self, count: int) -> Iterator[RoomFrame]:
        """The first frames."""
        generator = np.random.default_rng(self.seed)
        corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * _SIDE
        renderer = Renderer(Layout(corners, *walls_of([corners]), ()), generator, self.seed)
        looks = [_looks(walker, generator) for walker in self.walkers]
        for index in range(count):
            time = index / self.rate
            base = self.base(time)
            x, y = (_START + base.position).tolist()
            camera = CameraState(x, y, base.yaw, CAMERA_PITCH, 0.0)
            people = [_placed(*one, time) for one in zip(self.walkers, looks, strict=True)]
            view = renderer.render(camera, people, 1.0)
            yield RoomFrame(
                time,
                view.image.copy(),
                view.depth.copy(),
                base,
                np.array([walker.path(time) for walker in self.walkers]),
                tuple(one.box if one.in_view > 0.0 else None for one in view.people),
                tuple(one.visible for one in view.people),
            )


def _looks(walker: Walker, generator: np.random.Generator) -> Sprites:
    body = replace(Body.draw(generator), height=walker.height)
    clothes = replace(Clothes.draw(generator), shirt=walker.shirt, trousers=walker.trousers)
    return Sprites(body, replace(clothes, has_backpack=False), 0)


def _placed(walker: Walker, sprites: Sprites, time: float) -> Placed:
    """Somebody at a time; people look where they go."""
    x, y = walker.path(time)
    ahead = np.subtract(walker.path(time + 0.1), (x, y))
    heading = math.atan2(ahead[1], ahead[0]) if ahead.any() else math.pi
    place = _START + (x, y)
    is_walking = bool(ahead.any())
    return Placed(sprites, *place.tolist(), heading, time / _GAIT % 1.0, is_walking)
