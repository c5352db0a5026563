"""Footage of two targets, and a filter that tracks one of them."""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from pf_tracker_ros.filter.particles import GeneratorState
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.parameters import build
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import preset_parameters
from pf_tracker_ros.tracking.target_filter import TargetFilter

WIDTH, HEIGHT, SIDE = 240, 160, 30
FRAMES = 24


@dataclass(frozen=True)
class Couple:
    """Two targets side by side; the first is out of sight for a while.

    Attributes:
        images: (H, W, 3) uint8 BGR each.
        first: (frames, 4) boxes, pixels.
        second: (frames, 4) boxes, pixels.
        hidden: Frames in which the first is out of sight.
    """

    images: tuple[np.ndarray, ...]
    first: np.ndarray
    second: np.ndarray
    hidden: range


def texture(seed, height, width, low, high):
    noise = np.random.default_rng(seed).integers(low, high, (height // 6, width // 6, 3))
    return cv2.resize(noise.astype(np.uint8), (width, height), interpolation=cv2.INTER_CUBIC)


@pytest.fixture(scope="session")
def couple():
    """Two textures of 30 px that go right, 40 px from each other, over a third one."""
    ground = texture(1, HEIGHT, WIDTH, 90, 160)
    sprites = [texture(seed, SIDE, SIDE, 0, 250) for seed in (2, 3)]
    hidden = range(9, 15)
    images, boxes = [], ([], [])
    for index in range(FRAMES):
        image = ground.copy()
        for number, sprite in enumerate(sprites):
            x, y = 30 + 2 * index + 40 * number, 50 + index
            if number == 1 or index not in hidden:
                image[y : y + SIDE, x : x + SIDE] = sprite
            boxes[number].append((x, y, SIDE, SIDE))
        images.append(image)
    first, second = (np.array(one, float) for one in boxes)
    for array in (*images, first, second):
        array.flags.writeable = False
    return Couple(tuple(images), first, second, hidden)


class SingleTargetFilter(TargetFilter):
    """Tracks a single target from frame to frame."""

    def start(self, image, box, seed=3):
        generator_state = GeneratorState.of(np.random.default_rng(seed))
        return self.initialize(Frame(image), tuple(box), generator_state)

    def follow(self, state, frame, interval):
        (frame_prediction,) = self.predict([(state, True)], frame, interval)
        return self.step(frame_prediction)


@pytest.fixture
def make_target_filter():
    """A function that makes the filter of a preset, with other values of some parameters."""

    def make(preset, parameters=None):
        values = preset_parameters(preset) | (parameters or {})
        return SingleTargetFilter(build(TrackerParameters, values))

    return make
