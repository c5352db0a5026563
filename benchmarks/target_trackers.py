"""Multi-target trackers behind one interface, for the comparison in `targets.py`."""

from __future__ import annotations

import importlib
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from pf_tracker_ros import Detections, MultiTracker, Tracker
from pf_tracker_ros.boxes import pairwise_iou

Image, Array = NDArray[np.uint8], NDArray[np.float64]


class FrameTracks(NamedTuple):
    """Tracks of a frame, by a tracker or true ones."""

    ids: NDArray[np.intp]  # (K,) of the targets
    boxes: Array  # (K, 4) x, y, width, height in pixels


class TargetTracker(Protocol):
    """A tracker of several targets, made for one sequence."""

    @classmethod
    def missing(cls) -> str:
        """How to install what is missing; empty if nothing."""
        return ""

    @abstractmethod
    def update(self, image: Image, interval: float, seen: Array | None) -> FrameTracks:
        """The tracks in the next frame, so many seconds later.

        (M, 5) boxes and scores of a detector are seen, or None where it did not run.
        """


class MultiTargets(TargetTracker):
    """`MultiTracker` with its default preset."""

    def __init__(self, seed: int = 0, every: int = 1) -> None:
        self._tracker = MultiTracker.from_preset("default", seed)

    def update(self, image: Image, interval: float, seen: Array | None) -> FrameTracks:
        """See `TargetTracker.update`."""
        detections = None if seen is None else Detections(seen[:, :4], seen[:, 4])
        tracks = self._tracker.update(image, interval, detections)
        return _as_arrays([(target.id, target.estimate.box) for target in tracks])


class SingleTargets(TargetTracker):
    """A separate `Tracker` for each target.

    It starts on an unmatched detection, ends when a detector frame has none for it, and restarts
    on its detection after drift.
    """

    SAME_ABOVE = 0.3
    STRAYED_BELOW = 0.6

    def __init__(self, seed: int = 0, every: int = 1) -> None:
        self._seed = seed
        self._trackers: dict[int, Tracker] = {}
        self._last = 0

    def update(self, image: Image, interval: float, seen: Array | None) -> FrameTracks:
        """See `TargetTracker.update`."""
        for tracker in self._trackers.values():
            tracker.update(image, interval)
        if seen is not None:
            self._assign(image, seen[:, :4])
        return _as_arrays([(name, one.estimate.box) for name, one in self._trackers.items()])

    def _assign(self, image: Image, boxes: Array) -> None:
        names = list(self._trackers)
        places = np.array([self._trackers[name].estimate.box for name in names]).reshape(-1, 4)
        shared = pairwise_iou(places, boxes)
        kept, used = {}, set()
        for row, column in zip(*linear_sum_assignment(-shared), strict=True):
            if shared[row, column] > self.SAME_ABOVE:
                tracker = kept[names[row]] = self._trackers[names[row]]
                used.add(column)
                if shared[row, column] < self.STRAYED_BELOW:
                    self._start(tracker, image, boxes[column])
        for column in range(len(boxes)):
            tracker = Tracker.from_preset("default", self._seed)
            if column not in used and self._start(tracker, image, boxes[column]):
                self._last += 1
                kept[self._last] = tracker
        self._trackers = kept

    def _start(self, tracker: Tracker, image: Image, box: Array) -> bool:
        try:
            tracker.start(image, box)
        except ValueError:
            return False
        return True


@dataclass(frozen=True)
class Settings:
    """Settings of a tracker by detections alone."""

    max_misses: int  # maximum of consecutive missed detections before a track ends
    max_misses_reported: int  # maximum of consecutive missed detections of a reported track
    iou_threshold: float  # minimum overlap of a track with its detection, 0 to 1; DIoU from -1 on
    score_threshold: float  # minimum score of a detection that starts a track, 0 to 1
    options: Mapping[str, Any] = field(default_factory=dict)  # further arguments of the tracker


