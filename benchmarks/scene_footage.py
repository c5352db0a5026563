"""Generated scenes as footage for evaluations."""

from __future__ import annotations

from collections.abc import Iterator, Sized
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.footage.base import frame_stamp
from pf_tracker_ros.frames import Frame


class Scene(Sized, Protocol):
    """A generated scene: length, images and true boxes."""

    @property
    def target_boxes(self) -> NDArray[np.float64]:
        """(frames, 4) x, y, width, height in pixels."""
        ...

    def frames(self) -> Iterator[NDArray[Any]]:
        """All images; each call starts from the first."""
        ...


class SceneFootage:
    """A generated scene as `Footage`.

    The images are drawn once and kept, for one tracker after another to see.

    Args:
        name: Name of the sequence.
        scene: The scene.
        interval: Seconds between frames.
    """

    def __init__(self, name: str, scene: Scene, interval: float) -> None:
        self.name = name
        self.frame_count = len(scene)
        self.nominal_interval = interval
        self.ground_truth = scene.target_boxes
        self._scene = scene

    @cached_property
    def _images(self) -> tuple[NDArray[Any], ...]:
        return tuple(self._scene.frames())

    def frames(self) -> Iterator[Frame]:
        """The frames; each call starts from the first."""
        for index, image in enumerate(self._images):
            yield Frame(image, frame_stamp(index, self.nominal_interval))
