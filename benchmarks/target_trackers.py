"""Trackers of several targets behind one interface, for the comparison in `targets.py`."""

from __future__ import annotations

import importlib
from abc import abstractmethod
from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros import Detections, MultiTracker, Tracker
from pf_tracker_ros.targets.geometry import overlaps

Answer = tuple[NDArray[np.intp], NDArray[np.float64]]


class TargetTracker(Protocol):
    """A tracker of several targets, made for one sequence.

    Attributes:
        package: What it needs of Python's; an empty text for none.
    """

    package: ClassVar[str] = ""

    @classmethod
    def missing(cls) -> str:
        """What to do before it can run; empty if nothing."""
        is_there = not cls.package or find_spec(cls.package) is not None
        return "" if is_there else f"{cls.package} is not installed"

    @abstractmethod
    def update(
        self, image: NDArray[np.uint8], interval: float, seen: NDArray[np.float64] | None
    ) -> Answer:
        """The (K,) ids and (K, 4) boxes in the next frame.

        Args:
            image: (H, W, 3) BGR.
            interval: Seconds since the last one.
            seen: (M, 5) boxes and scores of a detector; None where it did not run.
        """


class Several(TargetTracker):
    """`MultiTracker`, as it is shipped.

    Args:
        interval: Seconds from one frame to the next.
        seed: Of its randomness.
    """

    def __init__(self, interval: float, seed: int = 0) -> None:
        self._tracker = MultiTracker.from_preset("default", seed)

    def update(
        self, image: NDArray[np.uint8], interval: float, seen: NDArray[np.float64] | None
    ) -> Answer:
        """See `TargetTracker.update`."""
        detections = None if seen is None else Detections(seen[:, :4], seen[:, 4])
        told = self._tracker.update(image, interval, detections)
        return _answer([(target.id, target.estimate.box) for target in told])


class OneEach(TargetTracker):
    """The plainest combination: a `Tracker` a target.

    It starts on a detection that none is on, ends where a frame that was seen has none for it, and
    starts anew where it has strayed from its own.

    Args:
        interval: Seconds from one frame to the next.
        seed: Of the randomness of each.
    """

    SAME_ABOVE = 0.3
    STRAYED_BELOW = 0.6

    def __init__(self, interval: float, seed: int = 0) -> None:
        self._seed = seed
        self._trackers: dict[int, Tracker] = {}
        self._last = 0

    def update(
        self, image: NDArray[np.uint8], interval: float, seen: NDArray[np.float64] | None
    ) -> Answer:
        """See `TargetTracker.update`."""
        for tracker in self._trackers.values():
            tracker.update(image, interval)
        if seen is not None:
            self._assign(image, seen[:, :4])
        return _answer([(name, one.estimate.box) for name, one in self._trackers.items()])

    def _assign(self, image: NDArray[np.uint8], boxes: NDArray[np.float64]) -> None:
        assign = importlib.import_module("scipy.optimize").linear_sum_assignment
        names = list(self._trackers)
        places = np.array([self._trackers[name].estimate.box for name in names]).reshape(-1, 4)
        shared = overlaps(places, boxes)
        kept, used = {}, set()
        for row, column in zip(*assign(-shared), strict=True):
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

    def _start(self, tracker: Tracker, image: NDArray[np.uint8], box: NDArray[np.float64]) -> bool:
        try:
            tracker.start(image, box)
        except ValueError:
            return False
        return True


class _Roboflow(TargetTracker):
    """One of the package `trackers`, its settings scaled to the detector's interval by itself.

    Its Kalman filter's prediction gives the boxes between detections.

    Args:
        interval: Seconds from one frame to the next.
        seed: Makes no difference.
    """

    package = "trackers"
    kind: ClassVar[str]

    def __init__(self, interval: float, seed: int = 0) -> None:
        module = importlib.import_module("trackers")
        self._tracker = getattr(module, self.kind)(
            lost_track_buffer=30, minimum_consecutive_frames=1, frame_rate=1.0 / interval
        )
        self._detections = importlib.import_module("supervision").Detections

    @classmethod
    def missing(cls) -> str:
        """See `TargetTracker.missing`."""
        if what := super().missing():
            return what
        has_it = hasattr(importlib.import_module(cls.package), cls.kind)
        return "" if has_it else f"this version of {cls.package} has no {cls.kind}"

    def update(
        self, image: NDArray[np.uint8], interval: float, seen: NDArray[np.float64] | None
    ) -> Answer:
        """See `TargetTracker.update`."""
        if seen is None:
            for track in self._tracks():
                track.predict()
        else:
            corners = np.hstack([seen[:, :2], seen[:, :2] + seen[:, 2:4]])
            self._tracker.update(
                self._detections(corners, confidence=seen[:, 4], class_id=np.zeros(len(seen), int))
            )
        told = [
            (track.tracker_id, track.get_state_bbox())
            for track in self._tracks()
            if track.tracker_id >= 0
        ]
        return _answer([(name, (*box[:2], *(box[2:] - box[:2]))) for name, box in told])

    def _tracks(self) -> list[Any]:
        name = "trackers" if hasattr(self._tracker, "trackers") else "tracks"
        return list(getattr(self._tracker, name))


class Sort(_Roboflow):
    """SORT."""

    kind = "SORTTracker"


class ByteTrack(_Roboflow):
    """ByteTrack."""

    kind = "ByteTrackTracker"


class OcSort(_Roboflow):
    """OC-SORT."""

    kind = "OCSORTTracker"


class Norfair(TargetTracker):
    """norfair, by the overlap of boxes.

    Args:
        interval: Seconds from one frame to the next.
        seed: Makes no difference.
    """

    package = "norfair"

    def __init__(self, interval: float, seed: int = 0) -> None:
        self._norfair = importlib.import_module(self.package)
        self._tracker = self._norfair.Tracker(
            distance_function="iou",
            distance_threshold=0.7,
            initialization_delay=0,
            hit_counter_max=30,
        )
        self._idle = 0

    def update(
        self, image: NDArray[np.uint8], interval: float, seen: NDArray[np.float64] | None
    ) -> Answer:
        """See `TargetTracker.update`."""
        self._idle += 1
        if seen is None:
            told = self._tracker.update()
        else:
            found = [
                self._norfair.Detection(np.array([box[:2], box[:2] + box[2:4]])) for box in seen
            ]
            told = self._tracker.update(found, period=self._idle)
            self._idle = 0
        return _answer(
            [
                (one.id, (*one.estimate[0], *(one.estimate[1] - one.estimate[0])))
                for one in told
                if one.id is not None
            ]
        )


def _answer(told: list[tuple[int, Any]]) -> Answer:
    ids = np.array([name for name, _ in told], dtype=np.intp)
    return ids, np.array([box for _, box in told], dtype=np.float64).reshape(-1, 4)


TRACKERS: Mapping[str, type[TargetTracker]] = {
    "pf_tracker_ros": Several,
    "one Tracker a target": OneEach,
    "SORT": Sort,
    "ByteTrack": ByteTrack,
    "OC-SORT": OcSort,
    "norfair": Norfair,
}
"""Name to what makes one of the seconds between frames and a seed."""
