"""OpenCV's correlation trackers CSRT and KCF, and its deep tracker NanoTrack."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np
from color_image_tracker import Array, Box, Image

from peer_trackers.peer import PeerTracker
from pf_tracker_ros.evaluation import EvaluationError


class OpenCvTracker(PeerTracker):
    """A tracker with OpenCV's `init` and `update`, which know boxes of whole pixels only.

    An error that OpenCV raises while it tracks, as some of its trackers do at the border of the
    image, counts as a frame without a box.
    """

    factory: ClassVar[str]
    """Name of the function in `cv2` that makes the tracker."""

    @classmethod
    def missing(cls) -> str:
        """What has to be installed for this tracker to run; empty if nothing."""
        if hasattr(cv2, cls.factory):
            return ""
        return (
            "pip install opencv-contrib-python-headless in place of opencv-python-headless, "
            "or use `make bench`"
        )

    @abstractmethod
    def _create(self) -> Any:
        """A tracker that has not started."""

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

    def _create(self) -> Any:
        return cv2.TrackerCSRT_create()


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


class NanoTrack(OpenCvTracker):
    """NanoTrack, a small Siamese network.

    Args:
        seed: Makes no difference.
        backbone: ONNX file of the network that describes images.
        head: ONNX file of the network that compares them.
    """

    name = "NanoTrack"
    factory = "TrackerNano_create"

    def __init__(self, seed: int, backbone: Path, head: Path) -> None:
        super().__init__(seed)
        self._files = (backbone, head)

    def check(self) -> None:
        """Try the files, which otherwise show only while tracking that they do not fit.

        Raises:
            EvaluationError: They are no networks of NanoTrack, or in the wrong order.
        """
        image = np.random.default_rng(0).integers(0, 255, (240, 320, 3), dtype=np.uint8)
        files = " and ".join(f"'{file}'" for file in self._files)
        allowed = "allowed: NanoTrack's backbone, then its head, in ONNX format"
        for file in self._files:
            if not file.is_file():
                raise EvaluationError(f"no file '{file}'; {allowed}")
        try:
            self._learn(image, np.array([140.0, 100.0, 40.0, 40.0]))
            self._tracker.update(image)
        except (ValueError, cv2.error) as error:
            raise EvaluationError(f"OpenCV cannot track with {files}; {allowed}") from error

    def _create(self) -> Any:
        parameters = cv2.TrackerNano_Params()
        parameters.backbone, parameters.neckhead = map(str, self._files)
        return cv2.TrackerNano_create(parameters)
