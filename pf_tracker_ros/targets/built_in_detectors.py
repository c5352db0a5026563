"""Detectors that need no network and no model file: people, and whatever moves."""

from __future__ import annotations

import contextlib
import os
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import pairwise_iou
from pf_tracker_ros.frames import Frame
from pf_tracker_ros.registry import Registry
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.detections import Detections
from pf_tracker_ros.targets.track_manager import NOMINAL_INTERVAL, default_numpy_errors
from pf_tracker_ros.tracking.image_front_end import ImageFrontEnd
from pf_tracker_ros.tracking.input_checks import check_image

# The window of the people detector has a margin around the person: shares of its width and height
# at each side. With these, its boxes overlap those of PETS09-S2L1 and TUD-Stadtmitte most.
_MARGIN_ACROSS, _MARGIN_DOWN = 0.25, 0.125
# From one size that is looked for to the next.
_SIZE_STEP = 1.1
# How fast the share of right ones rises with the people detector's own score.
_SCORE_RATE = 2.0

# What moves is cleaned with this kernel, in pixels of the background model; the smallest side that
# counts, as a share of its height. With these, most boxes are right on PETS09-S2L1.
_KERNEL = np.ones((3, 3), np.uint8)
_SMALLEST = 0.04
# What has left the place where it first stood leaves a hole in the background, which looks like an
# object that stands still. So of what is found anew, this share must have changed since the last
# image by so many gray levels; and what overlaps what was found before by more than that is it.
_LEAST_CHANGED, _CHANGE = 0.02, 20
_SAME_ABOVE = 0.3


class Detector(Protocol):
    """Finds objects in images."""

    def detect(
        self, image: NDArray[np.generic], interval: float = NOMINAL_INTERVAL
    ) -> Detections | None:
        """What is found in an image.

        Args:
            image: As for `Tracker.start`, of any size and kind.
            interval: Seconds since the last one.

        Returns:
            The detections, of age 0; None where the detector cannot say.

        Raises:
            ValueError: It is no image.
        """


DETECTORS = Registry[Detector](
    "detector", group="pf_tracker_ros.detectors", prefix="built_in_detectors.{part}."
)


