"""dlib's correlation tracker.

Source: Danelljan et al. 2014, "Accurate scale estimation for robust visual tracking" (DSST).
"""

from __future__ import annotations

import importlib.util
from typing import Any

import cv2
from color_image_tracker import Array, Box, Image
from numpy.typing import ArrayLike

from peer_trackers.peer import PeerTracker


class DlibCorrelation(PeerTracker):
    """dlib's `correlation_tracker`: translation and scale filters over gradient histograms."""

    name = "dlib correlation"

    @classmethod
    def missing(cls) -> str:
        """What has to be installed for this tracker to run; empty if nothing."""
        if importlib.util.find_spec("dlib") is not None:
            return ""
        return "pip install dlib-bin, or use `make bench`"

    def _learn(self, image: Image, box: Array) -> None:
        import dlib

        self._tracker = dlib.correlation_tracker()
        self._tracker.start_track(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), rectangle(box))

    def _find(self, image: Image, box: Array) -> Box:
        self._tracker.update(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
        found = self._tracker.get_position()
        return found.left(), found.top(), found.width(), found.height()


def rectangle(box: ArrayLike) -> Any:
    """A box as a rectangle of dlib, which ends with its last pixel."""
    import dlib

    x, y, width, height = box
    return dlib.drectangle(x, y, x + width - 1, y + height - 1)
