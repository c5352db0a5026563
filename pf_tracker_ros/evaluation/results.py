"""Results of an evaluation: boxes, times and scores of a sequence, and means over sequences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.evaluation import metrics


class EvaluationError(ValueError):
    """An evaluation that cannot be carried out; the message has the reason."""


@dataclass(frozen=True)
class Scores:
    """The scores of one sequence, or their means over sequences.

    Attributes:
        success_auc: Area under the success curve; 20/21 is perfect, see `metrics.success_auc`.
        precision_20px: Share of frames with a center error of at most 20 px, 0 to 1.
        cpu_ms_median: Median CPU time of an `update`, in milliseconds.
        frames: Number of frames, including the first.
    """

    success_auc: float
    precision_20px: float
    cpu_ms_median: float
    frames: float


@dataclass(frozen=True)
class SequenceFailure:
    """Result of a sequence that could not be evaluated.

    Attributes:
        name: The sequence's name.
        error: The reason; its message names the sequence or the file.
    """

    name: str
    error: Exception


@dataclass(frozen=True, eq=False)
class FrameDetails:
    """A tracker's output for each frame besides the box.

    Attributes:
        states: (frames,) track states, each an empty text if unknown.
        confidence: (frames,) 0 to 1, NaN if unknown.
        effective_sample_size: (frames,), NaN if unknown.
        cue_weights: Name of a cue to its (frames,) weight.
    """

    states: tuple[str, ...]
    confidence: NDArray[np.float64]
    effective_sample_size: NDArray[np.float64]
    cue_weights: Mapping[str, NDArray[np.float64]]

    @classmethod
    def of(cls, frames: Sequence[Any]) -> FrameDetails:
        """Collect the details from an object for each frame."""
        names = dict.fromkeys(name for frame in frames for name in frame.cue_weights)
        return cls(
            tuple(frame.state for frame in frames),
            np.array([frame.confidence for frame in frames]),
            np.array([frame.effective_sample_size for frame in frames]),
            {
                name: np.array([frame.cue_weights.get(name, np.nan) for frame in frames])
                for name in names
            },
        )


@dataclass(frozen=True)
class SequenceResult:
    """Results of one sequence: one pass for each seed.

    Frames without target (`metrics.has_target`) are tracked but not scored.

    Attributes:
        name: The sequence's name.
        seeds: The seeds, in the order of the first axis of the arrays.
        true_boxes: (frames, 4) x, y, width, height in pixels; a row of NaN for an absent target.
        boxes: (seeds, frames, 4) the tracker's boxes. The first is the true box; while the target
            is lost, the last box is repeated.
        lost: (seeds, frames) whether the tracker reported the target as lost.
        cpu_seconds: (seeds, frames - 1) CPU time of each `update`.
        details: Further output for the first seed, None if unknown.
    """

    name: str
    seeds: tuple[int, ...]
    true_boxes: NDArray[np.float64]
    boxes: NDArray[np.float64]
    lost: NDArray[np.bool_]
    cpu_seconds: NDArray[np.float64]
    details: FrameDetails | None = None

    @cached_property
    def overlaps(self) -> NDArray[np.float64]:
        """(seeds, frames) intersection over union; NaN where the target is absent."""
        return metrics.overlap(self.boxes, self.true_boxes)

    @cached_property
    def center_errors(self) -> NDArray[np.float64]:
        """(seeds, frames) pixels; NaN where the target is absent."""
        return metrics.center_errors(self.boxes, self.true_boxes)

    @property
    def success_aucs(self) -> NDArray[np.float64]:
        """(seeds,) area under the success curve of each seed."""
        return np.array([metrics.success_auc(overlaps) for overlaps in self.overlaps])

    @property
    def success_curve(self) -> NDArray[np.float64]:
        """(21,) success curve, mean over the seeds."""
        return np.mean([metrics.success_curve(overlaps) for overlaps in self.overlaps], axis=0)

    @property
    def precision_curve(self) -> NDArray[np.float64]:
        """(51,) precision curve, mean over the seeds."""
        return np.mean([metrics.precision_curve(row) for row in self.center_errors], axis=0)

    @property
    def success_auc_std(self) -> float:
        """Standard deviation of the success AUC over the seeds; NaN for a single seed."""
        if len(self.seeds) < 2:
            return float("nan")
        return float(self.success_aucs.std(ddof=1))

    @property
    def scores(self) -> Scores:
        """The sequence's figures, averaged over the seeds."""
        return Scores(
            success_auc=float(self.success_aucs.mean()),
            precision_20px=float(np.mean([metrics.precision(row) for row in self.center_errors])),
            cpu_ms_median=float(np.median(self.cpu_seconds, axis=1).mean() * 1e3),
            frames=len(self.true_boxes),
        )


def mean_scores(results: Sequence[SequenceResult]) -> Scores:
    """Unweighted mean over sequences of every figure, including `frames`.

    Raises:
        ValueError: There is no result.
    """
    if not results:
        raise ValueError("no results to average; allowed: at least one sequence")
    scores = [astuple(result.scores) for result in results]
    return Scores(*(float(np.mean(values)) for values in zip(*scores, strict=True)))
