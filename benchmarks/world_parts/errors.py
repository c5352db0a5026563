"""Errors of estimates, and whether their covariances are true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from pf_tracker_ros.tuning.confidence import LabeledConfidences, roc_area
from pf_tracker_ros.world import Place

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of N estimates with D dimensions."""

    sizes: Array  # (N,) errors, meters or relative
    nees: Array  # (N,) squared errors in standard deviations
    dimensions: int  # d

    @classmethod
    def of(cls, errors: Array, covariances: Array, scale: Array | float = 1.0) -> Errors:
        """From (N, D) errors, (N, D, D) covariances, and what the sizes are divided by."""
        solved = np.linalg.solve(covariances, errors[:, :, None])[:, :, 0]
        sizes = np.linalg.norm(errors, axis=1) / scale
        return cls(sizes, (errors * solved).sum(axis=1), errors.shape[1])

    def cells(self, factor: float = 1.0, digits: int = 2) -> list[str]:
        """Number, median, 90 %, NEES, and inside."""
        if not len(self.sizes):
            return ["0", "-", "-", "-", "-"]
        inside = (self.nees < chi2.ppf(0.9, self.dimensions)).mean()
        median, ninety = np.percentile(self.sizes, (50, 90)) * factor
        return [
            str(len(self.sizes)),
            f"{median:.{digits}f}",
            f"{ninety:.{digits}f}",
            f"{self.nees.mean() / self.dimensions:.2f}",
            f"{inside:.3f}",
        ]


def position_errors(
    places: Sequence[Place | None], positions: Array, selected: NDArray[np.bool_]
) -> tuple[Errors, Errors, int]:
    """Errors of range and position, relative to the range, and the number without a place."""
    chosen = [index for index in np.flatnonzero(selected) if places[index] is not None]
    found = [place for place in (places[index] for index in chosen) if place is not None]
    if not found:
        return Errors(np.empty(0), np.empty(0), 1), Errors(np.empty(0), np.empty(0), 3), 0
    true = positions[chosen]
    ranges = np.linalg.norm(true, axis=1)
    errors = np.array([place.position for place in found]) - true
    covariances = np.array([place.covariance for place in found])
    along = true / ranges[:, None]
    variance = np.einsum("ni,nij,nj->n", along, covariances, along)
    differences = np.array([place.range for place in found]) - ranges
    return (
        Errors.of(differences[:, None], variance[:, None, None], ranges),
        Errors.of(errors, covariances, ranges),
        int(selected.sum()) - len(found),
    )


def auroc(values: Array, positive: NDArray[np.bool_]) -> str:
    """Area under the receiver operating characteristic, as a text."""
    area = roc_area([LabeledConfidences("", values[None], positive[None])])
    return "-" if np.isnan(area) else f"{area:.3f}"
