"""Detectors without a neural network: people (HOG) and motion (background subtraction)."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from queue import SimpleQueue
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import pairwise_iou
from pf_tracker_ros.foreign_code import ForeignError, foreign_code
from pf_tracker_ros.frames import Frame, check_image
from pf_tracker_ros.parameters import quoted
from pf_tracker_ros.registry import Registry
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.detections import Detections, StampedDetections
from pf_tracker_ros.tracking.frame_clock import NOMINAL_INTERVAL
from pf_tracker_ros.tracking.image_front_end import ImageFrontEnd
from pf_tracker_ros.tracking.target_filter import default_numpy_errors

# Margin of the HOG window around a person, as shares of its width and height at each side. These
# give the largest overlap with the boxes of PETS09-S2L1 and TUD-Stadtmitte.
_MARGIN_ACROSS, _MARGIN_DOWN = 0.25, 0.125
# Ratio between neighboring scales of the search for people.
_SCALE_STEP = 1.1
# Rate at which precision rises with the weight of the support vector machine.
_SCORE_RATE = 2.0

# Kernel of the morphological filter, in pixels of the foreground mask, and the smallest side of an
# object as a share of the mask's height. These give the most correct boxes on PETS09-S2L1.
_KERNEL = np.ones((3, 3), np.uint8)
_MIN_SIDE = 0.04
# An object that was part of the first background leaves a ghost when it moves away. So at least
# this share of a new object must have changed by this number of gray levels since the last image.
_MIN_CHANGED, _CHANGED_ABOVE = 0.02, 20
# An object that overlaps a former one by more than this (intersection over union) is not new.
_KNOWN_ABOVE = 0.3


class Detector(Protocol):
    """Finds objects in images."""

    def detect(
        self, image: NDArray[np.generic], interval: float = NOMINAL_INTERVAL
    ) -> Detections | None:
        """Detect objects in an image.

        Args:
            image: As for `Tracker.start`, of any size and type.
            interval: Seconds since the last image.

        Returns:
            The detections, of age 0; None if the detector is not ready.

        Raises:
            ValueError: The image is invalid.
        """


DETECTORS = Registry[Detector](
    "detector", group="pf_tracker_ros.detectors", prefix="built_in_detectors.{part}."
)


@DETECTORS.register("people")
class PeopleDetector:
    """Detects people who stand or walk and are at least 100 px high, by OpenCV's HOG detector.

    1. Histograms of oriented gradients describe windows of 64 x 128 px at several scales.
    2. A linear support vector machine classifies each window.
    3. The score of a window of weight w is 1 - exp(-2 w).

    Takes about 0.1 s for 640 x 480 on one core. Sources: Dalal, Triggs 2005, "Histograms of
    oriented gradients for human detection"; OpenCV's `HOGDescriptor`.

    Raises:
        ValueError: This version of OpenCV has no such detector.
    """

    def __init__(self) -> None:
        if not hasattr(cv2, "HOGDescriptor"):
            raise ValueError(
                f"OpenCV {cv2.__version__} has no people detector; use one of OpenCV 4"
            )
        self._hog = cv2.HOGDescriptor()
        people = cv2.HOGDescriptor_getDefaultPeopleDetector()  # type: ignore[attr-defined]
        self._hog.setSVMDetector(people)
        self._frames = _FrameSource(0, needs_foreground=False)

    def detect(self, image: NDArray[np.generic], interval: float = NOMINAL_INTERVAL) -> Detections:
        """See `Detector.detect`; the label is "person"."""
        frame = self._frames.prepare(image, interval)
        width, height = self._hog.winSize
        if frame.size[0] < width or frame.size[1] < height:
            return Detections([])
        windows, weights = self._hog.detectMultiScale(
            frame.pixels, winStride=(8, 8), padding=(8, 8), scale=_SCALE_STEP
        )
        if len(windows) == 0:
            return Detections([])
        inset = np.array([_MARGIN_ACROSS, _MARGIN_DOWN])
        boxes = np.asarray(windows, dtype=np.float64)
        sides = boxes[:, 2:]
        boxes = np.hstack([boxes[:, :2] + inset * sides, (1.0 - 2.0 * inset) * sides])
        scores = 1.0 - np.exp(-_SCORE_RATE * np.maximum(np.ravel(weights), 0.0))
        return Detections(boxes, scores, ["person"] * len(boxes))


@DETECTORS.register("motion")
class MotionDetector:
    """Detects whatever moves in front of a static camera, by background subtraction.

    1. The background model (`BackgroundModel`) marks the foreground; the first images train it.
    2. Morphological opening and closing clean the foreground mask.
    3. Each connected component is a candidate.
    4. A candidate is detected if it overlaps a former detection, or has changed since the last
       image.

    An object that stops is detected until it is part of the background.
    """

    def __init__(self, seed: int = 0) -> None:
        self._frames = _FrameSource(seed, needs_foreground=True)
        self._last: NDArray[np.uint8] | None = None
        self._boxes = np.zeros((0, 4))

    def detect(
        self, image: NDArray[np.generic], interval: float = NOMINAL_INTERVAL
    ) -> Detections | None:
        """See `Detector.detect`; label "moving", score the foreground's share of the box."""
        frame = self._frames.prepare(image, interval)
        if self._frames.is_new:
            self._last, self._boxes = None, np.zeros((0, 4))
        if frame.foreground is None or frame.background is None or frame.background.name != "ready":
            return None
        mask, reduction = frame.foreground
        changed = self._changed(frame, mask)
        boxes, scores = [], []
        for box in _component_boxes(mask):
            x, y, width, height = box
            part = np.s_[y : y + height, x : x + width]
            is_known = pairwise_iou(box[None], self._boxes).max(initial=0.0) > _KNOWN_ABOVE
            if is_known or np.mean(changed[part]) > _MIN_CHANGED:
                boxes.append(box)
                scores.append(float(np.mean(mask[part] > 0)))
        self._boxes = np.array(boxes, dtype=np.float64).reshape(-1, 4)
        return Detections(self._boxes * float(reduction), scores, ["moving"] * len(boxes))

    def _changed(self, frame: Frame, mask: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """(h, w) pixels of the mask that have changed since the last image."""
        pixels, last = frame.pixels, self._last
        gray = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
        size = (mask.shape[1], mask.shape[0])
        self._last = now = cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
        if last is None or last.shape != now.shape:
            return np.zeros(mask.shape, dtype=np.bool_)
        return cv2.absdiff(now, last) > _CHANGED_ABOVE


def _component_boxes(mask: NDArray[np.uint8]) -> NDArray[np.intp]:
    """(K, 4) boxes x, y, width, height of a mask's connected components, in its pixels."""
    cleaned = cv2.morphologyEx(mask, cv2.MORPH_OPEN, _KERNEL)
    cleaned = cv2.morphologyEx(cleaned, cv2.MORPH_CLOSE, _KERNEL)
    _, _, components, _ = cv2.connectedComponentsWithStats(cleaned)
    # The first component is the background.
    sides = np.minimum(components[1:, 2], components[1:, 3])
    return components[1:, :4][sides >= max(_MIN_SIDE * mask.shape[0], 3)]


class _FrameSource:
    """Prepares frames from images; resets when their size or type changes.

    Attributes:
        is_new: Whether the last image was the first one or caused a reset.
    """

    def __init__(self, seed: int, needs_foreground: bool) -> None:
        self._new_front_end = partial(
            ImageFrontEnd, seed, needs_foreground=needs_foreground, removes_ghosts=True
        )
        self._front_end = self._new_front_end()
        self.is_new = False

    def prepare(self, image: NDArray[np.generic], interval: float) -> Frame:
        check_image(image)
        self.is_new = self._front_end.frame is None or not self._front_end.accepts_image(image)
        if self.is_new:
            self._front_end = self._new_front_end()
        frame = Frame(image)
        with default_numpy_errors():
            self._front_end.prepare(frame, interval, ())
        self._front_end.commit(frame)
        return frame


# Lets the threads that track come first.
_NICENESS = 10
# Seconds that the end of the thread waits for a running detection.
_PATIENCE = 10.0


class DetectorThread:
    """Runs a detector on some frames in a thread, so that tracking does not wait for it.

    Frames are ignored while the detector is busy. Which frames it processes, and when results
    arrive, depends on the speed of the machine.

    Args:
        detector: Runs in the thread.
        rate: Most frames per second of their stamps; frames without stamps are not limited.
    """

    def __init__(self, detector: Detector, rate: float) -> None:
        self._detector = detector
        self._spacing = NANOSECONDS / rate
        self._last = 0
        self._pending: Future[StampedDetections | None] | None = None
        self._is_discarded = False
        self._tasks: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        # The end of the process does not wait for a detector without an end.
        self._thread = threading.Thread(target=self._work, name="detector", daemon=True)
        self._thread.start()

    def offer(self, image: NDArray[np.generic], stamp: int) -> bool:
        """Start detection, if one is due and the last result was taken; whether it starts.

        The image must not change afterwards. Its stamp is in nanoseconds, 0 if unknown.
        """
        elapsed = stamp - self._last
        known = stamp != 0 and self._last != 0
        if self._pending or (known and 0 <= elapsed < self._spacing):
            return False
        interval = elapsed / NANOSECONDS if known and elapsed > 0 else NOMINAL_INTERVAL
        self._last, self._is_discarded = stamp, False
        self._pending = Future()
        self._tasks.put(partial(self._detect, self._pending, image, stamp, interval))
        return True

    def take(self, *, wait: bool = False) -> StampedDetections | None:
        """Take the last result, each once; None if there is no new one.

        `wait` waits for a running detection.

        Raises:
            ForeignError: The detector has failed.
        """
        pending = self._pending
        if pending is None or not (wait or pending.done()):
            return None
        self._pending = None
        result = pending.result()
        return None if self._is_discarded else result

    def discard_pending(self) -> None:
        """Discard the result of the running detection, as after a jump of time."""
        self._is_discarded = True

    def close(self) -> None:
        """End the thread, after a running detection, for which it does not wait long."""
        self._tasks.put(None)
        self._thread.join(_PATIENCE)

    def _work(self) -> None:
        _lower_priority()
        while task := self._tasks.get():
            task()

    def _detect(
        self,
        outcome: Future[StampedDetections | None],
        image: NDArray[np.generic],
        stamp: int,
        interval: float,
    ) -> None:
        try:
            # The detector may be of another package.
            with foreign_code():
                detections = self._detector.detect(image, interval)
                if detections is not None and not isinstance(detections, Detections):
                    raise TypeError(
                        f"it returned {quoted(detections)}; allowed: Detections or None"
                    )
            result = StampedDetections(detections, stamp) if detections is not None else None
            outcome.set_result(result)
        except ForeignError as error:
            outcome.set_exception(error)


def _lower_priority() -> None:
    """Lower the priority of this thread, where the system supports it."""
    with contextlib.suppress(AttributeError, OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)
