"""What all drawn scenes have in common: they are footage for evaluations."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.footage.base import frame_stamp
from pf_tracker_ros.frames import Frame
from scenes.camera import HandheldCamera
from scenes.stage import Stage

FRAME_INTERVAL = 0.04
"""Seconds between frames."""


class Scene:
    """A stage before a camera, as `Footage`.

    The images are drawn once and kept, for one tracker after another to see. The ground truth has
    (frames, 4) x, y, width, height of the target in pixels.
    """

    def __init__(
        self, name: str, stage: Stage, camera: HandheldCamera, ground_truth: NDArray[np.float64]
    ) -> None:
        self.name, self.stage, self.camera = name, stage, camera
        self.ground_truth = ground_truth
        self.frame_count, self.nominal_interval = len(ground_truth), FRAME_INTERVAL

    def render(self, index: int) -> NDArray[np.uint8]:
        """Frame `index`, counted from 0: (height, width, 3) uint8 BGR, or gray."""
        return self.camera.shoot(self.stage.paint(index), index)

    @cached_property
    def images(self) -> tuple[NDArray[np.uint8], ...]:
        """All images."""
        return tuple(self.render(index) for index in range(self.frame_count))

    def frames(self) -> Iterator[Frame]:
        """The frames; each call starts from the first."""
        for index, image in enumerate(self.images):
            yield Frame(image, frame_stamp(index, self.nominal_interval))
