import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import cv2
import pytest

import pf_tracker_ros
from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation import (
    EvaluationError,
    __main__,
    evaluate_sequence,
    read_sequences,
)
from pf_tracker_ros.evaluation.command_line import parse_parameters

SCORES = {"success_auc", "precision_20px", "cpu_ms_median", "frames"}
PACKAGES = Path(pf_tracker_ros.__file__).parents[1]


def evaluate(*arguments, directory, path=(), **environment):
    """Run the command in a process of its own, with folders in front of the module path."""
    module_path = os.pathsep.join(map(str, (*path, PACKAGES)))
    # A set FORCE_COLOR makes Rich take any output for a terminal.
    inherited = {name: value for name, value in os.environ.items() if name != "FORCE_COLOR"}
    return subprocess.run(
        [sys.executable, "-m", "pf_tracker_ros.evaluation", *map(str, arguments)],
        cwd=directory,
        env={**inherited, "PYTHONPATH": module_path, **environment},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def refused_line(code, output, errors):
    """The one-line error of an invalid request."""
    assert (code, output) == (2, ""), errors
    (line,) = errors.splitlines()
    assert line.startswith("evaluate: error: ")
    return line


@pytest.fixture
def refusal(tmp_path, monkeypatch, capsys):
    """Runs the command in this process, in the test's folder; returns its one-line error."""

    def run(*arguments):
        monkeypatch.chdir(tmp_path)
        try:
            code = __main__.main([str(argument) for argument in arguments])
        except SystemExit as ended:
            code = ended.code
        printed = capsys.readouterr()
        return refused_line(code, printed.out, printed.err)

    return run


def without_times(document):
    return {
        **document,
        "sequences": {
            name: {key: value for key, value in scores.items() if key != "cpu_ms_median"}
            for name, scores in document["sequences"].items()
        },
        "mean": {key: value for key, value in document["mean"].items() if key != "cpu_ms_median"},
    }


def test_the_result_has_the_fixed_layout_and_is_reproducible(
    moving_square_sequence, short_sequence, tmp_path
):
    documents = []
    for name in ("first.json", "second.json"):
        done = evaluate(
            *(moving_square_sequence, short_sequence),
            *("--preset", "li2007", "--seeds", "2", "--output", name),
            directory=tmp_path,
        )
        assert done.returncode == 0, done.stderr
        documents.append(json.loads((tmp_path / name).read_text()))
    document = documents[0]
    assert set(document) == {"preset", "seeds", "sequences", "mean"}
    assert document["preset"] == "li2007"
    assert document["seeds"] == 2
    assert list(document["sequences"]) == ["moving_square", "short"]
    assert all(set(scores) == SCORES for scores in document["sequences"].values())
    assert document["sequences"]["moving_square"]["frames"] == 20
    assert document["mean"].keys() == SCORES
    for key in SCORES:
        values = [scores[key] for scores in document["sequences"].values()]
        assert document["mean"][key] == pytest.approx(sum(values) / 2)
    assert without_times(documents[0]) == without_times(documents[1])

    (footage,) = read_sequences([moving_square_sequence])
    scores = evaluate_sequence(footage, partial(Tracker.from_preset, "li2007"), [0, 1]).scores
    assert document["sequences"]["moving_square"]["success_auc"] == scores.success_auc
    assert document["sequences"]["moving_square"]["precision_20px"] == scores.precision_20px


def test_table_lists_every_sequence_and_the_mean(moving_square_sequence, short_sequence, tmp_path):
    done = evaluate(
        tmp_path, "--preset", "li2007", "--seeds", "2", "--output", "r.json", directory=tmp_path
    )
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "r.json").read_text())
    for name, scores in [*document["sequences"].items(), ("mean", document["mean"])]:
        (line,) = (line for line in done.stdout.splitlines() if f"│ {name} " in line)
        assert f"{scores['success_auc']:.3f}" in line
        assert f"{scores['precision_20px']:.3f}" in line
        assert f"{scores['cpu_ms_median']:.2f}" in line


def test_progress_goes_to_a_terminal_on_standard_error_only(short_sequence, tmp_path):
    arguments = ("short", "--preset", "li2007", "--seeds", "1")
    quiet = evaluate(*arguments, directory=tmp_path)
    assert quiet.stderr == ""
    terminal = evaluate(*arguments, directory=tmp_path, FORCE_COLOR="1", TERM="xterm")
    assert "5/5" in terminal.stderr
    assert "5/5" not in terminal.stdout


@pytest.mark.parametrize("preset", ["default", "li2007"])
def test_presets_follow_the_moving_square(preset, moving_square_sequence, tmp_path):
    output = tmp_path / "result.json"
    arguments = [moving_square_sequence, "--preset", preset, "--seeds", "2", "--output", output]
    assert __main__.main(list(map(str, arguments))) == 0
    mean = json.loads(output.read_text())["mean"]
    assert mean["success_auc"] > 0.6
    assert mean["precision_20px"] == 1
    assert mean["cpu_ms_median"] > 0


