"""Two umbrellas of similar color and different texture that pass each other in a street.

The scene of the second sequence in Li, Zhang, Li 2007: the target goes from left to right, another
umbrella from right to left; trees hide them in part, the background is cluttered, the camera is
held by hand. Images are 768 x 576 at 25 frames per second, the target's region 40 x 40 pixels, and
the umbrellas meet near frame 96.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenes.camera import HandheldCamera
from scenes.scene import Scene
from scenes.sprites import Color, from_hsv
from scenes.stage import Actor, Stage
from scenes.street import Street
from scenes.textures import smooth_path
from scenes.trees import Tree, plant
from scenes.walkers import PATTERNS, Canopy, Person

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
    gives the same bits. Trees and street are drawn once, when the scene is made. `other_boxes` are
    the (frames, 4) regions of the other umbrella.
    """

    def __init__(self, seed: int = 0) -> None:
        ways, looks, houses, garden, sensor = np.random.default_rng(seed).spawn(5)
        paths = _crossing(ways)
        hue = looks.uniform(0.0, 360.0)
        # One hue, strong and pale.
        palette = (
            from_hsv(hue, looks.uniform(0.6, 0.85), looks.uniform(0.5, 0.7)),
            from_hsv(hue, looks.uniform(0.2, 0.35), looks.uniform(0.8, 0.9)),
        )
        first, second = looks.choice(len(PATTERNS), 2, replace=False)
        carrier, target = _with_umbrella(looks, paths.target, 1, Canopy(PATTERNS[first], palette))
        stranger, other = _with_umbrella(looks, paths.other, -1, Canopy(PATTERNS[second], palette))
        people = (stranger, other, carrier, target)
        people = people if paths.target_is_nearer else people[2:] + people[:2]
        accents = (*(_muted(houses) for _ in range(5)), *palette)
        street = Street(_STAGE_SIZE, _HOUSE_LINE - 118, _HOUSE_LINE, _CURB, accents)
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
        stage = Stage(street.draw(houses), people, foreground)
        super().__init__(f"umbrellas {seed}", stage, camera, boxes)


class _Paths(NamedTuple):
    """Where the feet are, (frames, 2), and where they meet."""

    target: NDArray[np.float64]
    other: NDArray[np.float64]
    meeting_x: float
    target_is_nearer: bool


def _crossing(generator: np.random.Generator) -> _Paths:
    frame, column = generator.uniform((92.0, -30.0), (100.0, 30.0)) + (0.0, _STAGE_SIZE[0] / 2)
    slowing = generator.uniform(0.1, 0.4)
    far_lane = _HOUSE_LINE + generator.uniform(20.0, 26.0)
    near_lane = far_lane + generator.uniform(15.0, 22.0)

    def walk(direction: int, lane: float) -> NDArray[np.float64]:
        """A walk that passes the column in the frame, slower around there."""
        times = np.arange(FRAMES, dtype=float)
        speed = generator.uniform(1.9, 2.4)
        pace = speed * (1.0 - slowing * np.exp(-(((times - frame) / 14.0) ** 2)))
        pace += 0.08 * speed * smooth_path(generator, FRAMES, period=40.0)[:, 0]
        xs = direction * np.cumsum(pace)
        xs += column - np.interp(frame, times, xs)
        ys = lane + 1.5 * smooth_path(generator, FRAMES, period=80.0)[:, 0]
        return np.stack([xs, ys + 1.2 * np.cos(4.0 * np.pi * xs / (0.8 * _PERSON_HEIGHT))], axis=1)

    is_nearer = bool(generator.random() < 0.3)
    lanes = (near_lane, far_lane) if is_nearer else (far_lane, near_lane)
    return _Paths(walk(1, lanes[0]), walk(-1, lanes[1]), column, is_nearer)


def _with_umbrella(
    generator: np.random.Generator, feet: NDArray[np.float64], direction: int, canopy: Canopy
) -> tuple[Actor, Actor]:
    """A person and their umbrella."""
    person = Person(_PERSON_HEIGHT, _muted(generator), _muted(generator), direction)
    rolls = 2.5 * direction + 2.0 * smooth_path(generator, FRAMES, period=30.0)[:, 0]
    views = np.abs(rolls[:, None] - _ROLLS).argmin(axis=1)
    hand = np.array([3.0 * direction, -_CANOPY_ABOVE_FEET])
    sway = 0.5 * smooth_path(generator, FRAMES, period=16.0, columns=2)
    sprites = tuple(canopy.sprite(roll) for roll in _ROLLS)
    return person.walking(feet), Actor(sprites, views, feet + hand + sway)


def _muted(generator: np.random.Generator) -> Color:
    return from_hsv(*generator.uniform((0.0, 0.0, 0.2), (360.0, 0.4, 0.7)).tolist())


def _trees(generator: np.random.Generator, paths: _Paths) -> tuple[Tree, ...]:
    """A slender tree before the umbrellas meet, a larger one right after, another one later."""
    columns = paths.target[:, 0]
    canopies = float(paths.target[:, 1].mean()) - _CANOPY_ABOVE_FEET
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
