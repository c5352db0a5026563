"""Comparison of two settings, paired by sequence and seed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_CONFIDENCE = 0.95


def seed_error(gains: NDArray[np.float64]) -> float:
    """Standard error of the mean gain that is due to the seeds; 0 for a single seed.

    Args:
        gains: (sequences, seeds).
    """
    sequences, seeds = gains.shape
    if seeds < 2:
        return 0.0
    return math.sqrt(float(gains.var(axis=1, ddof=1).sum()) / seeds) / sequences


@dataclass(frozen=True, eq=False)
class Comparison:
    """Scores of a preset and of tuned values on the same sequences with the same seeds.

    The interval treats the sequences as a sample of the footage. Their differences contain those of
    the seeds.

    Attributes:
        names: Names of the sequences, at least two.
        preset: (sequences, seeds) of the preset, such as success AUCs; more is better.
        tuned: (sequences, seeds) of the tuned values.
    """

    names: Sequence[str]
    preset: NDArray[np.float64]
    tuned: NDArray[np.float64]

    @property
    def gain(self) -> float:
        """Mean gain."""
        return float(self._gains.mean())

    @property
    def seed_error(self) -> float:
        """Standard error of the mean gain that is due to the seeds."""
        return seed_error(self._gains)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval of the mean gain on such footage, by Student's t."""
        from scipy import stats

        means = self._gains.mean(axis=1)
        error = means.std(ddof=1) / math.sqrt(len(means))
        half = float(stats.t.ppf(0.5 + _CONFIDENCE / 2, len(means) - 1)) * error
        return self.gain - half, self.gain + half

    @property
    def is_significant(self) -> bool:
        """Whether the interval of the gain is above 0."""
        return self.interval[0] > 0.0

    @property
    def rows(self) -> list[tuple[str, float, float]]:
        """Name and the two mean scores of each sequence."""
        before, after = self.preset.mean(axis=1), self.tuned.mean(axis=1)
        return list(zip(self.names, before.tolist(), after.tolist(), strict=True))

    @property
    def _gains(self) -> NDArray[np.float64]:
        return self.tuned - self.preset
