"""Settings of the umbrella experiment, and the run of a setting on a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scenes.umbrellas import REGION

from pf_tracker_ros import Tracker

PRESET = "li2007"
PAPER_FRAMES = (20, 96, 122, 159)
"""The frames of the paper's Fig. 3, counted from 1."""


@dataclass(frozen=True)
class Setting:
    """One of the paper's experiments.

    Attributes:
        name: Name in the tables.
        alpha: Weight of the color cue; that of the texture cue is 1 - alpha.
        particles: Number of particles.
    """

    name: str
    alpha: float
    particles: int

    def tracker(self, seed: int, overrides: Mapping[str, Any]) -> Tracker:
        """The preset's tracker in this setting, other parameters changed by `overrides`.

        Raises:
            ValueError: A parameter is part of the setting, does not exist or is not allowed.
        """
        parameters = {
            "particles": self.particles,
            "color_histogram.weight": self.alpha,
            "gradient_orientation.weight": 1.0 - self.alpha,
        }
        for name in sorted(parameters.keys() & overrides.keys()):
            raise ValueError(
                f"parameter '{name}' is what the settings differ in; allowed: all but "
                f"{', '.join(parameters)}"
            )
        return Tracker.from_preset(PRESET, seed=seed, parameters={**parameters, **overrides})


SETTINGS = (
    Setting("color alone, N = 60", 1.0, 60),
    Setting("color + texture, N = 30", 0.6, 30),
    Setting("color + texture, N = 60", 0.6, 60),
)


@dataclass(frozen=True)
class Run:
    """Run of a setting on a scene.

    Attributes:
        setting: Name of the setting.
        seed: Seed of the scene and of the tracker.
        outcome: "held", "switched" or "lost", as `umbrellas.outcome` has it.
        errors: (frames,) distance of the estimate's center from the target's, px.
        error_before: Median of the errors in the second before the umbrellas' boxes first touch.
        jitter: As in `umbrellas.jitter`, px.
        milliseconds: Median CPU time of one update.
        snapshots: Per frame of `PAPER_FRAMES`: estimated box (4,), particles' boxes (N, 4) and
            weights (N,).
    """

    setting: str
    seed: int
    outcome: str
    errors: NDArray[np.float64]
    error_before: float
    jitter: float
    milliseconds: float
    snapshots: tuple[tuple[NDArray[np.float64], ...], ...]

    @property
    def true_switch(self) -> bool:
        """Whether it switched from the target itself, not after an earlier loss."""
        return self.outcome == "switched" and self.error_before <= REGION / 2

    @property
    def mean_error(self) -> float:
        """Center error averaged over the frames, px."""
        return float(self.errors.mean())
