"""OpenCV's MIL tracker, which Zhang Bo's comparison has as the family of machine learning."""

from __future__ import annotations

from tracker_families import machine_learning

from peer_trackers.peer import Box, Image, PeerTracker


class MultipleInstanceLearning(PeerTracker):
    """MIL, which has no scale; seeded, as what OpenCV draws from is not."""

    name = "MIL"
    is_random = True

    def _start(self, image: Image, box: Box) -> None:
        self._tracker = machine_learning.MultipleInstanceLearning(self._seed)
        self._tracker.start(image, box)

    def _update(self, image: Image) -> Box:
        return self._tracker.update(image)
