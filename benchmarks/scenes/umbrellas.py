"""Two umbrellas of similar color and different texture that pass each other in a street.

The scene of the second sequence in Li, Zhang, Li 2007: the target goes from left to right, another
umbrella from right to left; trees hide them in part, the background is cluttered, the camera is
held by hand. Images are 768 x 576 at 25 frames per second, the target's region 40 x 40 pixels, and
the umbrellas meet near frame 96.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from scenes.camera import HandheldCamera
from scenes.scene import Scene
from scenes.sprites import Color
from scenes.stage import Actor, Stage
from scenes.street import Street
from scenes.textures import smooth_path
from scenes.trees import Tree, plant
from scenes.walkers import GAIT_VIEWS, PATTERNS, Canopy, Person, gait_views

WIDTH, HEIGHT, FRAMES = 768, 576, 180
REGION = 40.0
"""Width and height of the ground truth boxes in pixels."""

_MARGIN = 16
_STAGE_SIZE = (WIDTH + 2 * _MARGIN, HEIGHT + 2 * _MARGIN)
_HOUSE_LINE = 372
_CURB = 446
_PERSON_HEIGHT = 72.0
# From the feet up to the middle of the canopy.
_CANOPY_ABOVE_FEET = 82.0
_ROLLS = np.linspace(-9.0, 9.0, 13)


class UmbrellaScene(Scene):
    """A rendered sequence of two crossing umbrellas with exact ground truth.

    Every seed gives other paths, colors, textures, houses, trees, shake and noise; the same seed
    gives the same bits. Trees and street are drawn once, when the scene is made.

    Args:
        seed: Seed of everything random, at least 0.

    Attributes:
        other_boxes: (frames, 4) x, y, width, height of the other umbrella's region.
    """

    def __init__(self, seed: int = 0) -> None:
        ways, looks, houses, garden, sensor = np.random.default_rng(seed).spawn(5)
        paths = _crossing(ways)
        palette = _palette(looks)
        target, other, people = _cast(looks, paths, palette)
        backdrop = _street(houses, palette)
        foreground = plant(garden, _STAGE_SIZE, _trees(garden, paths))
        camera = HandheldCamera(
            sensor,
            size=(WIDTH, HEIGHT),
            margin=_MARGIN,
            frames=FRAMES,
            shake=2.0,
            lighting=0.03,
            noise=2.5,
        )
        # A pixel's index is its center; boxes count from the corner of the first pixel.
        boxes, self.other_boxes = (
            np.hstack([centers - REGION / 2, np.full_like(centers, REGION)])
            for centers in (one.positions - camera.offsets + 0.5 for one in (target, other))
        )
        stage = Stage(backdrop, people, foreground)
        super().__init__(f"umbrellas {seed}", stage, camera, boxes)


@dataclass(frozen=True)
class _Walk:
    """Where a walker's feet are, (frames, 2), and which way it goes, 1 for right."""

    feet: NDArray[np.float64]
    direction: int

    @property
    def views(self) -> NDArray[np.int64]:
        """(frames,) views of the gait."""
        return gait_views(self.feet[:, 0], self.direction, _PERSON_HEIGHT)

    @property
    def cycles(self) -> NDArray[np.float64]:
        """(frames,) cycles of two steps walked so far."""
        return np.asarray(self.direction * self.feet[:, 0] / (0.8 * _PERSON_HEIGHT))


@dataclass(frozen=True)
class _Paths:
    target: _Walk
    other: _Walk
    meeting_x: float
    target_is_nearer: bool


def _walk(
    generator: np.random.Generator,
    *,
    direction: int,
    lane: float,
    meeting: tuple[float, float],
    slowing: float,
) -> _Walk:
    """A walk that passes column meeting[1] in frame meeting[0], slower around there."""
    times = np.arange(FRAMES, dtype=float)
    speed = generator.uniform(1.9, 2.4)
    pace = speed * (1.0 - slowing * np.exp(-(((times - meeting[0]) / 14.0) ** 2)))
    pace += 0.08 * speed * smooth_path(generator, FRAMES, period=40.0)[:, 0]
    xs = direction * np.cumsum(pace)
    xs += meeting[1] - np.interp(meeting[0], times, xs)
    ys = lane + 1.5 * smooth_path(generator, FRAMES, period=80.0)[:, 0]
    return _Walk(np.stack([xs, ys], axis=1), direction)


def _crossing(generator: np.random.Generator) -> _Paths:
    meeting = (generator.uniform(92.0, 100.0), _STAGE_SIZE[0] / 2 + generator.uniform(-30.0, 30.0))
    slowing = generator.uniform(0.1, 0.4)
    far_lane = _HOUSE_LINE + generator.uniform(20.0, 26.0)
    near_lane = far_lane + generator.uniform(15.0, 22.0)
    target_is_nearer = bool(generator.random() < 0.3)
    lanes = (near_lane, far_lane) if target_is_nearer else (far_lane, near_lane)
    target = _walk(generator, direction=1, lane=lanes[0], meeting=meeting, slowing=slowing)
    other = _walk(generator, direction=-1, lane=lanes[1], meeting=meeting, slowing=slowing)
    return _Paths(target, other, meeting[1], target_is_nearer)


