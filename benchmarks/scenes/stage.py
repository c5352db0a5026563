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


@dataclass(frozen=True, eq=False)
class Stage:
    """Draws actors between a backdrop and a foreground."""

    backdrop: NDArray[np.uint8]  # (H, W, 3), blue, green, red
    actors: tuple[Actor, ...]  # from the farthest to the nearest
    foreground: NDArray[np.float32] | None = None  # (H, W, 4) as the pixels of a `Sprite`

    def paint(self, index: int) -> NDArray[np.uint8]:
        """The whole stage in frame `index`: (H, W, 3) uint8."""
        canvas = self.backdrop.astype(np.float32)
        for actor in self.actors:
            actor.placed(index).draw(canvas)
        if self.foreground is not None:
            canvas *= 1.0 - self.foreground[..., 3:]
            canvas += self.foreground[..., :3]
        return np.clip(canvas + 0.5, 0.0, 255.0).astype(np.uint8)
