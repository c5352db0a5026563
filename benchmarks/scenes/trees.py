"""Trees in the foreground: trunks, twigs and leaves that occlude the actors behind them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.sprites import Drawing, Sprite
from scenes.textures import fractal_noise


@dataclass(frozen=True)
class Tree:
    """One tree, in pixels of the stage."""

    x: float  # where the trunk stands
    ground: float  # row of its foot
    height: float  # from the foot to the middle of the crown
    trunk: float  # width of the trunk
    crown: float  # half the width of the crown
    hanging: float  # row down to which its lowest twigs hang


def plant(
    generator: np.random.Generator, size: tuple[int, int], trees: tuple[Tree, ...]
) -> NDArray[np.float32]:
    """Trees on a transparent foreground of (width, height): pixels as of a `Sprite`."""
    width, height = size
    drawing = Drawing(width, height, enlargement=2)
    for tree in trees:
        middle = tree.ground - tree.height
        drawing.stroke([(tree.x, tree.ground), (tree.x, middle)], tree.trunk, (42, 56, 72))
        for _ in range(14):
            angle, distance = generator.uniform(0, 2 * np.pi), np.sqrt(generator.random())
            clump = tree.crown * distance * np.array([np.cos(angle), 0.62 * np.sin(angle)])
            spread = tree.crown * generator.uniform(0.18, 0.3) * np.array([1.0, 0.7])
            _draw_leaves(generator, drawing, (tree.x, middle) + clump, spread, 130)
        # Twigs that hang from the crown, with leaves loosely along them.
        top = middle + 0.4 * tree.crown
        for _ in range(6):
            x = tree.x + generator.uniform(-0.6, 0.6) * tree.crown
            length = generator.uniform(0.4, 1.0) * max(tree.hanging - top, 0.0)
            drawing.stroke([(x, top), (x, top + length)], 1.6, (40, 55, 66))
            for row in np.arange(top + length, top + 8.0, -14.0):
                _draw_leaves(generator, drawing, np.array([x, row]), np.array([7.0, 6.0]), 10)
    bark = fractal_noise(generator, (height, width // 3 + 1), coarsest=14.0, persistence=0.8)
    texture = 0.7 + 0.6 * np.repeat(bark, 3, axis=1)[:, :width]
    return Sprite(drawing.pixels(), (0.0, 0.0)).textured(texture.astype(np.float32)).pixels


def _draw_leaves(
    generator: np.random.Generator,
    drawing: Drawing,
    center: NDArray[np.float64],
    spread: NDArray[np.float64],
    count: int,
) -> None:
    for x, y in center + spread * generator.standard_normal((count, 2)):
        length, light = generator.uniform(2.2, 4.6), generator.uniform(0.55, 1.25)
        color = (38 * light, 105 * light, 78 * light * generator.uniform(0.7, 1.1))
        drawing.ellipse((x, y), (length, 0.5 * length), color, generator.uniform(0.0, 180.0))
