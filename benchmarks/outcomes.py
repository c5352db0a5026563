"""Results of several trackers, or settings of one, on the same sequences."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.evaluation import Scores, SequenceResult, mean_scores

_SCORES = ("frames", "seeds", "success_auc", "success_auc_std", "precision_20px")


@dataclass(frozen=True)
class Outcome:
    """Results of a contender on all sequences.

    Attributes:
        name: Name of the tracker or setting.
        results: A result for each sequence, at least one.
    """

    name: str
    results: Sequence[SequenceResult]

    @property
    def scores(self) -> Scores:
        """Means over the sequences."""
        return mean_scores(self.results)

    @property
    def deviation(self) -> float:
        """Standard deviation of the success AUC over the seeds, mean over the sequences.

        NaN for a single seed.
        """
        return float(np.mean([result.success_auc_std for result in self.results]))

    @property
    def success_aucs(self) -> NDArray[np.float64]:
        """(sequences,) success AUC, each the mean over the seeds."""
        return np.array([result.scores.success_auc for result in self.results])

    @property
    def success_curve(self) -> NDArray[np.float64]:
        """(21,) success curve, mean over the sequences."""
        return np.mean([result.success_curve for result in self.results], axis=0)


def write_csv(path: Path, kind: str, outcomes: Sequence[Outcome], yardstick: str) -> None:
    """Write a line for each contender and sequence.

    Args:
        path: The file.
        kind: Kind of the contenders; heading of the column with their names.
        outcomes: The contenders' results on the same sequences.
        yardstick: Name of the contender whose CPU time the others' are divided by; the column of
            the ratio is empty where it is none of them.
    """
    known = {outcome.name: outcome for outcome in outcomes}
    times = np.full(len(outcomes[0].results), np.nan)
    if yardstick in known:
        times = np.array([one.scores.cpu_ms_median for one in known[yardstick].results])
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([kind, "sequence", *_SCORES, "cpu_ms_median", f"cpu_ratio_to_{yardstick}"])
        for outcome in outcomes:
            for result, time in zip(outcome.results, times, strict=True):
                scores = result.scores
                figures = (
                    scores.success_auc,
                    result.success_auc_std,
                    scores.precision_20px,
                    scores.cpu_ms_median,
                    scores.cpu_ms_median / time,
                )
                counts = [scores.frames, len(result.seeds)]
                texts = [figure(value, ".4f", unknown="") for value in figures]
                writer.writerow([outcome.name, result.name, *counts, *texts])


def figure(value: float, form: str, unknown: str = "-") -> str:
    """A number as text; NaN as `unknown`."""
    return unknown if np.isnan(value) else format(value, form)
