"""Searches and comparison, with success AUCs of a formula."""

import os
import zlib

import numpy as np
import pytest

from pf_tracker_ros.evaluation import EvaluationError
from pf_tracker_ros.parameters import declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PRESETS, preset_parameters
from pf_tracker_ros.tuning.search_space import search_space

optuna = pytest.importorskip("optuna")
pytest.importorskip("scipy")
comparison = pytest.importorskip("pf_tracker_ros.tuning.comparison")
journal = pytest.importorskip("pf_tracker_ros.tuning.journal")
tuning_run = pytest.importorskip("pf_tracker_ros.tuning.tuning")

IN_MEMORY = optuna.storages.InMemoryStorage
NOISE = "motion.position_noise"
PRESET = "li2007"
OWN_NOISE = preset_parameters(PRESET)[NOISE]


class NamedFootage:
    """Ground truth without frames."""

    def __init__(self, name):
        self.name = name
        self.ground_truth = np.full((5, 4), float(len(name)))


class Formula:
    """An executor that computes success AUCs.

    The AUC falls with the distance of the position noise from the best one of a sequence, on a
    logarithmic scale, and has noise from the seed and the values.

    Attributes:
        tasks: All tasks that it was given.
    """

    workers = 1

    def __init__(self, best, noise=0.01):
        self.best = best
        self.noise = noise
        self.tasks = []

    def run(self, work, tasks):
        for number, task in enumerate(tasks):
            self.tasks.append(task)
            yield number, [self.auc(task, seed) for seed in task.seeds]

    def auc(self, task, seed):
        values = {**preset_parameters(PRESET), **task.parameters}
        key = f"{task.footage.name} {seed} {sorted(task.parameters.items())}"
        noise = np.random.default_rng(zlib.crc32(key.encode())).normal(0.0, self.noise)
        best = self.best(task.footage.name) if callable(self.best) else self.best
        return 0.6 - 0.1 * abs(np.log(values[NOISE] / best)) + noise


@pytest.fixture
def tune():
    """A function that tunes the preset with an executor; returns the result and the tuning."""

    def run(executor, *, sequences=8, storage=None, given=None, on_progress=None, **options):
        given = given or {}
        options = {"trials": 30, "seeds": 2, "folds": 4, "seed": 0, **options}
        request = tuning_run.TuningRequest(PRESET, given, search_space(PRESET, given), **options)
        footage = [NamedFootage(f"sequence{number}") for number in range(sequences)]
        tuning = tuning_run.Tuning(request, footage, storage or IN_MEMORY(), executor)
        return tuning.run(on_progress or (lambda name, done: None)), tuning

    run.own = {name: preset_parameters(PRESET)[name] for name in search_space(PRESET, {})}
    return run


class Killed(BaseException):
    """The process is killed."""


class KilledFormula(Formula):
    """A formula whose process is killed after some evaluations."""

    def __init__(self, best, evaluations):
        super().__init__(best)
        self.left = evaluations

    def run(self, work, tasks):
        for found in super().run(work, tasks):
            if not self.left:
                raise Killed
            self.left -= 1
            yield found


class FailingFormula(Formula):
    """A formula some of whose evaluations fail, as a function of the task tells by a message."""

    def __init__(self, best, failure):
        super().__init__(best)
        self.failure = failure

    def run(self, work, tasks):
        for number, aucs in super().run(work, tasks):
            yield number, self.failure(tasks[number]) or aucs


def loss_of(values):
    return 0.1 * abs(np.log(values[NOISE] / OWN_NOISE))


def test_a_planted_bad_value_is_undone(tune):
    result, _ = tune(Formula(OWN_NOISE), given={NOISE: OWN_NOISE / 5}, trials=12)
    assert loss_of(result.values) < 0.01
    assert not result.comparison.is_significant


def test_a_better_start_is_kept(tune):
    best = OWN_NOISE * 5
    result, _ = tune(Formula(best), given={NOISE: best}, trials=2)
    assert result.values[NOISE] == best
    assert result.comparison.is_significant


@pytest.mark.parametrize("seed", range(2))
def test_nothing_is_claimed_where_the_preset_is_best(tune, seed):
    """Each sequence has another best value; that of the preset is in their middle."""

    def best(name):
        return OWN_NOISE * np.exp(np.random.default_rng(zlib.crc32(name.encode())).normal(0, 0.3))

    result, _ = tune(Formula(best, noise=0.02), seed=seed, trials=20)
    assert not result.comparison.is_significant