class DetectionOnlyTracker(TargetTracker):
    """A tracker of the package `trackers`, which does not use the image.

    Its Kalman filter's prediction gives the boxes between detections.
    """

    SETTINGS: ClassVar[Mapping[int, Settings]]
    """Interval of the detector in frames to settings for it.

    Found by a small search, one setting after another, on PETS09-S2L1 and TUD-Stadtmitte, by the
    sum of their HOTA: chosen on what they are judged by, which flatters them.
    """

    kind: ClassVar[str]
    """Name of the package's class, of its arguments of the minimum score, and of the overlap."""
    scored: ClassVar[str] = "track_activation_threshold"
    overlapping: ClassVar[str] = "minimum_iou_threshold"

    def __init__(self, seed: int = 0, every: int = 1) -> None:
        settings = self.SETTINGS[every]
        self._idle = (settings.max_misses_reported + 1) * every
        module = importlib.import_module("trackers")
        self._detections = importlib.import_module("supervision").Detections
        self._numbers: dict[Any, int] = {}
        options = dict(settings.options)
        if isinstance(estimator := options.get("state_estimator_class"), str):
            estimators = importlib.import_module("trackers.utils.state_representations")
            options["state_estimator_class"] = getattr(estimators, estimator)
        if "iou" in options:
            options["iou"] = getattr(module, options["iou"])()
        self._tracker = getattr(module, self.kind)(
            # In frames at 30 Hz, as the package counts.
            frame_rate=30.0,
            lost_track_buffer=settings.max_misses * every,
            minimum_consecutive_frames=1,
            **{self.overlapping: settings.iou_threshold, self.scored: settings.score_threshold},
            **options,
        )

    @classmethod
    def missing(cls) -> str:
        """See `TargetTracker.missing`."""
        return "" if find_spec("trackers") else "pip install 'trackers>=2.6'"

    def update(self, image: Image, interval: float, seen: Array | None) -> FrameTracks:
        """See `TargetTracker.update`."""
        if seen is None:
            self._predict(image)
        else:
            corners = np.hstack([seen[:, :2], seen[:, :2] + seen[:, 2:4]])
            self._correct(
                self._detections(corners, confidence=seen[:, 4], class_id=np.zeros(len(seen), int)),
                image,
            )
        tracks = [
            # The package numbers a track at its second detection.
            (self._numbers.setdefault(track, len(self._numbers)), track.get_state_bbox())
            for track in self._tracker.tracks
            if track.time_since_update < self._idle
        ]
        return _as_arrays([(name, (*box[:2], *(box[2:] - box[:2]))) for name, box in tracks])

    def _predict(self, image: Image) -> None:
        for track in self._tracker.tracks:
            track.predict()

    def _correct(self, detections: Any, image: Image) -> None:
        self._tracker.update(detections)


_AREA = {"state_estimator_class": "XCYCSRStateEstimator"}
_AREA_AND_DISTANCE = {**_AREA, "iou": "DIoU"}


class Sort(DetectionOnlyTracker):
    """SORT."""

    kind = "SORTTracker"
    SETTINGS: ClassVar = {
        1: Settings(10, 1, 0.2, 0.95),
        5: Settings(6, 0, 0.01, 0.7, _AREA),
        12: Settings(1, 0, -0.4, 0.95, _AREA_AND_DISTANCE),
    }


class ByteTrack(DetectionOnlyTracker):
    """ByteTrack."""

    kind = "ByteTrackTracker"
    SETTINGS: ClassVar = {
        1: Settings(10, 1, 0.2, 0.3, {**_AREA, "high_conf_det_threshold": 0.9}),
        5: Settings(3, 0, 0.01, 0.7, {**_AREA, "high_conf_det_threshold": 0.3}),
        12: Settings(1, 0, -0.4, 0.95, _AREA_AND_DISTANCE),
    }


class OcSort(DetectionOnlyTracker):
    """OC-SORT."""

    kind = "OCSORTTracker"
    scored = "high_conf_det_threshold"
    SETTINGS: ClassVar = {
        1: Settings(10, 2, 0.1, 0.85),
        5: Settings(2, 0, 0.05, 0.5, {"state_estimator_class": "XYXYStateEstimator"}),
        12: Settings(1, 0, -0.4, 0.7, _AREA_AND_DISTANCE),
    }


class BotSort(DetectionOnlyTracker):
    """BoT-SORT with camera motion compensation, without appearance."""

    kind = "BoTSORTTracker"
    overlapping = "minimum_iou_threshold_first_assoc"
    SETTINGS: ClassVar = {
        1: Settings(10, 1, 0.2, 0.95, _AREA),
        5: Settings(3, 0, 0.01, 0.7),
        12: Settings(1, 0, 0.2, 0.95, {"iou": "DIoU", "high_conf_det_threshold": 0.3}),
    }

    def _predict(self, image: Image) -> None:
        super()._predict(image)
        compensation = self._tracker.cmc
        compensation.apply_batch(compensation.estimate(image), self._tracker.tracks)

    def _correct(self, detections: Any, image: Image) -> None:
        self._tracker.update(detections, image)


def _as_arrays(tracks: list[tuple[int, Any]]) -> FrameTracks:
    ids = np.array([name for name, _ in tracks], dtype=np.intp)
    boxes = np.array([box for _, box in tracks], dtype=np.float64).reshape(-1, 4)
    return FrameTracks(ids, boxes)


TRACKERS: Mapping[str, type[TargetTracker]] = {
    "pf_tracker_ros": MultiTargets,
    "one Tracker a target": SingleTargets,
    "SORT": Sort,
    "ByteTrack": ByteTrack,
    "OC-SORT": OcSort,
    "BoT-SORT": BotSort,
}
"""Name to factory from seed and the detector's interval."""
