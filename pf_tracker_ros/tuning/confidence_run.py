"""A run of `tune --confidence`: tracking all sequences, and the calibration of the confidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import optuna
from numpy.typing import NDArray
from optuna.storages import BaseStorage

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.evaluation.metrics import overlap
from pf_tracker_ros.evaluation.one_pass import evaluate_each
from pf_tracker_ros.evaluation.results import EvaluationError, SequenceFailure
from pf_tracker_ros.footage import Footage
from pf_tracker_ros.progress import OnProgress
from pf_tracker_ros.recordings.archives.executors import Executor
from pf_tracker_ros.targets.tracker import Tracker
from pf_tracker_ros.tracking.estimate import Estimate
from pf_tracker_ros.tuning.confidence import CalibrationResult, LabeledConfidences, calibrate
from pf_tracker_ros.tuning.evaluations import Evaluations, EvaluationTask
from pf_tracker_ros.tuning.tuning import RUN, check_tuning_request, finished_counts, set_finished

PARAMETER = "track.confidence_calibration"
"""The parameter that is fitted."""

_RIGHT_ABOVE = 0.5
# Of stored confidences.
_DIGITS = 6


@dataclass(frozen=True)
class ConfidenceRequest:
    """What to calibrate.

    Attributes:
        preset: Name of the preset.
        given: Full name to value of the parameters that differ from it; without `PARAMETER`.
        seeds: Number of seeds of the tracker.
        folds: Number of groups of sequences that are left out in turn.
    """

    preset: str
    given: Mapping[str, Any]
    seeds: int
    folds: int


class ConfidenceRun:
    """Tracks the sequences and calibrates the confidence. The storage keeps finished evaluations.

    Args:
        request: What to calibrate.
        sequences: At least two sequences with ground truth.
        storage: The evaluations of this run, or of its beginning.
        executor: Runs the evaluations; None for this process.

    Attributes:
        errors: Reasons for failed evaluations.

    Raises:
        EvaluationError: The storage belongs to another request.
    """

    def __init__(
        self,
        request: ConfidenceRequest,
        sequences: Sequence[Footage],
        storage: BaseStorage,
        executor: Executor | None,
    ) -> None:
        self.errors: list[str] = []
        self._request = request
        self._sequences = list(sequences)
        self._executor = executor
        self._study = optuna.create_study(storage=storage, study_name=RUN, load_if_exists=True)
        identity = {
            "fitted": PARAMETER,
            "preset": request.preset,
            "parameters": dict(request.given),
            "seeds": request.seeds,
        }
        check_tuning_request(self._study, identity, sequences)

    @property
    def finished(self) -> Mapping[str, int]:
        """See `finished_counts`."""
        return finished_counts(self._study)

    @property
    def runs(self) -> int:
        """Number of runs, for the progress; a run has one seed."""
        return len(self._sequences) * self._request.seeds

    def run(self, on_progress: OnProgress) -> CalibrationResult:
        """Track, and fit.

        Raises:
            EvaluationError: Fewer than two sequences can be evaluated.
            RecordingError: A Ray cluster cannot be reached, or has ended.
        """
        request = self._request
        evaluations = Evaluations(
            self._study,
            self._executor,
            request.preset,
            request.given,
            sequences=self._sequences,
            seeds=range(request.seeds),
            on_progress=on_progress,
            evaluate=labeled_frames,
        )
        evaluations.carry_out([({}, number) for number in range(len(self._sequences))])
        labeled = []
        for number, footage in enumerate(self._sequences):
            figures = evaluations.figures({}, number)
            if isinstance(figures, str):
                self.errors.append(figures)
                continue
            confidence, is_right = (np.array(one) for one in zip(*figures, strict=True))
            labeled.append(LabeledConfidences(footage.name, confidence, is_right.astype(bool)))
        if len(labeled) < 2:
            raise EvaluationError("fewer than 2 sequences can be evaluated")
        result = calibrate(labeled, request.folds)
        set_finished(self._study, {"folds": request.folds})
        return result


def labeled_frames(task: EvaluationTask) -> list[Any] | str:
    """For each seed, the confidence of each frame but the first, and whether its box is right.

    Returns:
        For each seed a list of confidences and one of 0 and 1; or the reason for a failure.
    """
    recorders: list[_Recorder] = []

    def recorder(seed: int) -> _Recorder:
        make = partial(Tracker.from_preset, task.preset, parameters=task.parameters)
        recorders.append(_Recorder(make(seed)))
        return recorders[-1]

    ((_, result),) = evaluate_each([task.footage], recorder, task.seeds)
    if isinstance(result, SequenceFailure):
        return str(result.error)
    true_boxes = result.true_boxes[1:]
    if not len(true_boxes):
        return f"{task.footage.name} has no frame after the first"
    return [
        [
            [round(value, _DIGITS) for value in one.confidence],
            # An absent target has no overlap, NaN.
            (overlap(np.array(one.boxes), true_boxes) > _RIGHT_ABOVE).astype(int).tolist(),
        ]
        for one in recorders
    ]


class _Recorder:
    """A tracker whose boxes and confidences are kept.

    Args:
        tracker: The tracker.
    """

    def __init__(self, tracker: Tracker) -> None:
        self._tracker = tracker
        self.boxes: list[Box] = []
        self.confidence: list[float] = []

    def start(self, image: NDArray[Any], box: Box) -> Estimate:
        return self._tracker.start(image, box)

    def update(self, image: NDArray[Any], dt: float | None) -> Estimate:
        estimate = self._tracker.update(image, dt)
        self.boxes.append(estimate.box)
        self.confidence.append(estimate.confidence)
        return estimate
