"""A stage: a backdrop, actors that move in front of it, and a foreground that occludes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.sprites import Placement, Sprite


@dataclass(frozen=True, eq=False)
class Actor:
    """Something that moves: where it is and what it looks like in every frame."""

    sprites: tuple[Sprite, ...]  # the views of it
    views: NDArray[np.int64]  # (frames,) which of the sprites is seen
    # (frames, 2) where the sprite's anchor is, in pixel indices of the stage
    positions: NDArray[np.float64]

    def placed(self, index: int) -> Placement:
        """The actor in frame `index`."""
        x, y = self.positions[index]
        return self.sprites[self.views[index]].placed(x, y)


class Stage:
    """Draws actors between a backdrop and a foreground, and knows how much of each is seen.

    Only the rows that actors ever touch are drawn anew for a frame.

    Args:
        backdrop: (H, W, 3) uint8, blue, green, red.
        actors: From the farthest to the nearest.
        foreground: (H, W, 4) float32 as the pixels of a `Sprite`.
    """

    def __init__(
        self,
        backdrop: NDArray[np.uint8],
        actors: tuple[Actor, ...],
        foreground: NDArray[np.float32],
    ):
        self.backdrop = backdrop
        self.actors = actors
        self.foreground = foreground
        height = backdrop.shape[0]
        tops = [
            actor.positions[:, 1].min() - max(sprite.anchor[1] for sprite in actor.sprites)
            for actor in actors
        ]
        bottoms = [
            actor.positions[:, 1].max()
            + max(sprite.pixels.shape[0] - sprite.anchor[1] for sprite in actor.sprites)
            for actor in actors
        ]
        self._top = max(int(min(tops, default=0)) - 1, 0)
        self._bottom = min(int(max(bottoms, default=0)) + 2, height)
        rows = slice(self._top, self._bottom)
        self._band = backdrop[rows].astype(np.float32)
        self._veil = np.repeat(1.0 - foreground[rows, :, 3:], 3, axis=2)
        self._foreground_band = np.ascontiguousarray(foreground[rows, :, :3])
        empty_stage = backdrop * (1.0 - foreground[..., 3:]) + foreground[..., :3]
        self._world = _to_levels(empty_stage)

    def paint(self, index: int) -> NDArray[np.uint8]:
        """The whole stage in frame `index`: (H, W, 3) uint8."""
        band = self._band.copy()
        for actor in self.actors:
            actor.placed(index).relative_to(0, self._top).draw(band)
        band *= self._veil
        band += self._foreground_band
        world = self._world.copy()
        world[self._top : self._bottom] = _to_levels(band)
        return world


def _to_levels(image: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.clip(image + 0.5, 0.0, 255.0).astype(np.uint8)