def test_a_better_value_is_found_and_parameters_without_effect_stay(tune):
    done = []
    result, tuning = tune(
        Formula(4 * OWN_NOISE, noise=0),
        trials=20,
        on_progress=lambda name, count: done.append(count),
    )
    assert tuning.runs / 3 < sum(done) <= tuning.runs
    assert result.comparison.gain == pytest.approx(0.1 * np.log(4), abs=0.05)
    assert result.comparison.is_significant
    assert [name for name, value in result.values.items() if value != tune.own[name]] == [NOISE]


def test_sequences_are_tested_with_values_found_without_them(tune):
    """Only one sequence likes another value, so the others do not suggest it."""
    result, _ = tune(
        Formula(lambda name: OWN_NOISE * (6 if name == "sequence0" else 1), noise=0), trials=12
    )
    name, before, after = result.comparison.rows[0]
    assert name == "sequence0"
    assert after == before


def test_a_killed_run_continues_as_if_it_had_not_been_killed(tune, tmp_path):
    few = {"trials": 11, "sequences": 5, "folds": 2}
    whole = Formula(3 * OWN_NOISE)
    expected, _ = tune(whole, **few)
    finished = 0
    for number in range(100):
        executor = KilledFormula(3 * OWN_NOISE, 20 + 10 * number)
        try:
            with journal.open_journal(tmp_path / "mine.journal") as storage:
                result, _ = tune(executor, storage=storage, **few)
            break
        except Killed:
            finished += len(executor.tasks)
            # A write that a full disk has cut off.
            with (tmp_path / "mine.journal").open("ab") as file:
                file.write(b'{"op_code":')
    assert number > 1
    assert result.values == expected.values
    np.testing.assert_array_equal(result.comparison.tuned, expected.comparison.tuned)
    # Each time, the evaluation under way is lost.
    assert finished + len(executor.tasks) == len(whole.tasks) + number


def test_a_finished_run_is_extended_by_more_trials(tune, tmp_path):
    with journal.open_journal(tmp_path / "mine.journal") as storage:
        tune(Formula(OWN_NOISE), trials=2, storage=storage)
        more = Formula(OWN_NOISE)
        _, tuning = tune(more, trials=3, storage=storage)
    assert tuning.trials == 3
    # The third trial on eight sequences, and the comparison of other values.
    assert 8 <= len(more.tasks) <= 8 * 3


def test_a_journal_of_another_run_is_refused(tune, tmp_path):
    with journal.open_journal(tmp_path / "mine.journal") as storage:
        tune(Formula(OWN_NOISE), trials=1, storage=storage)
        with pytest.raises(EvaluationError, match=r"another run \(seeds, sequences differ\)"):
            tune(Formula(OWN_NOISE), trials=1, seeds=3, sequences=7, storage=storage)
        with pytest.raises(EvaluationError, match="another run is writing"):
            journal.open_journal(tmp_path / "mine.journal").__enter__()
    for content in ("a diary of mine", '{"op_code":\n{"op_code":\n'):
        (tmp_path / "mine.journal").write_text(content)
        with pytest.raises(EvaluationError, match="no journal of tune"):
            journal.open_journal(tmp_path / "mine.journal").__enter__()
        assert (tmp_path / "mine.journal").read_text() == content
    os.mkfifo(tmp_path / "pipe.journal")
    with pytest.raises(EvaluationError, match="is a FIFO"):
        journal.open_journal(tmp_path / "pipe.journal").__enter__()


def test_a_journal_with_a_missing_or_changed_line_is_refused(tune, tmp_path):
    path = tmp_path / "mine.journal"
    with journal.open_journal(path) as storage:
        tune(Formula(OWN_NOISE), trials=1, storage=storage)
    lines = path.read_bytes().splitlines(keepends=True)
    with journal.open_journal(path):
        pass
    for number in range(len(lines) - 1):
        edited = lines[number].replace(b'"op_code":', b'"op_code":1', 1)
        for damaged in ([], [edited], [lines[number]] * 2, [b"[" * 10**5 + b"\n"]):
            path.write_bytes(b"".join([*lines[:number], *damaged, *lines[number + 1 :]]))
            with pytest.raises(EvaluationError, match="is no journal of tune, or is damaged"):
                journal.open_journal(path).__enter__()
    # A run that was killed.
    path.write_bytes(b"".join(lines)[:-5])
    with journal.open_journal(path) as storage:
        tune(Formula(OWN_NOISE), trials=1, storage=storage)


