"""Confidence intervals of counts, and of means over the seeds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Interval:
    """A figure with its confidence interval.

    Attributes:
        value: The figure; NaN without data.
        low: Lower end.
        high: Upper end.
    """

    value: float
    low: float
    high: float


def share(count: int, total: int, confidence: float = 0.95) -> Interval:
    """Share of runs with Wilson's score interval, valid also for few runs and rare events.

    Args:
        count: Number of runs with the property, 0 to `total`.
        total: Number of runs, at least 1.
        confidence: Confidence level, between 0 and 1.

    Source: Wilson 1927, "Probable inference, the law of succession, and statistical inference".
    """
    z = NormalDist().inv_cdf(0.5 + confidence / 2)
    value = count / total
    scale = 1.0 / (1.0 + z**2 / total)
    middle = scale * (value + z**2 / (2 * total))
    half = scale * z * math.sqrt(value * (1 - value) / total + z**2 / (4 * total**2))
    return Interval(value, max(middle - half, 0.0), min(middle + half, 1.0))


def mean(values: ArrayLike, confidence: float = 0.95, draws: int = 10_000) -> Interval:
    """Mean over runs with the bootstrap's percentile interval.

    Args:
        values: (runs,) one number a run; the interval of none or one is NaN.
        confidence: Confidence level, between 0 and 1.
        draws: Number of resampled means.

    Source: Efron 1979, "Bootstrap methods: another look at the jackknife".
    """
    runs = np.asarray(values, float)
    value = float(runs.mean()) if runs.size else math.nan
    if runs.size < 2:
        return Interval(value, math.nan, math.nan)
    means = np.random.default_rng(0).choice(runs, (draws, runs.size)).mean(axis=1)
    tail = 0.5 - confidence / 2
    low, high = np.quantile(means, (tail, 1 - tail))
    return Interval(value, float(low), float(high))
