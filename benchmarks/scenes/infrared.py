"""Pedestrians seen by an infrared camera: no color, low contrast, noise, halo, a flip of polarity.

That is what Zhang, Hu, Shi 2015 name as the trouble with infrared footage. The target goes from
left to right, people as warm as itself come towards it and pass behind it. Images are 640 x 480, 8
bit gray, at 25 frames per second.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from scenes.camera import HandheldCamera
from scenes.scene import Scene
from scenes.sprites import Sprite
from scenes.stage import Actor, Stage
from scenes.textures import fractal_noise, smooth_path
from scenes.walkers import GAIT_VIEWS, Person, standing_boxes

WIDTH, HEIGHT = 640, 480
FRAMES, FLIP = 100, 60
"""Number of frames, as in the paper's sequence, and the one from which on warm is dark."""

_MARGIN = 16
_STAGE_SIZE = (WIDTH + 2 * _MARGIN, HEIGHT + 2 * _MARGIN)
# Gray levels: of the ground, and of bodies above it.
_GROUND_LEVEL, _CONTRAST = 95.0, 40.0
_PERSON_HEIGHT = 96.0
_HALO_WIDTH, _HALO_STRENGTH = 9.0, 0.5


class InfraredScene(Scene):
    """A rendered infrared sequence of a pedestrian with exact ground truth.

    Every seed gives other ground, paths, people, shake and noise; the same seed gives the same
    bits.

    Args:
        seed: Seed of everything random, at least 0.
        flips: Whether the polarity flips in frame `FLIP`.
    """

    def __init__(self, seed: int = 0, flips: bool = True) -> None:
        ground, people, sensor = np.random.default_rng(seed).spawn(3)
        self._flips = flips
        *others, target = _people(people, FRAMES, _GROUND_LEVEL + _CONTRAST)
        clear = np.zeros((_STAGE_SIZE[1], _STAGE_SIZE[0], 4), np.float32)
        camera = HandheldCamera(
            sensor,
            size=(WIDTH, HEIGHT),
            margin=_MARGIN,
            frames=FRAMES,
            shake=1.0,
            lighting=0.01,
            noise=6.0,
        )
        boxes = standing_boxes(target.positions - camera.offsets, _PERSON_HEIGHT)
        name = f"generated {seed}, polarity flips" if flips else f"generated {seed}"
        super().__init__(name, Stage(_backdrop(ground), (*others, target), clear), camera, boxes)

    def render(self, index: int) -> NDArray[np.uint8]:
        """Frame `index`, counted from 0: (480, 640) uint8."""
        world = self.stage.paint(index)
        warmth = cv2.subtract(world[..., 0], self.stage.backdrop[..., 0], dtype=cv2.CV_32F)
        halo = cv2.GaussianBlur(warmth, (0, 0), _HALO_WIDTH) * _HALO_STRENGTH
        # On a body itself the sensor has settled: the ring is around it.
        halo[np.abs(warmth) > 1.0] = 0.0
        seen = np.clip(world - halo[..., None], 0.0, 255.0)
        image = self.camera.shoot(seen.astype(np.uint8), index)[..., 0]
        return np.ascontiguousarray(255 - image if self._flips and index >= FLIP else image)


def _backdrop(generator: np.random.Generator) -> NDArray[np.uint8]:
    """Ground with warm patches, walls above it and a few warm windows and lamps."""
    width, height = _STAGE_SIZE
    ground = _GROUND_LEVEL + 30.0 * (fractal_noise(generator, (height, width), 90.0) - 0.5)
    wall = int(height * generator.uniform(0.3, 0.4))
    ground[:wall] -= 20.0
    for _ in range(6):
        x, y = generator.integers(0, width - 40), generator.integers(10, wall - 30)
        ground[y : y + 22, x : x + int(generator.integers(14, 30))] += generator.uniform(10, 45)
    for _ in range(5):
        x, top = generator.integers(0, width - 8), generator.integers(wall - 60, wall)
        ground[top : top + 140, x : x + 5] += generator.uniform(-25.0, 40.0)
    gray = np.clip(ground, 0.0, 255.0).astype(np.uint8)
    return np.repeat(gray[..., None], 3, axis=2)


def _people(generator: np.random.Generator, frames: int, level: float) -> list[Actor]:
    """The others, from the farthest to the nearest, and last the target."""
    times = np.arange(frames, dtype=float)
    lane = _STAGE_SIZE[1] * 0.68
    actors = []
    for number, direction in enumerate((-1, -1, 1)):
        target = number == 2
        speed = generator.uniform(3.0, 4.0) * direction
        pace = speed * (1.0 + 0.1 * smooth_path(generator, frames, period=40.0)[:, 0])
        start = generator.uniform(90.0, 130.0) if target else generator.uniform(330.0, 620.0)
        up = 0.0 if target else generator.uniform(6.0, 18.0)
        feet = np.stack([start + np.cumsum(pace), np.full(frames, lane - up)], axis=1)
        feet[:, 1] += 1.5 * smooth_path(generator, frames, period=60.0)[:, 0]
        views = np.floor(times * abs(speed) / (0.8 * _PERSON_HEIGHT) * GAIT_VIEWS)
        person = Person(_PERSON_HEIGHT, (0, 0, 0), (0, 0, 0), direction)
        clothes = 0.5 + fractal_noise(generator, (120, 90), 20.0)
        sprites = tuple(_warm(person.sprite(view), level, clothes) for view in range(GAIT_VIEWS))
        actors.append(Actor(sprites, views.astype(np.int64) % GAIT_VIEWS, feet))
    return actors


def _warm(sprite: Sprite, level: float, clothes: NDArray[np.float32]) -> Sprite:
    """The same shape as warm as a body: the head warmest, less through clothes, legs least."""
    height, width = sprite.pixels.shape[:2]
    fall = np.interp(np.arange(height) / height, [0.0, 0.2, 0.3, 1.0], [1.15, 1.15, 1.0, 0.85])
    pixels = sprite.pixels.copy()
    warmth = level * fall[:, None] + 12.0 * (clothes[:height, :width] - 1.0)
    pixels[..., :3] = (pixels[..., 3] * warmth)[..., None]
    return Sprite(pixels.astype(np.float32), sprite.anchor)
