"""Evaluations of parameter values on sequences; each is carried out and stored only once."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import optuna
from numpy.typing import NDArray

from pf_tracker_ros.evaluation.one_pass import evaluate_each
from pf_tracker_ros.evaluation.parallel import WorkerEnded
from pf_tracker_ros.evaluation.results import SequenceFailure
from pf_tracker_ros.footage import Footage
from pf_tracker_ros.progress import OnProgress
from pf_tracker_ros.recordings.archives.executors import Executor
from pf_tracker_ros.targets.tracker import Tracker

TunedValues: TypeAlias = Mapping[str, float]
"""Full name to value of the tuned parameters."""


@dataclass(frozen=True)
class EvaluationTask:
    """An evaluation for a worker."""

    footage: Footage
    preset: str
    parameters: Mapping[str, Any]
    seeds: Sequence[int]


Evaluate: TypeAlias = Callable[[EvaluationTask], list[Any] | str]


class Evaluations:
    """Figures of parameter values on sequences, by default success AUCs.

    Args:
        study: Stores each evaluation as an attribute, those of an earlier run included.
        executor: Runs the evaluations; None for this process.
        preset: The preset.
        fixed: Full name to value of the parameters that differ from it and are not tuned.
        sequences: The sequences.
        seeds: The seeds.
        on_progress: Called with the number of runs that are done; a run has one seed.
        evaluate: Returns a figure for each seed, of a type of JSON, or the reason for a failure.
    """

    def __init__(
        self,
        study: optuna.Study,
        executor: Executor | None,
        preset: str,
        fixed: Mapping[str, Any],
        *,
        sequences: Sequence[Footage],
        seeds: Sequence[int],
        on_progress: OnProgress,
        evaluate: Evaluate | None = None,
    ) -> None:
        self._study = study
        self._executor = executor
        self._preset = preset
        self._fixed = fixed
        self._sequences = sequences
        self._seeds = tuple(seeds)
        self._on_progress = on_progress
        self._evaluate: Evaluate = evaluate or success_aucs
        self._known: dict[str, list[Any] | str] = study.user_attrs

    def knows(self, values: TunedValues, sequence: int) -> bool:
        """Whether this evaluation was carried out."""
        return self._key(values, sequence) in self._known

    def figures(self, values: TunedValues, sequence: int) -> list[Any] | str:
        """The figure for each seed, or the reason for a failure.

        Raises:
            KeyError: The evaluation was not carried out.
        """
        return self._known[self._key(values, sequence)]

    def table(self, values: TunedValues, sequences: Sequence[int]) -> NDArray[np.float64]:
        """(sequences, seeds) success AUCs; NaN for failures.

        Raises:
            KeyError: An evaluation was not carried out.
        """
        failed = [np.nan] * len(self._seeds)
        rows = (self.figures(values, sequence) for sequence in sequences)
        return np.array([failed if isinstance(row, str) else row for row in rows])

    def carry_out(self, requests: Sequence[tuple[TunedValues, int]]) -> None:
        """Carry out the evaluations of values on sequences that are not known yet."""
        pending: dict[str, tuple[EvaluationTask, int]] = {}
        for values, sequence in requests:
            key = self._key(values, sequence)
            footage = self._sequences[sequence]
            if key in self._known:
                self._on_progress(footage.name, len(self._seeds))
                continue
            task = EvaluationTask(footage, self._preset, {**self._fixed, **values}, self._seeds)
            pending[key] = task, pending.get(key, (task, 0))[1] + 1
        keys = list(pending)
        with closing(self._results([task for task, _ in pending.values()])) as results:
            for number, result in results:
                task, count = pending[keys[number]]
                if isinstance(result, WorkerEnded):
                    reason = f"a worker ended unexpectedly ({result.reason})"
                    self._known[keys[number]] = f"{task.footage.name}: {reason}"
                else:
                    self._known[keys[number]] = result
                    if not isinstance(result, str):
                        self._study.set_user_attr(keys[number], result)
                self._on_progress(task.footage.name, count * len(self._seeds))

    def _key(self, values: TunedValues, sequence: int) -> str:
        named = [self._seeds, self._sequences[sequence].name, dict(values)]
        return json.dumps(named, sort_keys=True)

    def _results(self, tasks: Sequence[EvaluationTask]) -> Any:
        if self._executor is None:
            return _one_by_one(self._evaluate, tasks)
        return self._executor.run(self._evaluate, tasks)


def _one_by_one(
    evaluate: Evaluate, tasks: Sequence[EvaluationTask]
) -> Iterator[tuple[int, list[Any] | str]]:
    for number, task in enumerate(tasks):
        yield number, evaluate(task)


def success_aucs(task: EvaluationTask) -> list[float] | str:
    """Success AUC for each seed, or the reason for a failure."""
    make_tracker = partial(Tracker.from_preset, task.preset, parameters=task.parameters)
    ((_, result),) = evaluate_each([task.footage], make_tracker, task.seeds)
    if isinstance(result, SequenceFailure):
        return str(result.error)
    return [float(auc) for auc in result.success_aucs]
