"""People and their umbrellas, as sprites."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from scenes.sprites import Color, Drawing, Sprite, shaded
from scenes.stage import Actor

GAIT_VIEWS = 12
"""Number of views of a person in one cycle of two steps; the view after the last is the first."""

_ENLARGEMENT = 4
_PANELS = 8

# Mean width of a walking person over its height.
_PERSON_WIDTH = 0.4

Pattern = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
"""Maps canopy coordinates, the rim a circle of radius 1, to a number: at least 0 the one color,
below 0 the other, each on about half of the canopy."""


def standing_boxes(feet: NDArray[np.float64], height: float) -> NDArray[np.float64]:
    """(frames, 4) boxes of a person from head to feet, all of one size.

    The (frames, 2) feet are pixels, whose index is their center; boxes count from the corner of
    the first pixel.
    """
    width = _PERSON_WIDTH * height
    corners = feet + 0.5 - (width / 2, height - 1.0)
    return np.hstack([corners, np.broadcast_to((width, height), corners.shape)])


def panels(across: NDArray[np.float64], along: NDArray[np.float64]) -> NDArray[np.float64]:
    """Panels between the ribs in turn of either color."""
    return np.asarray(np.sin(_PANELS / 2 * np.arctan2(along, across)))


def rings(across: NDArray[np.float64], along: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rings of equal area around the tip."""
    return np.asarray(np.sin(4.0 * np.pi * (across**2 + along**2)))


def stripes(across: NDArray[np.float64], along: NDArray[np.float64]) -> NDArray[np.float64]:
    """Parallel stripes, slanting to the right."""
    return np.asarray(np.sin(2.0 * np.pi * 1.75 * (0.8 * across + 0.6 * along)))


def checks(across: NDArray[np.float64], along: NDArray[np.float64]) -> NDArray[np.float64]:
    """A chessboard."""
    return np.asarray(np.sin(1.5 * np.pi * across) * np.sin(1.5 * np.pi * along))


PATTERNS: tuple[Pattern, ...] = (panels, rings, stripes, checks)
"""Patterns of like colors and unlike edges."""


@dataclass(frozen=True)
class Canopy:
    """An umbrella's canopy: a shallow bowl with a scalloped rim, tilted towards the camera."""

    pattern: Pattern  # where it has which of the two colors
    colors: tuple[Color, Color]  # the two colors of the cloth
    radius: float = 22.0  # radius of the rim in pixels
    bulge: float = 0.5  # height of the bowl over its radius
    # angle between the umbrella's shaft and the image plane in degrees, 0 to 90
    elevation: float = 60.0

    def sprite(self, roll: float) -> Sprite:
        """The canopy with its shaft turned in the image plane by `roll` degrees clockwise."""
        size = 2 * int(np.ceil(self.radius + 4.0))
        steps = (np.arange(size * _ENLARGEMENT) + 0.5) / _ENLARGEMENT - size / 2
        right, down = np.meshgrid(steps / self.radius, steps / self.radius)
        turn = np.radians(roll)
        across = np.cos(turn) * right + np.sin(turn) * down
        below = np.cos(turn) * down - np.sin(turn) * right
        # A point of the bowl (across, along) is seen at height `below` in the image:
        # below = sin(elevation) along - cos(elevation) bulge (1 - across^2 - along^2).
        tilt, lift = np.sin(np.radians(self.elevation)), np.cos(np.radians(self.elevation))
        rise = self.bulge * lift
        root = tilt**2 + 4.0 * rise * (rise * (1.0 - across**2) + below)
        along = (np.sqrt(np.maximum(root, 0.0)) - tilt) / (2.0 * rise)
        angle = np.arctan2(along, across)
        distance = np.hypot(across, along)
        rim = 1.0 - 0.06 * np.abs(np.sin(_PANELS / 2 * angle + np.pi / 2)) ** 0.7
        inside = (root > 0.0) & (distance <= rim)
        # Light from high on the left; the cloth sags between the ribs.
        normal = np.stack([2 * self.bulge * across, 2 * self.bulge * along, np.ones_like(across)])
        normal /= np.linalg.norm(normal, axis=0)
        light = np.array([-0.35, -0.45, 0.82])
        shade = 0.72 + 0.34 * np.tensordot(light, normal, axes=1)
        ribs = np.abs(np.sin(_PANELS / 2 * angle + np.pi / 2))
        shade *= np.where((ribs < 0.05 / np.maximum(distance, 0.1)) & (distance > 0.08), 0.86, 1.0)
        first = self.pattern(across, along) >= 0.0
        cloth = np.where(first[..., None], self.colors[0], self.colors[1]) * shade[..., None]
        coverage = inside.astype(np.float32)
        enlarged = np.dstack([np.clip(cloth, 0, 255) * coverage[..., None], coverage])
        pixels = cv2.resize(enlarged.astype(np.float32), (size, size), interpolation=cv2.INTER_AREA)
        return Sprite(pixels, (0.0, 0.0)).held_at_centroid()


