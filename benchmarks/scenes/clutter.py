"""A pedestrian in a street with an adjustable level of clutter.

Zhang Bo compares trackers as the background's complexity grows, and leaves open how it is measured.
Here it is the level of clutter, 0 to 1: how sharp the street behind the target is, how much of it
is covered by patches of the target's own colors, how much these stand out, and how many people
dressed like the target walk about. All else stays as it is: the target and its way, the light and
the noise. The camera stands still. Images are 640 x 480 at 25 frames per second.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from scenes.camera import HandheldCamera
from scenes.scene import Scene
from scenes.sprites import Color, from_hsv, shaded
from scenes.stage import Actor, Stage
from scenes.street import Street
from scenes.textures import fractal_noise, smooth_path
from scenes.walkers import Person, standing_boxes

WIDTH, HEIGHT = 640, 480
MOST_PATCHES, MOST_DISTRACTORS = 200, 4
"""Numbers of patches, and of people dressed like the target, at level 1."""

_SIZE = (WIDTH, HEIGHT)
_HOUSE_LINE = 290
_CURB = 350
_LANE = 332.0
_PERSON_HEIGHT = 96.0
# Standard deviation of the blur of the street at level 0, px.
_BLUR = 12.0
# Contrast of a patch with what it covers: at a level just above 0, and added up to level 1.
_FAINTEST, _ADDED = 0.1, 0.9
# Color of goods and signs where nobody wears it.
_GRAYS: tuple[Color, ...] = ((150, 152, 155), (110, 112, 115), (185, 188, 190), (75, 78, 80))


class _Patch(NamedTuple):
    """A spot in one of the target's colors; place and size in pixels."""

    x: int
    y: int
    width: int
    height: int
    color: Color
    is_round: bool


class ClutteredStreet(Scene):
    """A rendered sequence of a pedestrian before a street of clutter 0 to 1, with exact truth.

    Every seed gives other ways, colors and houses; the same seed gives the same bits. Of one seed,
    a higher level has all patches and people of a lower one, in the same places.
    """

    def __init__(self, seed: int = 0, clutter: float = 0.5, frames: int = 120) -> None:
        # Each part has randomness of its own: the level of one leaves the others as they are.
        clothes, street, patches, way, crowd, sensor = np.random.default_rng(seed).spawn(6)
        colors = _clothes(clothes)
        backdrop = _street(street, clutter)
        for patch in _patches(patches, colors)[: round(clutter * MOST_PATCHES)]:
            _cover(backdrop, patch, _FAINTEST + _ADDED * clutter)
        target = _walker(way, _target_way(way, frames), 1, colors)
        others = _distractors(crowd, frames, colors)[: round(clutter * MOST_DISTRACTORS)]
        # Farther people have their feet higher in the image.
        people = sorted([*others, target], key=lambda one: one.positions[0, 1])
        camera = HandheldCamera(
            sensor, size=_SIZE, margin=1, frames=frames, shake=0.0, lighting=0.01, noise=3.0
        )
        boxes = standing_boxes(target.positions - camera.offsets, _PERSON_HEIGHT)
        name = f"street {seed}, clutter {clutter:.2f}"
        super().__init__(name, Stage(backdrop, tuple(people)), camera, boxes)


def _street(generator: np.random.Generator, level: float) -> NDArray[np.uint8]:
    """A street that is a blur at level 0 and sharp at level 1."""
    sharp = Street(_SIZE, _HOUSE_LINE - 118, _HOUSE_LINE, _CURB, _GRAYS).draw(generator)
    blurred = cv2.GaussianBlur(sharp, (0, 0), _BLUR)
    return np.asarray(cv2.addWeighted(sharp, level, blurred, 1.0 - level, 0.0), np.uint8)


def _clothes(generator: np.random.Generator) -> tuple[Color, Color]:
    """Colors of the target's coat and trousers, which differ."""
    hue = generator.uniform(0.0, 360.0)
    coat = (hue, generator.uniform(0.5, 0.8), generator.uniform(0.45, 0.75))
    legs = ((hue + generator.uniform(90.0, 270.0)) % 360.0, generator.uniform(0.3, 0.6), 0.4)
    return from_hsv(*coat), from_hsv(*legs)


def _patches(generator: np.random.Generator, colors: tuple[Color, Color]) -> list[_Patch]:
    """All patches of level 1, in the order in which they come: spread over the target's lane."""
    patches = []
    for _ in range(MOST_PATCHES):
        shade = generator.uniform(0.85, 1.15)
        color = colors[generator.integers(2)]
        patches.append(
            _Patch(
                x=int(generator.integers(-10, WIDTH - 10)),
                y=int(generator.uniform(_LANE - 1.25 * _PERSON_HEIGHT, _LANE)),
                width=int(generator.integers(8, 30)),
                height=int(generator.integers(10, 40)),
                color=shaded(color, shade),
                is_round=bool(generator.random() < 0.4),
            )
        )
    return patches


def _cover(image: NDArray[np.uint8], patch: _Patch, contrast: float) -> None:
    """Blend a patch into an image: 1 covers what was there, 0 leaves it."""
    covered = image.copy()
    if patch.is_round:
        center = (patch.x + patch.width // 2, patch.y + patch.height // 2)
        half = (patch.width // 2, patch.height // 2)
        cv2.ellipse(covered, center, half, 0, 0, 360, patch.color, -1, cv2.LINE_AA)
    else:
        far = (patch.x + patch.width - 1, patch.y + patch.height - 1)
        cv2.rectangle(covered, (patch.x, patch.y), far, patch.color, -1)
    cv2.addWeighted(covered, contrast, image, 1.0 - contrast, 0.0, dst=image)


def _target_way(generator: np.random.Generator, frames: int) -> NDArray[np.float64]:
    """(frames, 2): where the target's feet are; from left to right, now faster, now slower."""
    pace = generator.uniform(2.8, 3.4) * (
        1.0 + 0.2 * smooth_path(generator, frames, period=40.0)[:, 0]
    )
    rows = _LANE + 2.0 * smooth_path(generator, frames, period=60.0)[:, 0]
    start = generator.uniform(60.0, 90.0)
    return np.stack([start + np.cumsum(pace), rows], axis=1)


def _distractors(
    generator: np.random.Generator, frames: int, clothes: tuple[Color, Color]
) -> list[Actor]:
    """All people of level 1: half of them come towards the target, half go its way."""
    people = []
    for number in range(MOST_DISTRACTORS):
        direction = 1 if number % 2 else -1
        speed = generator.uniform(1.6, 4.6)
        start = (
            generator.uniform(260.0, 700.0) if direction < 0 else generator.uniform(130.0, 420.0)
        )
        columns = start + direction * speed * np.arange(frames)
        # Some pass behind the target, some in front of it.
        lane = _LANE + generator.uniform(5.0, 14.0) * generator.choice((-1.0, -1.0, 1.0))
        rows = lane + 1.5 * smooth_path(generator, frames, period=60.0)[:, 0]
        feet = np.stack([columns, rows], axis=1)
        people.append(_walker(generator, feet, direction, clothes))
    return people


def _walker(
    generator: np.random.Generator,
    feet: NDArray[np.float64],
    direction: int,
    clothes: tuple[Color, Color],
) -> Actor:
    """A person in cloth of these colors and of a pattern of its own."""
    pattern = fractal_noise(generator, (120, 120), 14.0)
    person = Person(_PERSON_HEIGHT, *clothes, direction)
    return person.walking(feet, 1.0 + 0.9 * (pattern - pattern.mean()))
