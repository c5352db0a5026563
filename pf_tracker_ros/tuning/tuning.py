"""A run of `tune`: searches with and without each group of sequences, and their comparison."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import optuna
from optuna.storages import BaseStorage

from pf_tracker_ros import __version__
from pf_tracker_ros.evaluation.results import EvaluationError
from pf_tracker_ros.footage import Footage
from pf_tracker_ros.progress import OnProgress
from pf_tracker_ros.recordings.archives.executors import Executor
from pf_tracker_ros.tuning.comparison import Comparison
from pf_tracker_ros.tuning.evaluations import Evaluations, TunedValues
from pf_tracker_ros.tuning.search import TuningRequest, ValueSearch

# Seeds of the comparison, other than those of the search.
_COMPARED_SEEDS = 5
RUN = "run"
"""Name of the study with request and evaluations."""

_REQUEST, _FINISHED = "request", "result"


@dataclass(frozen=True, eq=False)
class TuningResult:
    """Values found on all sequences, and their gain.

    Attributes:
        values: Name to value of the tuned parameters.
        comparison: The preset and the values found without each sequence, on that sequence.
        seen: The preset and `values` on the sequences that they were chosen on.
    """

    values: TunedValues
    comparison: Comparison
    seen: Comparison


class Tuning:
    """Searches and comparison. Everything that is done is kept in the storage.

    Args:
        request: What to tune.
        sequences: At least two sequences with ground truth.
        storage: The trials of this run, or of its beginning.
        executor: Runs the evaluations; None for this process.

    Attributes:
        best: Values of the best trial on all sequences so far.
        trials: Number of finished trials on all sequences.
        errors: Reasons for failed evaluations.

    Raises:
        EvaluationError: The storage belongs to another request.
    """

    def __init__(
        self,
        request: TuningRequest,
        sequences: Sequence[Footage],
        storage: BaseStorage,
        executor: Executor | None,
    ) -> None:
        self.best: TunedValues = request.own
        self.trials = 0
        self.errors: list[str] = []
        self._request = request
        self._sequences = list(sequences)
        self._storage = storage
        self._executor = executor
        self._study = optuna.create_study(
            storage=storage, study_name=RUN, direction="maximize", load_if_exists=True
        )
        check_tuning_request(self._study, request.identity, sequences)

    def run(self, on_progress: OnProgress) -> TuningResult:
        """Search, and compare on the sequences left out.

        Args:
            on_progress: Called with the number of runs that are done; a run has one seed.

        Raises:
            EvaluationError: Fewer than two sequences can be evaluated with the preset.
            RecordingError: A Ray cluster cannot be reached, or has ended.
        """
        request = self._request
        evaluations = self._evaluations(range(request.seeds), on_progress)
        everything = range(len(self._sequences))
        evaluations.carry_out([(request.own, each) for each in everything])
        usable = [each for each in everything if not self._has_failed(evaluations, each)]
        if len(usable) < 2:
            raise EvaluationError("fewer than 2 sequences can be evaluated")
        folds = [fold.tolist() for fold in np.array_split(usable, min(request.folds, len(usable)))]
        kept = [usable, *([each for each in usable if each not in fold] for fold in folds)]
        searches = [self._search(members, evaluations) for members in kept]
        self._run_searches(searches, evaluations, on_progress)
        found = [search.simplified()[0] for search in searches]
        result = self._compare(found, usable, folds, on_progress)
        set_finished(self._study, {"trials": request.trials, "folds": request.folds})
        return result

    @property
    def finished(self) -> Mapping[str, int]:
        """See `finished_counts`."""
        return finished_counts(self._study)

    @property
    def runs(self) -> int:
        """Upper limit of the number of runs, for the progress."""
        request, count = self._request, len(self._sequences)
        trials = request.trials + len(request.space)
        searched = count * min(request.folds, count) * trials
        return (count + searched) * request.seeds + 4 * count * _COMPARED_SEEDS

    def _evaluations(self, seeds: Sequence[int], on_progress: OnProgress) -> Evaluations:
        request = self._request
        return Evaluations(
            self._study,
            self._executor,
            request.preset,
            request.fixed,
            sequences=self._sequences,
            seeds=seeds,
            on_progress=on_progress,
        )

    def _search(self, members: Sequence[int], evaluations: Evaluations) -> ValueSearch:
        """The search on some of the sequences; its study is named by the others."""
        names = [each.name for each in self._sequences]
        without = [name for index, name in enumerate(names) if index not in members]
        name = f"without {', '.join(without)}" if without else "all"
        return ValueSearch(self._storage, name, self._request, members, evaluations)

    def _run_searches(
        self, searches: Sequence[ValueSearch], evaluations: Evaluations, on_progress: OnProgress
    ) -> None:
        """Run all searches side by side, a trial of each at a time.

        So the result does not depend on the number of workers, and the searches share evaluations.
        """
        whole = searches[0]
        while True:
            self.best, self.trials = whole.best, whole.count
            trials = [trial for each in searches if (trial := each.propose()) is not None]
            if not trials:
                return
            while under_way := [trial for trial in trials if trial.remaining]:
                evaluations.carry_out(
                    [(trial.values, each) for trial in under_way for each in trial.remaining[0]]
                )
                for trial in under_way:
                    skipped = sum(map(len, trial.remaining[1:]))
                    trial.advance()
                    if not trial.remaining:
                        on_progress("", skipped * self._request.seeds)
                    self._report(trial.error)

    def _compare(
        self,
        found: Sequence[TunedValues],
        usable: Sequence[int],
        folds: Sequence[Sequence[int]],
        on_progress: OnProgress,
    ) -> TuningResult:
        """Compare with the preset: each fold's values on the fold, the first ones on all."""
        request = self._request
        seeds = range(request.seeds, request.seeds + _COMPARED_SEEDS)
        evaluations = self._evaluations(seeds, on_progress)
        evaluations.carry_out(
            [
                (each, member)
                for values, members in zip(found, [usable, *folds], strict=True)
                for each in (request.own, values)
                for member in members
            ]
        )
        own = evaluations.table(request.own, usable)
        tuned = evaluations.table(found[0], usable)
        left_out = np.concatenate(
            [evaluations.table(values, fold) for values, fold in zip(found[1:], folds, strict=True)]
        )
        compared = np.isfinite(own + tuned + left_out).all(axis=1)
        for sequence in usable:
            for values in found:
                if evaluations.knows(values, sequence):
                    self._report(evaluations.figures(values, sequence))
        if compared.sum() < 2:
            raise EvaluationError("fewer than 2 sequences could be compared")
        names = [
            self._sequences[each].name
            for each, is_one in zip(usable, compared, strict=True)
            if is_one
        ]
        return TuningResult(
            found[0],
            Comparison(names, own[compared], left_out[compared]),
            Comparison(names, own[compared], tuned[compared]),
        )

    def _has_failed(self, evaluations: Evaluations, sequence: int) -> bool:
        """Whether the preset failed on a sequence; reports it."""
        found = evaluations.figures(self._request.own, sequence)
        self._report(found)
        return isinstance(found, str)

    def _report(self, found: list[float] | str) -> None:
        """Keep the reason of a failed evaluation."""
        if isinstance(found, str) and found and found not in self.errors:
            self.errors.append(found)


