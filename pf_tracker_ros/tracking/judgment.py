"""What a frame's measurement is worth, and so what is told of the target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.filter import ParticleSet
from pf_tracker_ros.tracking.track_state import Track


@dataclass(frozen=True, eq=False)
class Judgment:
    """What is told of the target in a frame.

    Attributes:
        box: (4,) of the target, pixels.
        confidence: That it is the target, 0 to 1.
        track: Whether it is seen, and for how long it has not been.
        particles: Told with the box.
        boxes: (N, 4) of them, pixels.
        learns: Whether what is in the box may be learned.
    """

    box: NDArray[np.float64]
    confidence: float
    track: Track
    particles: ParticleSet
    boxes: NDArray[np.float64]
    learns: bool = True
