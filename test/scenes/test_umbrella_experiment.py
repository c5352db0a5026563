"""The umbrella experiment: its measures by hand, and its finding on a few scenes."""

import importlib
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
FRAMES = 180


@pytest.fixture
def benchmark(monkeypatch):
    """Imports a module of the benchmarks' folder, where they find each other as scripts do."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module


@pytest.fixture
def experiment(benchmark):
    return benchmark("umbrellas")


def boxes_at(xs):
    xs = np.broadcast_to(xs, FRAMES).astype(float)
    return np.stack([xs, np.full(FRAMES, 100.0), np.full(FRAMES, 40.0), np.full(FRAMES, 40.0)], 1)


def shifted(boxes, right, down):
    return boxes + np.array([right, down, 0.0, 0.0])


@pytest.fixture
def crossing():
    """Target and other umbrella walk towards and past each other, 4 px a frame; meeting in 90."""
    times = np.arange(FRAMES) - 90.0
    return boxes_at(300 + 2 * times), boxes_at(300 - 2 * times)


def test_an_estimate_on_the_target_holds_it(experiment, crossing):
    target, other = crossing
    assert experiment.outcome(target, target, other) == "held"
    assert experiment.outcome(shifted(target, 15.0, 0.0), target, other) == "held"


def test_an_estimate_that_goes_with_the_other_umbrella_switched(experiment, crossing):
    target, other = crossing
    estimate = np.concatenate([target[:91], other[91:]])
    assert experiment.outcome(estimate, target, other) == "switched"


def test_half_a_second_on_the_wrong_umbrella_is_a_switch_even_if_it_comes_back(
    experiment, crossing
):
    target, other = crossing
    for frames, expected in ((11, "held"), (12, "switched")):
        estimate = target.copy()
        estimate[120 : 120 + frames] = other[120 : 120 + frames]
        assert experiment.outcome(estimate, target, other) == expected


def test_only_time_after_the_meeting_and_apart_counts(experiment, crossing):
    target, other = crossing
    early = np.concatenate([other[:60], target[60:]])
    assert experiment.outcome(early, target, other) == "held"
    # Boxes are 40 px wide and part by 4 px a frame: apart from 11 frames after the meeting on.
    beside = np.concatenate([target[:90], other[90:101], target[101:]])
    assert experiment.outcome(beside, target, other) == "held"


def test_an_estimate_that_stays_behind_is_lost(experiment, crossing):
    target, other = crossing
    assert experiment.outcome(boxes_at(600.0), target, other) == "lost"
    assert experiment.outcome(shifted(target, 21.0, 0.0), target, other) == "lost"


def test_jitter_is_of_the_change_of_the_error_and_not_of_the_error(experiment, crossing):
    target, _ = crossing
    assert experiment.jitter(shifted(target, 7.0, -3.0), target) == 0.0
    shaken = target.copy()
    shaken[::2, 0] += 3.0
    shaken[::2, 1] += 4.0
    assert experiment.jitter(shaken, target) == pytest.approx(5.0)


def test_color_alone_switches_and_texture_holds(experiment):
    outcomes = {setting.name: [] for setting in experiment.SETTINGS}
    for seed in range(5):
        for run in experiment.run_scene(seed):
            outcomes[run.setting].append(run.outcome)
    color, few, many = outcomes.values()
    assert color.count("switched") >= 3
    assert few.count("held") >= 4
    assert many.count("held") >= 4


def test_runs_are_the_same_to_the_bit(experiment):
    color = experiment.SETTINGS[:1]
    first, again = (experiment.run_scene(3, settings=color)[0] for _ in range(2))
    assert np.array_equal(first.errors, again.errors)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seeds", "0"], "'0'; allowed: a whole number of at least 1"),
        (["--seeds", "many"], "'many'; allowed: a whole number"),
        (["--first-seed", "x"], "'x'; allowed: a whole number of at least 0"),
    ],
)
def test_wrong_arguments_are_refused_with_what_is_allowed(experiment, arguments, message, capsys):
    with pytest.raises(SystemExit) as ended:
        experiment.main(arguments)
    assert ended.value.code == 2
    assert message in " ".join(capsys.readouterr().err.split())


def test_the_table_and_the_papers_frames_are_written(experiment, tmp_path, capsys):
    output = tmp_path / "new" / "results"
    assert experiment.main(["--seeds", "1", "--first-seed", "4", "--output", str(output)]) == 0
    assert "Umbrellas, number of scenes: 1" in capsys.readouterr().out
    table = (output / "umbrellas.md").read_text()
    for setting in experiment.SETTINGS:
        assert f"| {setting.name} |" in table
    assert (output / "umbrellas_frames.png").read_bytes().startswith(b"\x89PNG")