def set_finished(study: optuna.Study, counts: Mapping[str, int]) -> None:
    """Store that a run came to its end.

    Args:
        study: The study named `RUN`.
        counts: Option to its value, of the options that make a result better if they are larger.
    """
    study.set_user_attr(_FINISHED, dict(counts))


def finished_counts(study: optuna.Study) -> Mapping[str, int]:
    """The counts of the last run that came to its end; empty without one."""
    counts: Mapping[str, int] = study.user_attrs.get(_FINISHED, {})
    return counts


def check_tuning_request(
    study: optuna.Study, identity: Mapping[str, Any], sequences: Sequence[Footage]
) -> None:
    """Store a request, or compare it with the stored one.

    Args:
        study: The study named `RUN`.
        identity: What has to be the same in each run that continues another.
        sequences: The sequences, which have to be the same as well.

    Raises:
        EvaluationError: They differ.
    """
    asked = {
        "version": __version__,
        **identity,
        "sequences": [(each.name, _digest(each)) for each in sequences],
    }
    asked = json.loads(json.dumps(asked))
    stored = study.user_attrs.get(_REQUEST)
    if stored is None:
        study.set_user_attr(_REQUEST, asked)
    elif different := [name for name, value in asked.items() if stored.get(name) != value]:
        raise EvaluationError(
            f"the journal beside the output is of another run ({', '.join(different)} differ); "
            "remove it, or choose another --output"
        )


def _digest(footage: Footage) -> str:
    """Hash of the ground truth, which identifies a sequence well enough."""
    return hashlib.sha256(np.asarray(footage.ground_truth).tobytes()).hexdigest()
