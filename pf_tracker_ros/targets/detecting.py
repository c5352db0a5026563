"""A detector that looks at frames now and then, in a thread of its own."""

from __future__ import annotations

import contextlib
import os
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.targets.built_in_detectors import Detector
from pf_tracker_ros.targets.detections import Detections
from pf_tracker_ros.targets.track_manager import NOMINAL_INTERVAL

# Other work on the same core comes first.
_NICENESS = 10


class Finding(NamedTuple):
    """What a detector found.

    Attributes:
        detections: In a frame.
        stamp: Of that frame, nanoseconds.
    """

    detections: Detections
    stamp: int


class DetectingThread:
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
        self._working: Future[Finding | None] | None = None
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

    def take(self, *, wait: bool = False) -> Finding | None:
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

    def disregard(self) -> None:
        """Let nothing be found in the frame that is looked at, as where time begins anew."""
        self._is_disregarded = True

    def close(self) -> None:
        """End the thread; a frame that it has not begun to look at stays unseen."""
        self._executor.shutdown(cancel_futures=True)

    def _look(self, image: NDArray[np.generic], stamp: int, interval: float) -> Finding | None:
        detections = self._detector.detect(image, interval)
        return Finding(detections, stamp) if detections is not None else None


def _stand_back() -> None:
    """Let other work come before that of this thread, where the system tells threads apart."""
    with contextlib.suppress(AttributeError, OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)
