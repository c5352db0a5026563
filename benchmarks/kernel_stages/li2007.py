"""An `update` of `li2007` compared with the same measurement in a loop over particles."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median

import numpy as np

from kernel_stages.particle_loop import ParticleLoop
from kernel_stages.setting import Setting
from kernel_stages.timing import each_call
from pf_tracker_ros import Tracker

# The first call of a turn finds the caches full of the other's data and is not counted.
_CALLS_IN_A_TURN = 6
# Position noise, box sizes, that spreads the particles of a box of 40 px so far, as standard
# deviation of their places.
_NOISES = {"8 px": 1.0, "whole image": 50.0}
# More is not allowed, and need not be.
_MOST_NOISE = 50.0
CLOUDS = tuple(_NOISES)
_SIDE = 40


@dataclass(frozen=True)
class Row:
    """Median milliseconds of one setting.

    Attributes:
        particles: Their number.
        side: Of the box, pixels.
        cloud: One of `CLOUDS`.
        spread: Standard deviation of the particles' places, pixels.
        update: Of the library.
        loop: Particle by particle, None where it was not measured.
    """

    particles: int
    side: int
    cloud: str
    spread: float
    update: float
    loop: float | None

    @property
    def ratio(self) -> float | None:
        """How many times as long the loop takes."""
        return None if self.loop is None else self.loop / self.update


def measure_li2007(particles: int, side: int, cloud: str, turns: int, *, against_loop: bool) -> Row:
    """Time one setting; the target stands still, and so does the cloud around it."""
    setting = Setting(side=side, particles=particles)
    parameters = {
        "particles": particles,
        "track.wrong_box_cost": 0.0,
        "motion.position_noise": min(_NOISES[cloud] * _SIDE / side, _MOST_NOISE),
    }
    tracker = Tracker.from_preset("li2007", seed=0, parameters=parameters)
    tracker.start(setting.image, setting.box)
    loop = ParticleLoop(setting.image, tuple(setting.box.astype(int)))
    updates, loops, spreads = [], [], []
    for _ in range(turns):
        updates += each_call(lambda: tracker.update(setting.image), _CALLS_IN_A_TURN)[1:]
        estimate = tracker.estimate
        assert estimate is not None
        corners = estimate.particle_boxes[:, :2]
        spreads.append(float(corners.std(axis=0).mean()))
        if against_loop:
            whole = np.rint(corners).astype(np.intp).clip(0, np.array(setting.size) - side)
            call = lambda at=whole: loop.weights(setting.image, at)  # noqa: E731
            loops += each_call(call, _CALLS_IN_A_TURN)[1:]
    return Row(
        particles, side, cloud, median(spreads), median(updates), median(loops) if loops else None
    )
