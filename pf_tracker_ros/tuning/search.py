"""The search for the best values on some of the sequences: an Optuna study."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
import optuna
from numpy.typing import NDArray
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.pruners import WilcoxonPruner
from optuna.samplers import TPESampler
from optuna.storages import BaseStorage
from optuna.trial import FrozenTrial, Trial, TrialState

from pf_tracker_ros.tracking.presets import preset_parameters
from pf_tracker_ros.tuning.comparison import seed_error
from pf_tracker_ros.tuning.evaluations import Evaluations, TunedValues
from pf_tracker_ros.tuning.journal import fail_unfinished_trials
from pf_tracker_ros.tuning.search_space import SearchRange

# Trials before the sampler: the preset, the start values, and the preset with some parameters
# drawn anew, each with this probability.
_FIRST_TRIALS, _DRAWN_SHARE = 10, 0.3
# A trial is hopeless if it is worse than the best one at this significance. Four sequences are the
# fewest that can show it.
_HOPELESS_BELOW, _MIN_SEQUENCES = 0.1, 4
_MAX_STAGES = 3
# Standard errors due to the seeds that a parameter's return to the preset may lose.
_MAX_LOSS = 2.0
_ERROR = "error"


@dataclass(frozen=True)
class TuningRequest:
    """What to tune.

    Attributes:
        preset: Name of the preset.
        given: Full name to value of the parameters that differ from it: the start of those that are
            tuned, the value of others.
        space: Name to range of the tuned parameters.
        trials: Number of trials of each search.
        seeds: Number of seeds of each evaluation in a search.
        folds: Number of groups of sequences that are left out in turn.
        seed: Seed of the search.
    """

    preset: str
    given: Mapping[str, Any]
    space: Mapping[str, SearchRange]
    trials: int
    seeds: int
    folds: int
    seed: int

    @cached_property
    def own(self) -> TunedValues:
        """Values of the tuned parameters in the preset."""
        values = preset_parameters(self.preset)
        return {name: values[name] for name in self.space}

    @property
    def start(self) -> TunedValues:
        """Values of the tuned parameters to start from."""
        return {name: self.given.get(name, own) for name, own in self.own.items()}

    @property
    def identity(self) -> dict[str, Any]:
        """What has to be the same in a run that continues another."""
        return {
            "preset": self.preset,
            "parameters": dict(self.given),
            "ranges": {name: asdict(each) for name, each in self.space.items()},
            "seeds": self.seeds,
            "seed": self.seed,
        }

    @property
    def fixed(self) -> dict[str, Any]:
        """Full name to value of the given parameters that are not tuned."""
        return {name: value for name, value in self.given.items() if name not in self.space}


class ValueSearch:
    """Searches the values with the largest mean gain over the preset on some sequences.

    A trial is evaluated in stages, a few sequences each, and ends early if it is hopeless. After
    the last trial, the parameters of the best one return to the preset's values, one after the
    other, if the loss is within the noise of the seeds.

    Args:
        storage: Of the study.
        name: Of the study, unique in the storage.
        request: What to tune.
        members: Indices of the sequences of this search.
        evaluations: The evaluations.
    """

    def __init__(
        self,
        storage: BaseStorage,
        name: str,
        request: TuningRequest,
        members: Sequence[int],
        evaluations: Evaluations,
    ) -> None:
        self.members = tuple(members)
        self._request = request
        self._evaluations = evaluations
        self._distributions: dict[str, BaseDistribution] = {
            parameter: FloatDistribution(one.low, one.high, log=one.is_logarithmic)
            for parameter, one in request.space.items()
        }
        with warnings.catch_warnings():
            # setup.py limits the version, so that experimental interfaces do not change.
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            pruner = WilcoxonPruner(p_threshold=_HOPELESS_BELOW, n_startup_steps=_MIN_SEQUENCES)
        self._study = optuna.create_study(
            storage=storage,
            study_name=name,
            direction="maximize",
            load_if_exists=True,
            pruner=pruner,
        )
        fail_unfinished_trials(self._study)

    @property
    def best(self) -> TunedValues:
        """Values of the best trial so far; those of the preset before the first."""
        complete = [trial for trial in self._trials() if trial.state == TrialState.COMPLETE]
        if not complete:
            return self._request.own
        # Of equal ones the first.
        return self._rounded(max(complete, key=lambda trial: trial.value or 0.0).params)

    @property
    def count(self) -> int:
        """Number of finished trials."""
        return len(self._trials())

    def simplified(self) -> tuple[TunedValues, TunedValues | None]:
        """Return parameters of the best values to those of the preset, one after the other.

        Returns:
            The values, and those to evaluate before the next parameter; None at the end.
        """
        best = self.best
        values = dict(best)
        for name, own in self._request.own.items():
            if values[name] == own:
                continue
            candidate = {**values, name: own}
            if self.failure(candidate, self.members):
                continue
            if not all(self._evaluations.knows(candidate, each) for each in self.members):
                return values, candidate
            loss = self._table(best) - self._table(candidate)
            if loss.mean() <= _MAX_LOSS * seed_error(loss):
                values = candidate
        return values, None

    def propose(self) -> SearchTrial | None:
        """The next trial; None after the last."""
        count = self.count
        if count < self._request.trials:
            seed = int(np.random.SeedSequence((self._request.seed, count)).generate_state(1)[0])
            # A new sampler for each trial, so that a resumed search continues as if uninterrupted.
            self._study.sampler = TPESampler(seed=seed, n_startup_trials=0)
            first = self._first_trial(count, seed)
            return self._ask(first, can_be_pruned=count > 0)
        _, candidate = self.simplified()
        return None if candidate is None else self._ask(candidate, can_be_pruned=False)

    def _first_trial(self, count: int, seed: int) -> TunedValues | None:
        """Values of the first trials; None for the sampler's."""
        request = self._request
        if count == 0:
            return request.own
        if count == 1 and request.start != request.own:
            return request.start
        if count >= _FIRST_TRIALS:
            return None
        generator = np.random.default_rng(seed)
        values = dict(request.own)
        drawn = generator.random(len(values)) < _DRAWN_SHARE
        drawn[generator.integers(len(values))] = True
        for name in np.array(list(values))[drawn]:
            one, place = request.space[name], generator.random()
            if one.is_logarithmic:
                values[name] = one.rounded(one.low * (one.high / one.low) ** place)
            else:
                values[name] = one.rounded(one.low + (one.high - one.low) * place)
        return values

    def _ask(self, values: TunedValues | None, *, can_be_pruned: bool) -> SearchTrial:
        if values is not None:
            self._study.enqueue_trial(dict(values))
        trial = self._study.ask(self._distributions)
        return SearchTrial(self, trial, self._rounded(trial.params), can_be_pruned)

    def _trials(self) -> list[FrozenTrial]:
        """The finished trials of the search itself; a trial of a killed run is none."""
        finished = [
            trial
            for trial in self._study.get_trials(deepcopy=False)
            if trial.state in (TrialState.COMPLETE, TrialState.PRUNED) or _ERROR in trial.user_attrs
        ]
        return finished[: self._request.trials]

    def _rounded(self, parameters: Mapping[str, Any]) -> TunedValues:
        """The values of a trial. Those of the preset and the start may have more digits."""
        request = self._request
        return {
            name: value
            if value in (request.own[name], request.start[name])
            else request.space[name].rounded(value)
            for name, value in parameters.items()
        }

    def _table(self, values: TunedValues) -> NDArray[np.float64]:
        return self._evaluations.table(values, self.members)

    def gains(self, values: TunedValues, sequences: Sequence[int]) -> NDArray[np.float64]:
        """(sequences,) mean gain over the preset; NaN for a failed evaluation."""
        own = self._evaluations.table(self._request.own, sequences)
        return (self._evaluations.table(values, sequences) - own).mean(axis=1)

    def stages(self) -> Iterator[tuple[int, ...]]:
        """The sequences of a trial, in stages; the same for every trial."""
        size = max(_MIN_SEQUENCES, -(-len(self.members) // _MAX_STAGES))
        order = np.random.default_rng(self._request.seed).permutation(self.members).tolist()
        for first in range(0, len(order), size):
            yield tuple(order[first : first + size])

    def failure(self, values: TunedValues, sequences: Sequence[int]) -> str:
        """The reason if an evaluation failed so far, else empty."""
        known = (each for each in sequences if self._evaluations.knows(values, each))
        found = (self._evaluations.figures(values, each) for each in known)
        return next((one for one in found if isinstance(one, str)), "")

    def tell(self, trial: Trial, state: TrialState, gain: float | None, reason: str) -> None:
        """Finish a trial."""
        if reason:
            trial.set_user_attr(_ERROR, reason)
        self._study.tell(trial, gain, state)


class SearchTrial:
    """A trial under way.

    Attributes:
        values: Its values.
        remaining: Stages that are left, the next one first.
        error: Reason for a failed evaluation, else empty.

    Args:
        search: Of the trial.
        trial: The trial.
        values: Its values.
        can_be_pruned: Whether it ends early if it is hopeless.
    """

    def __init__(
        self, search: ValueSearch, trial: Trial, values: TunedValues, can_be_pruned: bool
    ) -> None:
        self.values = values
        self.remaining = list(search.stages())
        self.error = ""
        self._search = search
        self._trial = trial
        self._can_be_pruned = can_be_pruned

    def advance(self) -> None:
        """Take the results of the next stage; finishes the trial after the last one.

        A trial that is hopeless, or that failed, has no remaining stages.
        """
        stage = self.remaining.pop(0)
        self.error = self._search.failure(self.values, stage)
        if self.error:
            self.remaining.clear()
            self._search.tell(self._trial, TrialState.FAIL, None, self.error)
            return
        for sequence, gain in zip(stage, self._search.gains(self.values, stage), strict=True):
            self._trial.report(float(gain), sequence)
        if not self.remaining:
            gains = self._search.gains(self.values, self._search.members)
            self._search.tell(self._trial, TrialState.COMPLETE, float(gains.mean()), "")
        elif self._can_be_pruned and self._trial.should_prune():
            self.remaining.clear()
            self._search.tell(self._trial, TrialState.PRUNED, None, "")