def test_a_hopeless_trial_ends_early(tune):
    storage = IN_MEMORY()
    executor = Formula(OWN_NOISE, noise=1e-4)
    tune(executor, given={NOISE: 9 * OWN_NOISE}, trials=2, sequences=12, storage=storage)
    preset, start, *_ = optuna.load_study(study_name="all", storage=storage).get_trials()
    assert [preset.state.name, start.state.name] == ["COMPLETE", "PRUNED"]
    assert len(preset.intermediate_values) == 12
    assert len(start.intermediate_values) == 4


def test_an_evaluation_that_fails_ends_its_trial(tune):
    def failure(task):
        too_large = task.parameters.get(NOISE, 0) > 2 * OWN_NOISE
        return "sequence1: out of memory" if too_large else ""

    executor, given = FailingFormula(5 * OWN_NOISE, failure), {NOISE: 5 * OWN_NOISE}
    result, tuning = tune(executor, given=given, trials=3, sequences=4)
    assert result.values[NOISE] <= 2 * OWN_NOISE
    assert tuning.errors == ["sequence1: out of memory"]


def test_a_parameter_whose_return_to_the_preset_fails_stays(tune):
    """Only the start and the preset can be evaluated, and the start is better."""
    start = {NOISE: 3 * OWN_NOISE, "motion.velocity_noise": 1.5}

    def failure(task):
        changed = sum(task.parameters[name] != tune.own[name] for name in start)
        return "out of memory" if changed == 1 else ""

    executor = FailingFormula(3 * OWN_NOISE, failure)
    result, tuning = tune(executor, given=start, trials=2, sequences=6)
    assert result.values == {**tune.own, **start}
    assert tuning.errors == ["out of memory"]


def test_the_ranges_contain_preset_and_start_within_what_is_declared():
    for preset in PRESETS:
        own = preset_parameters(preset)
        space = search_space(preset, {NOISE: 40.0})
        assert NOISE in space
        assert space[NOISE].high == 40.0
        for name, one in space.items():
            declared = declarations(TrackerParameters)[name]
            assert declared.minimum <= one.low <= own[name] <= one.high <= declared.maximum
            assert one.low < one.high
            assert one.rounded(one.low) == one.low
        # Parameters of the background are tuned only where it is used, weights among others.
        assert ("foreground.sharpness" in space) == (preset == "zhang_bo")
    assert "hog.weight" not in search_space("zhang2015", {})


def test_a_sequence_that_fails_with_the_preset_is_left_aside(tune):
    def failure(task):
        return "sequence1: no image" if task.footage.name == "sequence1" else ""

    result, tuning = tune(FailingFormula(OWN_NOISE, failure), trials=3, sequences=3)
    assert list(result.comparison.names) == ["sequence0", "sequence2"]
    assert tuning.errors == ["sequence1: no image"]
    with pytest.raises(EvaluationError, match="fewer than 2 sequences"):
        tune(FailingFormula(OWN_NOISE, failure), trials=3, sequences=2)


def test_the_interval_of_a_comparison():
    """Student's t with 3 degrees of freedom has its 0.975 quantile at 3.182."""
    gains = np.array([[0.01, 0.03], [0.03, 0.05], [0.00, 0.04], [0.04, 0.08]])
    compared = comparison.Comparison("abcd", np.full((4, 2), 0.5), 0.5 + gains)
    assert compared.gain == pytest.approx(0.035)
    error = np.std([0.02, 0.04, 0.02, 0.06], ddof=1) / 2
    assert compared.interval == pytest.approx((0.035 - 3.182 * error, 0.035 + 3.182 * error), 1e-3)
    # The variances of the seeds' means: 0.0001, 0.0001, 0.0004 and 0.0004.
    assert compared.seed_error == pytest.approx(np.sqrt(0.0010) / 4)
    assert compared.is_significant
    assert not comparison.Comparison("ab", compared.preset[:2], compared.tuned[:2]).is_significant
