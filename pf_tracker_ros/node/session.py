"""What happens to each frame: which start the target, which are tracked, which are dropped.

Knows stamps and arrays, not messages.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.parameters import build
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.tracker import Tracker

Box = tuple[float, float, float, float]
FrameOutcome = Literal["started", "tracked", "duplicate", "late", "waiting"]

NANOSECONDS = 1_000_000_000

# A frame that is older than the last one by at most this came late; by more, time began anew, as
# when a bag starts again.
LATE_WITHIN = NANOSECONDS


@dataclass(frozen=True)
class Outcome:
    """What became of one frame.

    Attributes:
        frame: "started" or "tracked"; "duplicate" or "late" if it was dropped; "waiting" while
            there is no target.
        estimate: The latest estimate, None while there is no target.
        refused_target: Why the target that this frame should have started was refused, or empty.
    """

    frame: FrameOutcome
    estimate: Estimate | None
    refused_target: str = ""


@dataclass(frozen=True)
class _RequestedTarget:
    box: Box
    stamp: int


class Session:
    """Feeds frames with stamps to a tracker.

    Stamps are in nanoseconds; 0 means unknown.

    Args:
        parameters: Full name to value of the tracker's tunables.
        seed: As for `Tracker`.

    Raises:
        ValueError: The parameters contradict each other.
    """

    def __init__(self, parameters: Mapping[str, Any], seed: int) -> None:
        self._tracker = Tracker(build(TrackerParameters, parameters), seed)
        self._seed = seed
        self._requested: _RequestedTarget | None = None
        self._last_stamp = 0

    @property
    def estimate(self) -> Estimate | None:
        """The latest estimate, None while there is no target."""
        return self._tracker.estimate

    @property
    def requested_stamp(self) -> int | None:
        """Stamp of the frame that a requested target waits for, None if there is no such target."""
        return self._requested.stamp if self._requested else None

    def configure(self, parameters: Mapping[str, Any], seed: int) -> None:
        """Change parameters, all or none, keeping the target; the seed counts from the next one.

        Raises:
            ValueError: A parameter is not allowed, they contradict each other, or one is fixed
                while a target is tracked.
        """
        self._tracker.set_parameters(parameters)
        self._seed = seed

    def request(self, box: Box, stamp: int = 0) -> None:
        """Start on a target with the first frame whose stamp is not before `stamp`.

        Args:
            box: (x, y, width, height), pixels.
            stamp: Of the frame that the box was drawn on; 0 for the next frame.
        """
        self._requested = _RequestedTarget(box, stamp)

    def withdraw(self) -> None:
        """Forget a requested target that has not been started."""
        self._requested = None

    def process(self, image: NDArray[np.generic], stamp: int) -> Outcome:
        """Take one frame.

        Args:
            image: As for `Tracker.update`.
            stamp: When it was taken.

        Returns:
            What became of it.

        Raises:
            ValueError: The tracker refuses the image; the target is kept.
        """
        refused_target = ""
        if self._requested and (stamp == 0 or stamp >= self._requested.stamp):
            requested, self._requested = self._requested, None
            try:
                return self._start(image, stamp, requested.box)
            except ValueError as error:
                refused_target = f"target refused: {error}"
        return self._follow(image, stamp, refused_target)

    def _start(self, image: NDArray[np.generic], stamp: int, box: Box) -> Outcome:
        # A tracker of its own for each target: the one before stays as it is if this is refused.
        tracker = Tracker(build(TrackerParameters, self._tracker.parameters), self._seed)
        estimate = tracker.start(image, box)
        self._tracker = tracker
        self._last_stamp = stamp
        return Outcome("started", estimate)

    def _follow(self, image: NDArray[np.generic], stamp: int, refused_target: str) -> Outcome:
        if not self._tracker.started:
            return Outcome("waiting", None, refused_target)
        known = stamp != 0 and self._last_stamp != 0
        elapsed = stamp - self._last_stamp
        if known and elapsed == 0:
            return Outcome("duplicate", self.estimate, refused_target)
        if known and -LATE_WITHIN <= elapsed < 0:
            return Outcome("late", self.estimate, refused_target)
        interval = elapsed / NANOSECONDS if known and elapsed > 0 else None
        estimate = self._tracker.update(image, interval)
        self._last_stamp = stamp
        return Outcome("tracked", estimate, refused_target)
