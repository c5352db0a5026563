"""All targets of a camera after a frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, overlaps
from pf_tracker_ros.targets.life import Key, Life

SAME_ABOVE = 0.5
"""A target that a late detection has started is the one that was there before if they overlap by
more than this."""


@dataclass(frozen=True, eq=False)
class Crowd:
    """All targets after a frame, a value.

    Attributes:
        frame: Number of that frame.
        lives: The targets that are followed, told or not.
        gone: Those that have ended and are remembered.
        idle_for: Seconds since the detector saw a frame.
        rhythm: Seconds between the last two frames that it saw; infinite before the second.
    """

    frame: int = 0
    lives: tuple[Life, ...] = ()
    gone: tuple[Life, ...] = ()
    idle_for: float = math.inf
    rhythm: float = math.inf

    @property
    def is_heard(self) -> bool:
        """Whether a detector has ever said something."""
        return self.idle_for < math.inf

    @property
    def boxes(self) -> list[Box]:
        """Where the targets are, pixels."""
        return [life.target.estimate.box for life in self.lives]

    def carried(self, camera_motion: NDArray[np.float64]) -> Crowd:
        """The same after the camera has moved, see `Life.carried`."""
        return replace(
            self,
            lives=tuple(life.carried(camera_motion) for life in self.lives),
            gone=tuple(life.carried(camera_motion) for life in self.gone),
        )

    def without(self, stopped: Life) -> Crowd:
        """The same, without one of them, followed or gone.

        Where a late detection has started another one in its place, without that.

        Args:
            stopped: As it was when it was to be forgotten.
        """
        everybody = (*self.lives, *self.gone)
        key = stopped.key
        if all(one.key != key for one in everybody):
            key = _in_place_of(stopped, everybody)
        return replace(
            self,
            lives=tuple(one for one in self.lives if one.key != key),
            gone=tuple(one for one in self.gone if one.key != key),
        )


def _in_place_of(stopped: Life, others: Sequence[Life]) -> Key:
    """The key of the target that a detector started where another one was; else that one's own."""
    started = [one for one in others if not one.by_hand]
    if not started:
        return stopped.key
    same = overlaps(stopped.box[None], np.array([one.box for one in started]))[0]
    best = int(same.argmax())
    return started[best].key if same[best] > SAME_ABOVE else stopped.key
