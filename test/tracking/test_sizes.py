"""The size of the box follows a target that comes near or walks off."""

import math

import cv2
import numpy as np
import pytest

from pf_tracker_ros import Tracker

INTERVAL, SIDE = 0.05, 40.0
STILL, MOVING = 10, 12


def shown(side, seed):
    """A textured square of a side around the middle of a textured image."""
    generator = np.random.default_rng(seed)
    image = cv2.resize(generator.integers(60, 160, (30, 40, 3), np.uint8), (320, 240))
    target = cv2.resize(generator.integers(0, 255, (8, 8, 3), np.uint8), (256, 256))
    corner, size = np.array([160, 120]) - side // 2, (side, side)
    image[corner[1] : corner[1] + side, corner[0] : corner[0] + side] = cv2.resize(
        target, size, interpolation=cv2.INTER_AREA
    )
    return image


@pytest.mark.parametrize("growth", [1.03, 1 / 1.03])
@pytest.mark.parametrize("seed", range(3))
def test_a_size_keeps_up_with_somebody_who_walks_before_a_robot(growth, seed):
    """A person at 2 m comes nearer by 1.2 m/s, at 20 frames a second."""
    tracker = Tracker.from_preset("default", seed=seed)
    tracker.start(shown(int(SIDE), seed), (160 - SIDE / 2, 120 - SIDE / 2, SIDE, SIDE))
    for number in range(1, STILL + MOVING + 10):
        side = round(SIDE * growth ** min(max(number - STILL, 0), MOVING))
        estimate = tracker.update(shown(side, seed), INTERVAL)
        error = abs(math.log(estimate.box[3] / side))
        if number <= STILL + MOVING:
            assert error < 0.15, number
    assert error < 0.08