@DETECTORS.register("people")
class PeopleDetector:
    """People who stand or walk and are at least 100 px high, by OpenCV's HOG detector.

    It takes about 0.1 s for an image of 640 x 480 on one core. Sources: Dalal, Triggs 2005,
    "Histograms of oriented gradients for human detection"; OpenCV's `HOGDescriptor`.

    Raises:
        ValueError: This OpenCV has no such detector.
    """

    def __init__(self) -> None:
        if not hasattr(cv2, "HOGDescriptor"):
            raise ValueError(
                f"OpenCV {cv2.__version__} has no people detector; use one of OpenCV 4"
            )
        self._hog = cv2.HOGDescriptor()
        people = cv2.HOGDescriptor_getDefaultPeopleDetector()  # type: ignore[attr-defined]
        self._hog.setSVMDetector(people)
        self._eye = _Eye(0, needs_foreground=False)

    def detect(self, image: NDArray[np.generic], interval: float = NOMINAL_INTERVAL) -> Detections:
        """See `Detector.detect`; the label is "person"."""
        frame = self._eye.prepare(image, interval)
        width, height = self._hog.winSize
        if frame.size[0] < width or frame.size[1] < height:
            return Detections([])
        windows, weights = self._hog.detectMultiScale(
            frame.pixels, winStride=(8, 8), padding=(8, 8), scale=_SIZE_STEP
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
    """Whatever moves before a camera that stands still, by the background model.

    The first images teach it the background. What has moved and stands still is found for as long
    as it is no part of that.

    Args:
        seed: Seeds the background model.
    """

    def __init__(self, seed: int = 0) -> None:
        self._eye = _Eye(seed, needs_foreground=True)
        self._last: NDArray[np.uint8] | None = None
        self._found = np.zeros((0, 4))

    def detect(
        self, image: NDArray[np.generic], interval: float = NOMINAL_INTERVAL
    ) -> Detections | None:
        """See `Detector.detect`; the label is "moving", the score the share of it that moves."""
        frame = self._eye.prepare(image, interval)
        if self._eye.is_new:
            self._last, self._found = None, np.zeros((0, 4))
        if frame.foreground is None or frame.background is None or frame.background.name != "ready":
            return None
        mask, reduction = frame.foreground
        changed = self._changed(frame, mask)
        boxes, scores = [], []
        for place in _clusters(mask):
            x, y, width, height = place
            part = np.s_[y : y + height, x : x + width]
            is_known = pairwise_iou(place[None], self._found).max(initial=0.0) > _SAME_ABOVE
            if is_known or np.mean(changed[part]) > _LEAST_CHANGED:
                boxes.append(place)
                scores.append(float(np.mean(mask[part] > 0)))
        self._found = np.array(boxes, dtype=np.float64).reshape(-1, 4)
        return Detections(self._found * float(reduction), scores, ["moving"] * len(boxes))

    def _changed(self, frame: Frame, mask: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """(h, w) what has changed since the last image, in the pixels of the mask."""
        pixels, last = frame.pixels, self._last
        gray = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
        size = (mask.shape[1], mask.shape[0])
        self._last = now = cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
        if last is None or last.shape != now.shape:
            return np.zeros(mask.shape, dtype=np.bool_)
        changed: NDArray[np.bool_] = cv2.absdiff(now, last) > _CHANGE
        return changed


def _clusters(mask: NDArray[np.uint8]) -> NDArray[np.intp]:
    """(K, 4) boxes x, y, width, height of what hangs together in a mask, in its pixels."""
    whole = cv2.morphologyEx(mask, cv2.MORPH_OPEN, _KERNEL)
    whole = cv2.morphologyEx(whole, cv2.MORPH_CLOSE, _KERNEL)
    _, _, found, _ = cv2.connectedComponentsWithStats(whole)
    # The first is the background.
    sides = np.minimum(found[1:, 2], found[1:, 3])
    clusters: NDArray[np.intp] = found[1:, :4][sides >= max(_SMALLEST * mask.shape[0], 3)]
    return clusters


class _Eye:
    """Makes frames of images, and begins anew where they are of another size or kind.

    Attributes:
        is_new: Whether it has begun with the last image.

    Args:
        seed: Seeds the background model.
        needs_foreground: Whether there is one.
    """

    def __init__(self, seed: int, needs_foreground: bool) -> None:
        self._seed, self._needs_foreground = seed, needs_foreground
        self._front_end = ImageFrontEnd(seed, removes_ghosts=True)
        self.is_new = False

    def prepare(self, image: NDArray[np.generic], interval: float) -> Frame:
        check_image(image)
        self.is_new = self._front_end.frame is None or not self._front_end.accepts_image(image)
        if self.is_new:
            self._front_end = ImageFrontEnd(self._seed, removes_ghosts=True)
        frame = Frame(image)
        with default_numpy_errors():
            self._front_end.prepare(frame, interval, (), self._needs_foreground, follow_light=False)
        self._front_end.commit(frame)
        return frame


# Other work on the same core comes first.
_NICENESS = 10


class DetectorResult(NamedTuple):
    """What a detector found.

    Attributes:
        detections: In a frame.
        stamp: Of that frame, nanoseconds.
    """

    detections: Detections
    stamp: int


class DetectorThread:
    """Shows a detector a frame now and then, without waiting for what it says.

    Frames that come while it is busy are none of its business, so it may look at fewer than the
    rate asks for. Which frames it looks at, and when it answers, depends on the machine.

    Args:
        detector: Looks at the frames, in the thread.
        rate: Most frames that it looks at in a second of their stamps; of those without stamps it
            takes whichever comes when it has nothing to do.
    """

    def __init__(self, detector: Detector, rate: float) -> None:
        self._detector = detector
        self._spacing = NANOSECONDS / rate
        self._last = 0
        self._working: Future[DetectorResult | None] | None = None
        self._is_disregarded = False
        self._executor = ThreadPoolExecutor(
            1, thread_name_prefix="detector", initializer=_stand_back
        )

    def offer(self, image: NDArray[np.generic], stamp: int) -> bool:
        """Show a frame, if one is due and the last one has been answered and taken.

        Args:
            image: Not to be changed from then on.
            stamp: When it was taken, in nanoseconds; 0 means unknown.

        Returns:
            Whether it is looked at.
        """
        elapsed = stamp - self._last
        known = stamp != 0 and self._last != 0
        if self._working or (known and 0 <= elapsed < self._spacing):
            return False
        interval = elapsed / NANOSECONDS if known and elapsed > 0 else NOMINAL_INTERVAL
        self._last, self._is_disregarded = stamp, False
        self._working = self._executor.submit(self._look, image, stamp, interval)
        return True

    def take(self, *, wait: bool = False) -> DetectorResult | None:
        """What was found in the last frame that was looked at; None if nothing new is known.

        Args:
            wait: Whether to wait for it.

        Raises:
            Exception: Whatever the detector raised.
        """
        working = self._working
        if working is None or not (wait or working.done()):
            return None
        self._working = None
        found = working.result()
        return None if self._is_disregarded else found

    def discard_pending(self) -> None:
        """Let nothing be found in the frame that is looked at, as where time begins anew."""
        self._is_disregarded = True

    def close(self) -> None:
        """End the thread; a frame that it has not begun to look at stays unseen."""
        self._executor.shutdown(cancel_futures=True)

    def _look(
        self, image: NDArray[np.generic], stamp: int, interval: float
    ) -> DetectorResult | None:
        detections = self._detector.detect(image, interval)
        return DetectorResult(detections, stamp) if detections is not None else None


def _stand_back() -> None:
    """Let other work come before that of this thread, where the system tells threads apart."""
    with contextlib.suppress(AttributeError, OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)
