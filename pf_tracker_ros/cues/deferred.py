"""Cues whose learning costs too much for every frame."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.cues.cue import Cue
from pf_tracker_ros.cues.maps import FrameMaps
from pf_tracker_ros.parameters import declared


class View(NamedTuple):
    """Where to look in the frame at hand.

    Attributes:
        maps: Of that frame.
        box: (4,) x, y, width, height in pixels.
    """

    maps: FrameMaps
    box: NDArray[np.float64]


class DeferredCue(Cue):
    """A cue that only notes where it could learn, and looks there when it does."""

    def observe(self, maps: FrameMaps, box: NDArray[np.float64]) -> View:
        """See `Cue.observe`."""
        return View(maps, box)

    def adopt(self, seen: View) -> Any:
        """See `Cue.adopt`."""
        return self.learn(seen.maps, seen.box)


def declared_training_interval() -> int:
    """The parameter of how seldom such a cue learns."""
    interval: int = declared(
        3,
        "Frames from one training of the filter to the next, each counting for all of them; "
        "fewer trainings cost less.",
        minimum=1,
        maximum=100,
    )
    return interval
