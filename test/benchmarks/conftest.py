"""Footage of the benchmarks' tests."""

import cv2
import numpy as np
import pytest


@pytest.fixture(scope="session")
def cloth():
    """Images and boxes of a square of cloth that goes right and down over a plain ground."""
    generator = np.random.default_rng(11)
    ground = cv2.resize(generator.integers(70, 130, (20, 30, 3), dtype=np.uint8), (240, 160))
    cells = np.where(generator.integers(0, 2, (6, 6, 1)), (30, 60, 220), (20, 190, 240))
    square = cv2.resize(cells.astype(np.uint8), (36, 36), interpolation=cv2.INTER_NEAREST)
    boxes = np.array([(20 + 3 * index, 40 + index, 36, 36) for index in range(20)], float)
    images = [ground.copy() for _ in boxes]
    for image, (x, y) in zip(images, boxes[:, :2].astype(int), strict=True):
        image[y : y + 36, x : x + 36] = square
    return images, boxes
