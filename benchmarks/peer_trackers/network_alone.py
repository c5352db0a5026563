"""The network of the preset `learned` without the filter."""

from __future__ import annotations

import numpy as np
from color_image_tracker import Array, Box, Image

from peer_trackers.peer import PeerTracker
from pf_tracker_ros.boxes import as_box
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.networks.siamese import SiameseNetwork

# Least side of a box, pixels.
_LEAST_SIDE = 3.0


class NetworkAlone(PeerTracker):
    """The likeliest box of a Siamese network around its last one, cut at the image's border.

    Args:
        seed: Makes no difference.
        network: The network.
    """

    name = "network alone"

    def __init__(self, seed: int, network: SiameseNetwork) -> None:
        super().__init__(seed)
        self._network = network

    def _learn(self, image: Image, box: Array) -> None:
        self._template = self._network.learn(Frame(image), box)

    def _find(self, image: Image, box: Array) -> Box:
        (found,) = self._network.find(Frame(image), self._template, box).likeliest(1).boxes
        limits = np.array([image.shape[1], image.shape[0]], dtype=np.float64)
        corner = np.clip(found[:2], 0.0, limits - _LEAST_SIDE)
        end = np.clip(found[:2] + found[2:], corner + _LEAST_SIDE, limits)
        return as_box([*corner, *(end - corner)])
