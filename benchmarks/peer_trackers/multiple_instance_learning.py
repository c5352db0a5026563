"""OpenCV's MIL tracker, the machine learning family of Zhang Bo's comparison."""

from __future__ import annotations

from color_image_tracker import Array, Box, Image
from tracker_families import machine_learning

from peer_trackers.peer import PeerTracker


class MultipleInstanceLearning(PeerTracker):
    """MIL, which has no scale; seeded, as what OpenCV draws from is not."""

    name = "MIL"
    is_random = True

    def _learn(self, image: Image, box: Array) -> None:
        self._tracker = machine_learning.MultipleInstanceLearning(self._seed)
        self._tracker.start(image, box)

    def _find(self, image: Image, box: Array) -> Box:
        return self._tracker.update(image).box
