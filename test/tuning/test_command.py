"""The command `tune`."""

import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from subprocesses import wait_until

from pf_tracker_ros.parameter_files import read_parameter_file
from pf_tracker_ros.tuning import __main__
from pf_tracker_ros.tuning.search_space import CUE_RANGES, RANGES

optuna = pytest.importorskip("optuna")
pytest.importorskip("scipy")
pytest.importorskip("jinja2")

FEW = ("--preset", "li2007", "--trials", "3", "--folds", "2", "--seeds", "1")


@pytest.fixture
def folder(write_sequence, moving_square, tmp_path, monkeypatch):
    """The current folder, with sequences in `sequences`."""
    for name in ("left", "right"):
        write_sequence(
            name, moving_square.images[:4], moving_square.boxes[:4], tmp_path / "sequences"
        )
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_parameters_and_report_are_written_and_the_run_is_extended(folder, capsys):
    arguments = ["sequences", *FEW, "--folds", "3", "--parameter", "particles=20"]
    arguments += ["--output", "mine.yaml"]
    assert __main__.main(arguments) == 0
    printed = capsys.readouterr().out
    assert "on sequences left out, the success AUC changes from" in printed
    assert "mine.yaml has the parameters, mine.html the report" in printed
    settings = read_parameter_file(folder / "mine.yaml")
    assert (settings.preset, settings.parameters) == ("li2007", {"particles": 20})
    page = (folder / "mine.html").read_text()
    assert "<td>left</td>" in page
    assert "<td>right</td>" in page
    before = (folder / "mine.yaml").read_bytes()
    assert __main__.main(arguments) == 0
    assert (folder / "mine.yaml").read_bytes() == before
    assert __main__.main([*arguments, "--seeds", "2"]) == 2
    assert "another run (seeds differ); remove it" in capsys.readouterr().err
    assert __main__.main([*arguments, "--trials", "2"]) == 2
    assert "mine.yaml is the result of --trials 3" in capsys.readouterr().err
    assert __main__.main([*arguments, "--folds", "2"]) == 2
    assert "mine.yaml is the result of --folds 3" in capsys.readouterr().err
    assert (folder / "mine.yaml").read_bytes() == before


@pytest.mark.parametrize("name", ["mine.yaml", "mine.html"])
def test_a_result_that_was_changed_by_hand_is_not_replaced(folder, capsys, name):
    arguments = ["sequences", *FEW, "--trials", "1", "--output", "mine.yaml"]
    assert __main__.main(arguments) == 0
    edited = (folder / name).read_text().replace("li2007", "li2007 ", 1)
    (folder / name).write_text(edited)
    assert __main__.main([*arguments, "--trials", "2"]) == 2
    assert f"{name} was changed since tune wrote it, and is not replaced" in capsys.readouterr().err
    assert (folder / name).read_text() == edited
    (folder / name).rename(folder / "edited")
    assert __main__.main([*arguments, "--trials", "2"]) == 0


def test_an_interrupted_extension_keeps_the_finished_result(folder, capsys, monkeypatch):
    arguments = ["sequences", *FEW, "--trials", "1", "--output", "mine.yaml"]
    assert __main__.main(arguments) == 0
    before = (folder / "mine.yaml").read_bytes()

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("pf_tracker_ros.tuning.tuning.Tuning.run", interrupted)
    assert __main__.main([*arguments, "--trials", "2"]) == 130
    assert "mine.yaml keeps its finished result" in capsys.readouterr().err
    assert (folder / "mine.yaml").read_bytes() == before


@pytest.mark.parametrize(
    ("tuned", "told"),
    [
        ([0.5, 0.7], "No search found anything better than the preset; on sequences left out, "),
        ([0.52, 0.7], "found other values, whose gain is not proven: on sequences left out, "),
    ],
)
def test_the_verdict_without_a_change_tells_of_the_searches_without_a_group(tmp_path, tuned, told):
    from pf_tracker_ros.tuning.comparison import Comparison
    from pf_tracker_ros.tuning.output import TuningFiles
    from pf_tracker_ros.tuning.search import TuningRequest
    from pf_tracker_ros.tuning.search_space import search_space
    from pf_tracker_ros.tuning.tuning import TuningResult

    space = search_space("li2007", {}, [])
    request = TuningRequest("li2007", {}, space, trials=1, seeds=1, folds=2, seed=0)
    own, found = (np.repeat([[a], [b]], 5, axis=1) for a, b in ([0.5, 0.7], tuned))
    compared = Comparison(["a", "b"], own, found)
    result = TuningResult(request.own, compared, compared)
    assert told in TuningFiles(tmp_path / "mine.yaml", request).verdict(result)


