"""Trees in the foreground: trunks, branches and leaves that occlude the actors behind them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.sprites import Color, Drawing
from scenes.textures import fractal_noise


@dataclass(frozen=True)
class Tree:
    """One tree, in pixels of the stage."""

    x: float  # where the trunk stands
    ground: float  # row of its foot
    height: float  # from the foot to the middle of the crown
    trunk: float  # width of the trunk half-way up
    crown: float  # half the width of the crown
    hanging: float  # row down to which its lowest twigs hang


def plant(
    generator: np.random.Generator, size: tuple[int, int], trees: tuple[Tree, ...]
) -> NDArray[np.float32]:
    """Trees on a transparent foreground of (width, height): pixels as of a `Sprite`."""
    width, height = size
    drawing = Drawing(width, height, enlargement=2)
    for tree in trees:
        _draw_trunk(generator, drawing, tree)
        _draw_crown(generator, drawing, tree)
        _draw_twigs(generator, drawing, tree)
    bark = fractal_noise(generator, (height, width // 3 + 1), coarsest=14.0, persistence=0.8)
    texture = 0.7 + 0.6 * np.repeat(bark, 3, axis=1)[:, :width]
    return drawing.pixels(texture.astype(np.float32))


def _draw_trunk(generator: np.random.Generator, drawing: Drawing, tree: Tree) -> None:
    lean = generator.uniform(-0.03, 0.03)
    brown = generator.uniform(0.8, 1.15)
    color: Color = (42 * brown, 56 * brown, 72 * brown)
    rows = np.linspace(0.0, 1.0, 14)
    # Widest at the foot, where the roots begin.
    half = 0.5 * tree.trunk * (1.15 - 0.35 * rows + 0.7 * np.exp(-rows * 16.0))
    half += generator.normal(0.0, 0.03 * tree.trunk, rows.size)
    centers = tree.x + lean * tree.height * (rows - 0.4)
    ys = tree.ground - rows * tree.height
    left = np.stack([centers - half, ys], axis=1)
    right = np.stack([centers + half, ys], axis=1)[::-1]
    drawing.polygon(np.concatenate([left, right]), color)
    for _ in range(5):
        side = generator.choice([-1.0, 1.0])
        start = (tree.x, tree.ground - tree.height * generator.uniform(0.68, 0.9))
        reach = tree.crown * generator.uniform(0.5, 0.9)
        end = (tree.x + side * reach, start[1] - reach * generator.uniform(0.3, 0.8))
        drawing.stroke([start, end], tree.trunk * generator.uniform(0.2, 0.35), color)


def _draw_crown(generator: np.random.Generator, drawing: Drawing, tree: Tree) -> None:
    middle = tree.ground - tree.height
    for _ in range(14):
        angle, distance = generator.uniform(0, 2 * np.pi), np.sqrt(generator.random())
        clump_x = tree.x + tree.crown * distance * np.cos(angle)
        clump_y = middle + 0.62 * tree.crown * distance * np.sin(angle)
        spread = tree.crown * generator.uniform(0.18, 0.3)
        _draw_leaves(generator, drawing, (clump_x, clump_y), (spread, 0.7 * spread), 130)


def _draw_twigs(generator: np.random.Generator, drawing: Drawing, tree: Tree) -> None:
    """Twigs that hang from the crown, with leaves loosely along them."""
    top = tree.ground - tree.height + 0.4 * tree.crown
    for _ in range(6):
        x = tree.x + generator.uniform(-0.6, 0.6) * tree.crown
        low = tree.hanging - generator.uniform(0.0, 0.6) * max(tree.hanging - top, 0.0)
        bend = generator.uniform(-8.0, 8.0)
        drawing.stroke(
            [(x, top), (x + 0.4 * bend, 0.5 * (top + low)), (x + bend, low)], 1.6, (40, 55, 66)
        )
        for share in np.linspace(0.15, 1.0, max(int((low - top) / 14), 2)):
            place = (x + bend * share, top + share * (low - top))
            _draw_leaves(generator, drawing, place, (7.0, 6.0), 10)


def _draw_leaves(
    generator: np.random.Generator,
    drawing: Drawing,
    center: tuple[float, float],
    spread: tuple[float, float],
    count: int,
) -> None:
    places = np.asarray(center) + np.asarray(spread) * generator.standard_normal((count, 2))
    lengths = generator.uniform(2.2, 4.6, count)
    angles = generator.uniform(0.0, 180.0, count)
    brightness = generator.uniform(0.55, 1.25, count)
    yellow = generator.uniform(0.7, 1.1, count)
    for (x, y), length, angle, light, tint in zip(
        places, lengths, angles, brightness, yellow, strict=True
    ):
        color: Color = (38 * light, 105 * light, 78 * light * tint)
        drawing.ellipse((x, y), (length, 0.5 * length), color, float(angle))