@dataclass(frozen=True)
class Person:
    """A person in a coat, seen from the side."""

    height: float  # height in pixels
    coat: Color  # color of coat and arm
    trousers: Color  # color of the legs
    facing: int  # 1 when looking to the right, -1 to the left

    def walking(self, feet: NDArray[np.float64], cloth: NDArray[np.float32] | None = None) -> Actor:
        """The person on a way of the (frames, 2) feet; two steps take them one cycle of the gait.

        The cloth has (H, W) factors of the brightness, for at least the size of a sprite.
        """
        sprites = [self.sprite(view) for view in range(GAIT_VIEWS)]
        if cloth is not None:
            sprites = [sprite.textured(cloth) for sprite in sprites]
        cycles = self.facing * feet[:, 0] / (0.8 * self.height)
        return Actor(tuple(sprites), np.floor(cycles * GAIT_VIEWS).astype(int) % GAIT_VIEWS, feet)

    def sprite(self, view: int) -> Sprite:
        """The person at one view of the gait, held at the feet."""
        scale = self.height / 70.0
        width, height = int(np.ceil(56 * scale)), int(np.ceil(74 * scale))
        middle, ground = width / 2, height - 2.0
        drawing = Drawing(width, height)
        swing = np.sin(2.0 * np.pi * view / GAIT_VIEWS)
        hip = ground - 33 * scale
        for leg, darkness in ((-swing, 0.75), (swing, 1.0)):
            self._draw_leg(drawing, (middle, hip), ground, scale, swing=leg, darkness=darkness)
        shoulder = ground - 57 * scale
        torso = [(-6.5, 0), (6.0, 0), (8.0, 12), (7.5, 29), (-8.0, 29), (-7.5, 12)]
        drawing.polygon(
            [(middle + self.facing * x * scale, shoulder + y * scale) for x, y in torso], self.coat
        )
        hand = (middle + self.facing * (3.0 + 5.0 * swing) * scale, shoulder + 24 * scale)
        sleeve = [(middle, shoulder + 3 * scale), hand]
        drawing.stroke(sleeve, 4.5 * scale, shaded(self.coat, 0.8))
        drawing.ellipse(hand, (2.2 * scale, 2.2 * scale), (140, 165, 205))
        head = (middle + self.facing * 1.5 * scale, shoulder - 7.0 * scale)
        drawing.ellipse(head, (4.8 * scale, 6.0 * scale), (140, 165, 205))
        hair = (head[0] - self.facing * 1.2 * scale, head[1] - 2.5 * scale)
        drawing.ellipse(hair, (5.0 * scale, 4.6 * scale), (30, 35, 45))
        return Sprite(drawing.pixels(), (middle - 0.5, ground - 0.5))

    def _draw_leg(
        self,
        drawing: Drawing,
        hip: tuple[float, float],
        ground: float,
        scale: float,
        *,
        swing: float,
        darkness: float,
    ) -> None:
        foot = hip[0] + self.facing * 11.0 * scale * swing
        lift = max(0.0, 3.0 * scale * (1.0 - abs(swing)) * (1.0 if darkness < 1.0 else 0.0))
        knee = (0.5 * (hip[0] + foot) + self.facing * 2.5 * scale, hip[1] + 16 * scale)
        drawing.stroke(
            [hip, knee, (foot, ground - 2.0 * scale - lift)],
            6.0 * scale,
            shaded(self.trousers, darkness),
        )
        toe = foot + self.facing * 2.5 * scale
        drawing.ellipse(
            (toe, ground - 1.5 * scale - lift), (4.5 * scale, 2.0 * scale), (25, 25, 30)
        )