def test_real_sequence_is_evaluated(sequences_directory, tmp_path):
    output = tmp_path / "result.json"
    arguments = [sequences_directory / "otb_football1", "--seeds", "1", "--output", output]
    assert __main__.main(list(map(str, arguments))) == 0
    scores = json.loads(output.read_text())["sequences"]["otb_football1"]
    assert scores["frames"] == 74
    # Frame 1 alone gives 20/21/74; a tracker that stands still gets a little more.
    assert scores["success_auc"] > 0.2


def test_frames_without_target_are_not_scored(short_sequence, tmp_path):
    arguments = ["short", "--preset", "li2007", "--seeds", "1", "--output"]
    lines = (short_sequence / "groundtruth.txt").read_text().splitlines()
    (short_sequence / "groundtruth.txt").rename(short_sequence / "groundtruth_rect.txt")
    lines[2:] = ["nan,nan,nan,nan", "0\t0\t0\t0", lines[4]]
    (short_sequence / "groundtruth_rect.txt").write_text("\n".join(lines))
    done = evaluate(*arguments, "r.json", directory=tmp_path)
    assert done.returncode == 0, done.stderr
    scores = json.loads((tmp_path / "r.json").read_text())["sequences"]["short"]
    assert scores["frames"] == 5
    assert scores["precision_20px"] == 1


def test_overridden_parameters_are_used_and_recorded(short_sequence, tmp_path):
    done = evaluate(
        *(short_sequence, "--seeds", "1", "--output", "r.json"),
        *("--parameter", "particles=17", "--parameter", "motion.model=constant_velocity"),
        *("--parameter", "proposal.method=transition", "--parameter", "cues=hog,color_histogram"),
        *("--parameter", "hog.sharpness=90"),
        directory=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "r.json").read_text())
    assert document["parameters"] == {
        "particles": 17,
        "motion.model": "constant_velocity",
        "proposal.method": "transition",
        "cues": ["hog", "color_histogram"],
        "hog.sharpness": 90.0,
    }


def test_parameters_are_read_by_their_declared_type():
    values = parse_parameters(
        ["particles = 50", "track.lost_after=1e-2", "motion.model=constant_velocity"]
    )
    assert values == {
        "particles": 50,
        "track.lost_after": 0.01,
        "motion.model": "constant_velocity",
    }
    assert type(values["particles"]) is int


def test_parameters_are_read_by_their_type():
    values = parse_parameters(
        ["hog.sharpness=5", "motion.velocity_noise=1", "redetection.windows=3"]
    )
    assert values == {
        "hog.sharpness": 5.0,
        "motion.velocity_noise": 1.0,
        "redetection.windows": 3,
    }
    assert [type(value) for value in values.values()] == [float, float, int]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("cues=hog,color_contrast", ("hog", "color_contrast")),
        ("cues=[ hog , color_contrast ]", ("hog", "color_contrast")),
        ("cues=[\"hog\", 'color_contrast']", ("hog", "color_contrast")),
        ("cues=hog", ("hog",)),
        ("cues=[]", ()),
        ("cues=", ()),
        ("motion.drift=[1, -2e-1]", (1.0, -0.2)),
        ("motion.drift=1,2", (1.0, 2.0)),
        ("motion.drift=1,b", "1,b"),
    ],
)
def test_a_list_is_written_with_commas(text, value):
    assert list(parse_parameters([text]).values()) == [value]


@pytest.mark.parametrize("text", ["particles", "=3", ""])
def test_parameter_without_name_or_value_is_refused(text):
    with pytest.raises(EvaluationError, match="NAME=VALUE"):
        parse_parameters([text])


def test_parameter_given_twice_is_refused():
    with pytest.raises(EvaluationError, match="particles is given more than once"):
        parse_parameters(["particles=1", "particles=2"])


@pytest.mark.parametrize(
    ("arguments", "reasons"),
    [
        (["absent"], ["no folder 'absent'", "allowed"]),
        (["empty"], ["no sequence in 'empty'", "groundtruth.txt or groundtruth_rect.txt"]),
        (["short", "--preset", "best"], ["'best'", "default", "li2007"]),
        (["short", "--parameter", "particle=3"], ["no parameter 'particle'", "particles"]),
        (["short", "--parameter", "particles=many"], ["'particles' is 'many'", "1 to"]),
        (["short", "--parameter", "particles=0"], ["'particles' is 0", "1 to"]),
        (
            ["short", "--parameter", "track.lost_after=nan"],
            ["'track.lost_after' is nan", "to 3600"],
        ),
        (["short", "--parameter", "cues=hog,smell"], ["'cues' is ('hog', 'smell')", "'hog'"]),
        (["short", "--parameter", "cues="], ["'cues' is empty", "at least one of"]),
        (["short", "--parameter", "hog.sharpness=-2"], ["'hog.sharpness' is -2.0", "0 to 1000"]),
        (["short", "--parameter", "wings=1"], ["no parameter 'wings'; there are: "]),
        (
            ["short", "--parameter", "hog.sharpnes=1"],
            ["no parameter 'hog.sharpnes'; did you mean 'hog.sharpness'?"],
        ),
        (["short", "--seeds", "0"], ["--seeds", "'0'", "from 1"]),
        (["short", "--jobs", "two"], ["--jobs", "'two'", "from 1"]),
        (["short", "--output", "nowhere/r.json"], ["no folder nowhere"]),
        (["short", "--output", "empty"], ["empty is a folder"]),
        (["short", "--output", "/dev/null"], ["/dev/null is no regular file"]),
        (["short", "--output", "/proc/r.json"], ["/proc/r.json cannot be written"]),
        (["short", "--plot", "/proc/p.png"], ["/proc/p.png cannot be written"]),
        (["short", "--plot", "plot.txt"], ["plot.txt", "png"]),
        (["short", "--wrong"], ["--wrong", "--help"]),
        ([], ["SEQUENCE_DIR", "--help"]),
    ],
)
@pytest.mark.usefixtures("short_sequence")
def test_wrong_request_is_refused_in_one_line(refusal, arguments, reasons, tmp_path):
    (tmp_path / "empty").mkdir()
    line = refusal(*arguments)
    assert all(reason in line for reason in reasons), line