def _palette(generator: np.random.Generator) -> tuple[Color, Color]:
    """The two colors of both umbrellas: one hue, strong and pale."""
    hue = generator.uniform(0.0, 360.0)
    strong = (hue, generator.uniform(0.6, 0.85), generator.uniform(0.5, 0.7))
    pale = (hue, generator.uniform(0.2, 0.35), generator.uniform(0.8, 0.9))
    pixels = cv2.cvtColor(np.array([[strong, pale]], np.float32), cv2.COLOR_HSV2BGR)[0] * 255.0
    first, second = ((float(blue), float(green), float(red)) for blue, green, red in pixels)
    return first, second


def _cast(
    generator: np.random.Generator, paths: _Paths, palette: tuple[Color, Color]
) -> tuple[Actor, Actor, tuple[Actor, ...]]:
    """The target's canopy, the other's, and all actors from the farthest to the nearest."""
    passers_by: list[Actor] = []
    for direction in (1, -1):
        when = (generator.uniform(0.2, 0.8) * FRAMES, generator.uniform(0.2, 0.8) * _STAGE_SIZE[0])
        lane = _HOUSE_LINE + generator.uniform(8.0, 16.0)
        walk = _walk(generator, direction=direction, lane=lane, meeting=when, slowing=0.0)
        passers_by.append(_person(generator, walk))
    first, second = generator.choice(len(PATTERNS), 2, replace=False)
    elevation = generator.uniform(56.0, 64.0)
    umbrellas = []
    for walk, pattern in ((paths.target, PATTERNS[first]), (paths.other, PATTERNS[second])):
        canopy = Canopy(pattern, palette, elevation=elevation)
        umbrellas.append((_person(generator, walk), _umbrella(generator, walk, canopy)))
    target, other = umbrellas
    far, near = (other, target) if paths.target_is_nearer else (target, other)
    return target[1], other[1], (*passers_by, *far, *near)


def _person(generator: np.random.Generator, walk: _Walk) -> Actor:
    coat, trousers = generator.uniform(25.0, 190.0, 3), np.full(3, generator.uniform(30.0, 110.0))
    trousers += generator.uniform(-15.0, 15.0, 3)
    person = Person(_PERSON_HEIGHT, _color(coat), _color(trousers), walk.direction)
    sprites = tuple(person.sprite(view) for view in range(GAIT_VIEWS))
    return Actor(sprites, walk.views, walk.feet + _bob(walk))


def _umbrella(generator: np.random.Generator, walk: _Walk, canopy: Canopy) -> Actor:
    sprites = tuple(canopy.sprite(roll) for roll in _ROLLS)
    rolls = 2.5 * walk.direction + 2.0 * smooth_path(generator, FRAMES, period=30.0)[:, 0]
    views = np.abs(rolls[:, None] - _ROLLS).argmin(axis=1)
    hand = np.array([3.0 * walk.direction, -_CANOPY_ABOVE_FEET])
    sway = 0.5 * smooth_path(generator, FRAMES, period=16.0, columns=2)
    return Actor(sprites, views, walk.feet + hand + sway + _bob(walk))


def _bob(walk: _Walk) -> NDArray[np.float64]:
    rise = 1.2 * np.cos(4.0 * np.pi * walk.cycles)
    return np.stack([np.zeros_like(rise), rise], axis=1)


def _street(generator: np.random.Generator, palette: tuple[Color, Color]) -> NDArray[np.uint8]:
    # Muted colors, as paint and cloth in a street have.
    accents = [
        _color(0.6 * generator.uniform(20.0, 220.0, 3) + 0.4 * generator.uniform(60.0, 200.0))
        for _ in range(5)
    ]
    street = Street(_STAGE_SIZE, _HOUSE_LINE - 118, _HOUSE_LINE, _CURB, (*accents, *palette))
    return street.draw(generator)


def _trees(generator: np.random.Generator, paths: _Paths) -> tuple[Tree, ...]:
    """A slender tree before the umbrellas meet, a larger one right after, another one later."""
    columns = paths.target.feet[:, 0]
    canopies = float(paths.target.feet[:, 1].mean()) - _CANOPY_ABOVE_FEET
    # Where it stands, how wide its trunk is, how far above the canopies' middle its twigs end. The
    # target is in clear view where it starts, for it is picked there.
    trees = (
        (columns[generator.integers(44, 57)], (8.0, 11.0), (14.0, 24.0)),
        (paths.meeting_x + generator.uniform(20.0, 55.0), (10.0, 15.0), (-4.0, 14.0)),
        (columns[generator.integers(136, 149)], (10.0, 15.0), (-4.0, 14.0)),
    )
    return tuple(
        Tree(
            x=float(place),
            ground=_CURB - generator.uniform(4.0, 16.0),
            height=generator.uniform(270.0, 300.0),
            trunk=generator.uniform(*trunk),
            crown=generator.uniform(65.0, 85.0),
            hanging=canopies - generator.uniform(*clearance),
        )
        for place, trunk, clearance in trees
    )


def _color(values: NDArray[np.float64]) -> Color:
    blue, green, red = np.clip(values, 0.0, 255.0)
    return (float(blue), float(green), float(red))
