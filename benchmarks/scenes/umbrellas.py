"""Two umbrellas of similar color and different texture that pass each other in a street.

The scene of the second sequence in Li, Zhang, Li 2007: the target goes from left to right, another
umbrella from right to left; trees hide them in part, the background is cluttered, the camera is
held by hand. Images are 768 x 576 at 25 frames per second, the target's region 40 x 40 pixels, and
the umbrellas meet near frame 96.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.parameters import build, declared
from scenes.camera import HandheldCamera
from scenes.sprites import Color
from scenes.stage import Actor, Stage
from scenes.street import Street
from scenes.textures import smooth_path
from scenes.trees import Tree, plant
from scenes.walkers import GAIT_VIEWS, PATTERNS, Canopy, Person

WIDTH, HEIGHT = 768, 576
FRAME_INTERVAL = 0.04
"""Seconds between frames."""
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


@dataclass(frozen=True)
class UmbrellaSettings:
    """What can be changed about the umbrella scene."""

    frames: int = declared(
        180, "Number of frames; the umbrellas meet near frame 96.", minimum=150, maximum=210
    )
    shake: float = declared(2.0, "Sway of the camera, std in px.", minimum=0.0, maximum=5.0)
    lighting: float = declared(0.03, "Drift of the brightness, std.", minimum=0.0, maximum=0.2)
    noise: float = declared(2.5, "Noise, std in gray levels.", minimum=0.0, maximum=30.0)


class UmbrellaScene:
    """A rendered sequence of two crossing umbrellas with exact ground truth.

    Every seed gives other paths, colors, textures, houses, trees, shake and noise; the same seed
    gives the same bits. Trees and street are drawn once, when the scene is made.

    Args:
        seed: Seed of everything random, at least 0.
        settings: Names of `UmbrellaSettings` and values over the defaults.

    Raises:
        ValueError: The seed is negative, or a setting does not exist or is out of its range.
    """

    def __init__(self, seed: int = 0, settings: Mapping[str, Any] | None = None):
        if seed < 0:
            raise ValueError(f"the seed is {seed}; allowed: 0 or more")
        self.settings = build(UmbrellaSettings, settings or {})
        self.seed = seed
        # Each part has randomness of its own: a setting of one part leaves the others as they are.
        sources = np.random.default_rng(seed).spawn(5)
        frames = self.settings.frames
        paths = _crossing(sources[0], frames)
        palette = _palette(sources[1])
        self.target, self.other, people = _cast(sources[1], paths, palette)
        backdrop = _street(sources[2], palette)
        foreground = plant(sources[3], _STAGE_SIZE, _trees(sources[3], paths))
        self.stage = Stage(backdrop, people, foreground)
        self.camera = HandheldCamera(
            sources[4],
            size=(WIDTH, HEIGHT),
            margin=_MARGIN,
            frames=frames,
            shake=self.settings.shake,
            lighting=self.settings.lighting,
            noise=self.settings.noise,
        )

    def __len__(self) -> int:
        return self.settings.frames

    @cached_property
    def target_boxes(self) -> NDArray[np.float64]:
        """(frames, 4): x, y, width, height of the target's region, centered on its canopy."""
        return self._boxes(self.target)

    @cached_property
    def other_boxes(self) -> NDArray[np.float64]:
        """(frames, 4): x, y, width, height of the other umbrella's region."""
        return self._boxes(self.other)

    @cached_property
    def visibility(self) -> NDArray[np.float64]:
        """(frames, 2): share of the target's canopy and of the other's that is seen, 0 to 1."""
        shares = [self.stage.visible_shares(actor) for actor in (self.target, self.other)]
        return np.stack(shares, axis=1)

    @property
    def meeting_frame(self) -> int:
        """The frame, counted from 0, in which the umbrellas are nearest to each other."""
        offsets = self.target_boxes[:, :2] - self.other_boxes[:, :2]
        return int(np.argmin(np.hypot(offsets[:, 0], offsets[:, 1])))

    def render(self, index: int) -> NDArray[np.uint8]:
        """Frame `index`, counted from 0: (576, 768, 3) uint8, blue, green, red."""
        return self.camera.shoot(self.stage.paint(index), index)

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """All frames; each call starts from the first."""
        return (self.render(index) for index in range(len(self)))

    def _boxes(self, umbrella: Actor) -> NDArray[np.float64]:
        # A pixel's index is its center; boxes count from the corner of the first pixel.
        centers = umbrella.positions - self.camera.offsets + 0.5
        return np.hstack([centers - REGION / 2, np.full_like(centers, REGION)])


@dataclass(frozen=True)
class _Walk:
    """Where a walker's feet are, (frames, 2), and which way it goes, 1 for right."""

    feet: NDArray[np.float64]
    direction: int

    @property
    def views(self) -> NDArray[np.int64]:
        """(frames,) views of the gait: two steps take it the length of its cycle."""
        return np.floor(self.cycles * GAIT_VIEWS).astype(np.int64) % GAIT_VIEWS

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
    frames: int,
    *,
    direction: int,
    lane: float,
    meeting: tuple[float, float],
    slowing: float,
) -> _Walk:
    """A walk that passes column meeting[1] in frame meeting[0], slower around there."""
    times = np.arange(frames, dtype=float)
    speed = generator.uniform(1.9, 2.4)
    pace = speed * (1.0 - slowing * np.exp(-(((times - meeting[0]) / 14.0) ** 2)))
    pace += 0.08 * speed * smooth_path(generator, frames, period=40.0)[:, 0]
    xs = direction * np.cumsum(pace)
    xs += meeting[1] - np.interp(meeting[0], times, xs)
    ys = lane + 1.5 * smooth_path(generator, frames, period=80.0)[:, 0]
    return _Walk(np.stack([xs, ys], axis=1), direction)


def _crossing(generator: np.random.Generator, frames: int) -> _Paths:
    meeting = (generator.uniform(92.0, 100.0), _STAGE_SIZE[0] / 2 + generator.uniform(-30.0, 30.0))
    slowing = generator.uniform(0.1, 0.4)
    far_lane = _HOUSE_LINE + generator.uniform(20.0, 26.0)
    near_lane = far_lane + generator.uniform(15.0, 22.0)
    target_is_nearer = bool(generator.random() < 0.3)
    lanes = (near_lane, far_lane) if target_is_nearer else (far_lane, near_lane)
    target = _walk(generator, frames, direction=1, lane=lanes[0], meeting=meeting, slowing=slowing)
    other = _walk(generator, frames, direction=-1, lane=lanes[1], meeting=meeting, slowing=slowing)
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
    frames = len(paths.target.feet)
    passers_by: list[Actor] = []
    for direction in (1, -1):
        when = (generator.uniform(0.2, 0.8) * frames, generator.uniform(0.2, 0.8) * _STAGE_SIZE[0])
        lane = _HOUSE_LINE + generator.uniform(8.0, 16.0)
        walk = _walk(generator, frames, direction=direction, lane=lane, meeting=when, slowing=0.0)
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
    frames = len(walk.feet)
    sprites = tuple(canopy.sprite(roll) for roll in _ROLLS)
    rolls = 2.5 * walk.direction + 2.0 * smooth_path(generator, frames, period=30.0)[:, 0]
    views = np.abs(rolls[:, None] - _ROLLS).argmin(axis=1)
    hand = np.array([3.0 * walk.direction, -_CANOPY_ABOVE_FEET])
    sway = 0.5 * smooth_path(generator, frames, period=16.0, columns=2)
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