@pytest.mark.parametrize(
    ("ground_truth", "reasons"),
    [
        ("1,2,3,4\n" * 4, ["5 frames", "4 boxes"]),
        ("1,2,3,4\n" * 6, ["5 frames", "6 boxes"]),
        ("1,2,3,4\n1,2,3\n" + "1,2,3,4\n" * 3, ["groundtruth.txt, line 2", "x,y,width,height"]),
        ("", ["groundtruth.txt is empty"]),
        ("nan,nan,nan,nan\n" + "1,2,3,4\n" * 4, ["short: the target is absent in the first frame"]),
        ("0,0,0,0\n" + "1,2,3,4\n" * 4, ["short: the target is absent in the first frame"]),
    ],
)
def test_broken_sequence_is_refused_in_one_line(
    refusal, ground_truth, reasons, short_sequence, tmp_path
):
    (short_sequence / "groundtruth.txt").write_text(ground_truth)
    line = refusal("short", "--seeds", "1", "--output", "r.json")
    assert all(reason in line for reason in reasons), line
    assert not (tmp_path / "r.json").exists()


@pytest.mark.parametrize(
    ("package", "options"), [("rich", []), ("matplotlib", ["--plot", "p.png"])]
)
def test_missing_package_is_named_with_its_installation(package, options, short_sequence, tmp_path):
    blocked = tmp_path / "blocked"
    blocked.mkdir()
    (blocked / f"{package}.py").write_text("raise ModuleNotFoundError")
    done = evaluate("short", *options, directory=tmp_path, path=[blocked])
    line = refused_line(done.returncode, done.stdout, done.stderr)
    assert f"{package} is not installed: pip install {package}" in line


def test_matplotlib_is_not_needed_without_a_plot(short_sequence, tmp_path):
    blocked = tmp_path / "blocked"
    blocked.mkdir()
    (blocked / "matplotlib.py").write_text("raise ModuleNotFoundError")
    done = evaluate("short", "--seeds", "1", directory=tmp_path, path=[blocked])
    assert done.returncode == 0, done.stderr


def test_processes_give_the_same_scores(moving_square_sequence, short_sequence, tmp_path):
    documents = []
    for jobs in ("1", "2"):
        done = evaluate(
            *("moving_square", "short", "--preset", "li2007", "--seeds", "2"),
            *("--jobs", jobs, "--output", f"{jobs}.json"),
            directory=tmp_path,
        )
        assert done.returncode == 0, done.stderr
        documents.append(json.loads((tmp_path / f"{jobs}.json").read_text()))
    assert without_times(documents[0]) == without_times(documents[1])


def test_plot_shows_the_preset(short_sequence, tmp_path):
    plot = tmp_path / "success.png"
    assert __main__.main([str(short_sequence), "--seeds", "1", "--plot", str(plot)]) == 0
    image = cv2.imread(str(plot))
    assert min(image.shape[:2]) >= 400
    # The preset's curve is the only thing in color.
    assert (image.max(axis=2) - image.min(axis=2) > 60).any()


def test_a_parameter_file_equals_typed_parameters(refusal, short_sequence, tmp_path):
    own = tmp_path / "own.yaml"
    text = "/pf_tracker:\n  ros__parameters: {preset: li2007, particles: 20, seed: 5}\n"
    own.write_text(text)
    documents = []
    for name, arguments in {
        "file.json": ("--params-file", own),
        "typed.json": ("--preset", "li2007", "--parameter", "particles=20"),
    }.items():
        given = (short_sequence, *arguments, "--seeds", "1", "--output", name)
        done = evaluate(*given, directory=tmp_path)
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith("preset li2007, 1 value changed; 1 seed")
        documents.append(json.loads((tmp_path / name).read_text()))
    assert without_times(documents[0]) == without_times(documents[1])
    own.write_text(text.replace("particles", "particels"))
    error = refusal(short_sequence, "--params-file", own)
    assert f"{own}: no parameter 'particels'" in error
    own.write_text(text.replace("preset", "max_targets: 4, preset"))
    error = refusal(short_sequence, "--params-file", own)
    assert f"{own}: parameter 'max_targets' is 4; allowed: 1, as a Tracker has one target" in error
