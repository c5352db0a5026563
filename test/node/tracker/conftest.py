"""Footage of several targets for live nodes."""

import numpy as np
import pytest

FRAMES = 16


@pytest.fixture(scope="session")
def walkers():
    """(images, boxes (frames, 2, 4)) of two colored walkers on a textured ground."""
    rng = np.random.default_rng(4)
    ground = rng.integers(90, 150, (200, 320, 3)).astype(np.uint8)
    sprites = [rng.integers(0, 120, (40, 24, 3)).astype(np.uint8) for _ in range(2)]
    sprites[0][..., 2] = 240
    sprites[1][..., 0] = 240
    images, boxes = [], []
    for frame in range(FRAMES):
        image = ground.copy()
        corners = [(30 + 3 * frame, 40), (250 - 3 * frame, 120)]
        for (x, y), sprite in zip(corners, sprites, strict=True):
            image[y : y + 40, x : x + 24] = sprite
        images.append(image)
        boxes.append([(float(x), float(y), 24.0, 40.0) for x, y in corners])
    return images, boxes
