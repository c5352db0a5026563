"""Trackers of other libraries behind one interface, for the comparison in `peers.py`.

Each tracker runs as its library ships it, save where its docstring says so.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any, ClassVar

import cv2
import numpy as np
from color_image_tracker import Array, Box, ColorImageTracker, Image
from numpy.typing import NDArray


class PeerTracker(ColorImageTracker):
    """Another tracker as one that can be evaluated; its answers are taken as they are."""

    name: ClassVar[str]
    """As it stands in the tables."""

    @classmethod
    def missing(cls) -> str:
        """What has to be installed for this tracker to run; empty if nothing."""
        return ""


class OpenCvTracker(PeerTracker):
    """A tracker with OpenCV's `init` and `update`, which know boxes of whole pixels only.

    An error that OpenCV raises while it tracks, as some of its trackers do at the border of the
    image, counts as a frame without a box.
    """

    factory: ClassVar[str]
    """Name of the function in `cv2` that makes the tracker."""

    @classmethod
    def missing(cls) -> str:
        """See `PeerTracker.missing`."""
        has_it = hasattr(cv2, cls.factory)
        return "" if has_it else "OpenCV is without its contributed trackers; use `make bench`"

    def _create(self) -> Any:
        """A tracker that has not started."""
        return getattr(cv2, self.factory)()

    def _learn(self, image: Image, box: Array) -> None:
        x, y, width, height = box
        near = np.rint((x, y)).astype(int)
        far = np.maximum(np.rint((x + width, y + height)).astype(int), near + 1)
        try:
            self._tracker = self._create()
            self._tracker.init(image, (*near.tolist(), *(far - near).tolist()))
        except cv2.error as error:
            raise ValueError(f"OpenCV's {self.name} refuses: {error}") from error

    def _find(self, image: Image, box: Array) -> Box | None:
        try:
            found, (x, y, width, height) = self._tracker.update(image)
        except cv2.error:
            return None
        return (float(x), float(y), float(width), float(height)) if found else None


class ChannelSpatialReliability(OpenCvTracker):
    """CSRT.

    Source: Lukezic et al. 2017, "Discriminative correlation filter with channel and spatial
    reliability".
    """

    name = "CSRT"
    factory = "TrackerCSRT_create"


class KernelizedCorrelation(OpenCvTracker):
    """KCF, which has no scale.

    As it is shipped it gives the target up for good once a response is below 0.5; the threshold 0
    lets it go on, as its authors' does.

    Source: Henriques et al. 2015, "High-speed tracking with kernelized correlation filters".
    """

    name = "KCF"
    factory = "TrackerKCF_create"

    def _create(self) -> Any:
        parameters = cv2.TrackerKCF_Params()
        parameters.detect_thresh = 0.0
        return cv2.TrackerKCF_create(parameters)


class DlibCorrelation(PeerTracker):
    """dlib's `correlation_tracker`: translation and scale filters over gradient histograms.

    Source: Danelljan et al. 2014, "Accurate scale estimation for robust visual tracking" (DSST).
    """

    name = "dlib correlation"

    @classmethod
    def missing(cls) -> str:
        """See `PeerTracker.missing`."""
        return "" if find_spec("dlib") else "pip install dlib-bin, or use `make bench`"

    def _learn(self, image: Image, box: Array) -> None:
        import dlib

        self._tracker = dlib.correlation_tracker()
        x, y, width, height = box
        # A rectangle of dlib ends with its last pixel.
        rectangle = dlib.drectangle(x, y, x + width - 1, y + height - 1)
        self._tracker.start_track(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), rectangle)

    def _find(self, image: Image, box: Array) -> Box:
        self._tracker.update(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
        found = self._tracker.get_position()
        return found.left(), found.top(), found.width(), found.height()


_PARTICLES = 100
# Standard deviation of a step: of the center in sides of the box, of the scale in parts of it.
_POSITION_NOISE, _SCALE_NOISE = 0.1, 0.02
_SCALE_RANGE = (0.3, 4.0)
# exp(-20 d^2), as Perez et al. have it.
_SHARPNESS = 20.0
_BINS = (8, 8, 8)
_RANGES = (0, 180, 0, 256, 0, 256)


class ColorParticleFilter(PeerTracker):
    """100 particles in a random walk of center and scale, each with an HSV histogram.

    Histograms by `calcHist`, Bhattacharyya distance to that of the first frame by `compareHist`,
    the weighted mean as the estimate, multinomial resampling in each frame.

    Source: Perez et al. 2002, "Color-based probabilistic tracking".
    """

    name = "color particle filter"

    def _learn(self, image: Image, box: Array) -> None:
        self._generator = np.random.default_rng(self._seed)
        x, y, width, height = box
        self._size = np.array([width, height])
        first = np.array([x + width / 2, y + height / 2, 1.0])
        self._states = np.tile(first, (_PARTICLES, 1))
        self._reference = self._histogram(cv2.cvtColor(image, cv2.COLOR_BGR2HSV), first)

    def _find(self, image: Image, box: Array) -> Box:
        hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
        self._predict(image.shape[1], image.shape[0])
        weights = np.empty(_PARTICLES)
        for index, state in enumerate(self._states):
            histogram = self._histogram(hsv, state)
            distance = cv2.compareHist(self._reference, histogram, cv2.HISTCMP_BHATTACHARYYA)
            weights[index] = np.exp(-_SHARPNESS * distance**2)
        weights /= weights.sum()
        x, y, scale = weights @ self._states
        drawn = self._generator.choice(_PARTICLES, _PARTICLES, p=weights)
        self._states = self._states[drawn]
        width, height = scale * self._size
        return float(x - width / 2), float(y - height / 2), float(width), float(height)

    def _predict(self, image_width: int, image_height: int) -> None:
        noise = np.array([*(_POSITION_NOISE * self._size), _SCALE_NOISE])
        self._states = self._states + noise * self._generator.standard_normal((_PARTICLES, 3))
        lowest = (0.0, 0.0, _SCALE_RANGE[0])
        highest = (image_width - 1.0, image_height - 1.0, _SCALE_RANGE[1])
        self._states = np.clip(self._states, lowest, highest)

    def _histogram(self, hsv: Image, state: NDArray[np.float64]) -> NDArray[np.float32]:
        """Of the pixels of a state's box; the box reaches at least one pixel of the image."""
        center, sides = state[:2], state[2] * self._size
        left, top = np.maximum(center - sides / 2, 0.0).astype(int)
        right, bottom = np.ceil(center + sides / 2).astype(int)
        patch = hsv[top:bottom, left:right]
        histogram = cv2.calcHist([patch], [0, 1, 2], None, _BINS, _RANGES)
        return cv2.normalize(histogram, None, 1.0, 0.0, cv2.NORM_L1)


PEERS: tuple[type[PeerTracker], ...] = (
    ChannelSpatialReliability,
    KernelizedCorrelation,
    DlibCorrelation,
    ColorParticleFilter,
)
