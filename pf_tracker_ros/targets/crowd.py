"""All targets of a camera after a frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.targets.life import Key, Life


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

    def carried(self, camera_motion: NDArray[np.float64]) -> Crowd:
        """The same after the camera has moved, see `Life.carried`."""
        return replace(
            self,
            lives=tuple(life.carried(camera_motion) for life in self.lives),
            gone=tuple(life.carried(camera_motion) for life in self.gone),
        )

    def without(self, key: Key) -> Crowd:
        """The same, without one of them, followed or gone."""
        return replace(
            self,
            lives=tuple(one for one in self.lives if one.key != key),
            gone=tuple(one for one in self.gone if one.key != key),
        )