def test_the_result_does_not_depend_on_the_number_of_processes(folder):
    for jobs in ("1", "2"):
        arguments = ["sequences", *FEW, "--trials", "1", "--jobs", jobs]
        assert __main__.main([*arguments, "--output", f"{jobs}.yaml"]) == 0
    assert (folder / "1.yaml").read_bytes() == (folder / "2.yaml").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["absent"], "no folder 'absent'"),
        (["empty"], "no sequence in 'empty'"),
        (["sequences/left"], "1 sequence to tune on; allowed: at least 2"),
        (["unlabeled"], "error: ground truth "),
        (["sequences", "--preset", "best"], "no preset 'best'"),
        (["sequences", "--params-file", "bad.yaml"], "bad.yaml cannot be read as YAML"),
        (["sequences", "--parameter", "particles=0"], "'particles' is 0"),
        (["sequences", "--only", "particles"], "'particles' cannot be tuned here; allowed: "),
        (["sequences", "--output", "own.yaml"], "own.yaml exists, and no own.journal"),
        (["sequences", "--output", "mine.txt"], "mine.txt; allowed: a file name that ends in .ya"),
        (["sequences", "--output", "."], "--output .; allowed: a file name that ends in .yaml"),
        (["sequences", "--output", "nowhere/mine.yaml"], "no folder nowhere"),
    ],
)
def test_a_wrong_request_is_refused(folder, capsys, arguments, reason):
    (folder / "empty").mkdir()
    (folder / "unlabeled" / "right" / "img").mkdir(parents=True)
    (folder / "bad.yaml").write_text("a: [")
    (folder / "own.yaml").write_text("")
    if "--output" not in arguments:
        arguments = [*arguments, "--output", "mine.yaml"]
    assert __main__.main(arguments) == 2
    assert reason in capsys.readouterr().err
    assert not (folder / "mine.journal").exists()


def test_a_missing_package_is_named_with_its_extra(folder, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    assert __main__.main(["sequences", "--output", "mine.yaml"]) == 2
    assert "optuna is not installed: pip install optuna, or '.[tune]'" in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_run_keeps_its_trials(folder, start_module, number):
    def start():
        given = ("sequences", *FEW, "--trials", "9999", "--output", "mine.yaml")
        return start_module("tuning", *given)

    journal = folder / "mine.journal"

    def wait_for(size):
        wait_until(lambda: journal.exists() and journal.stat().st_size >= size)

    process = start()
    wait_for(40_000)
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    if number == signal.SIGINT:
        assert process.returncode == 130
        assert errors == "tune: interrupted; mine.yaml has the best values so far\n"
        assert "# Interrupted after" in (folder / "mine.yaml").read_text()
        assert read_parameter_file(folder / "mine.yaml").preset == "li2007"
    before = finished_trials(journal)
    process = start()
    wait_for(journal.stat().st_size + 30_000)
    process.kill()
    process.communicate()
    after = finished_trials(journal)
    assert len(after) > len(before) > 0
    assert after[: len(before)] == before
    # What was finished is not done again.
    assert all(after.count(one) == 1 for one in after)


def finished_trials(journal):
    """Parameters of the finished trials on all sequences, in order."""
    from pf_tracker_ros.tuning.journal import open_journal

    with open_journal(journal) as storage:
        study = optuna.load_study(study_name="all", storage=storage)
        trials = study.get_trials(states=[optuna.trial.TrialState.COMPLETE])
        return [trial.params for trial in trials]


def test_the_page_of_the_documentation_lists_the_tuned_parameters():
    text = (Path(__file__).parents[2] / "docs" / "tuning.md").read_text(encoding="utf-8")
    for name in (*RANGES, *(f"<cue>.{parameter}" for parameter in CUE_RANGES)):
        assert f"`{name}`" in text, name
