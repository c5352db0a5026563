import json
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


@pytest.fixture
def refusal(evaluate):
    """Runs the command; returns its one-line error."""

    def run(*arguments):
        code, output, errors = evaluate(*arguments)
        assert (code, output) == (2, ""), errors
        (line,) = errors.splitlines()
        assert line.startswith("evaluate: error: ")
        return line

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
    evaluate, moving_square_sequence, short_sequence, tmp_path
):
    documents = []
    arguments = ("--preset", "li2007", "--seeds", "2", "--output")
    for name in ("first.json", "second.json"):
        code, _, errors = evaluate(moving_square_sequence, short_sequence, *arguments, name)
        assert code == 0, errors
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


@pytest.mark.usefixtures("moving_square_sequence", "short_sequence")
def test_table_lists_every_sequence_and_the_mean(evaluate, tmp_path):
    arguments = ("--preset", "li2007", "--seeds", "2", "--output", "r.json")
    code, output, errors = evaluate(tmp_path, *arguments)
    assert code == 0, errors
    document = json.loads((tmp_path / "r.json").read_text())
    for name, scores in [*document["sequences"].items(), ("mean", document["mean"])]:
        (line,) = (line for line in output.splitlines() if f"│ {name} " in line)
        assert f"{scores['success_auc']:.3f}" in line
        assert f"{scores['precision_20px']:.3f}" in line
        assert f"{scores['cpu_ms_median']:.2f}" in line


@pytest.mark.usefixtures("short_sequence")
def test_progress_goes_to_a_terminal_on_standard_error_only(evaluate, monkeypatch):
    arguments = ("short", "--preset", "li2007", "--seeds", "1")
    _, _, errors = evaluate(*arguments)
    assert errors == ""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    _, output, errors = evaluate(*arguments)
    assert "5/5" in errors
    assert "5/5" not in output


def test_real_sequence_is_evaluated(sequences_directory, tmp_path):
    output = tmp_path / "result.json"
    arguments = [sequences_directory / "otb_football1", "--seeds", "1", "--output", output]
    assert __main__.main(list(map(str, arguments))) == 0
    scores = json.loads(output.read_text())["sequences"]["otb_football1"]
    assert scores["frames"] == 74
    # Frame 1 alone gives 20/21/74; a tracker that stands still gets a little more.
    assert scores["success_auc"] > 0.2


def test_frames_without_target_are_not_scored(evaluate, short_sequence, tmp_path):
    arguments = ["short", "--preset", "li2007", "--seeds", "1", "--output"]
    lines = (short_sequence / "groundtruth.txt").read_text().splitlines()
    (short_sequence / "groundtruth.txt").rename(short_sequence / "groundtruth_rect.txt")
    lines[2:] = ["nan,nan,nan,nan", "0\t0\t0\t0", lines[4]]
    (short_sequence / "groundtruth_rect.txt").write_text("\n".join(lines))
    code, _, errors = evaluate(*arguments, "r.json")
    assert code == 0, errors
    scores = json.loads((tmp_path / "r.json").read_text())["sequences"]["short"]
    assert scores["frames"] == 5
    assert scores["precision_20px"] == 1


def test_overridden_parameters_are_used_and_recorded(evaluate, short_sequence, tmp_path):
    code, _, errors = evaluate(
        *(short_sequence, "--seeds", "1", "--output", "r.json"),
        *("--parameter", "particles=17", "--parameter", "motion.model=constant_velocity"),
        *("--parameter", "proposal.method=transition", "--parameter", "cues=hog,color_histogram"),
        *("--parameter", "hog.sharpness=90"),
    )
    assert code == 0, errors
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
        (["short", "--parameter", "particles=0"], ["'particles' is 0", "1 to"]),
        (["short", "--parameter", "cues="], ["'cues' is empty", "at least one of"]),
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
@pytest.mark.usefixtures("short_sequence")
def test_missing_package_is_named_with_its_installation(refusal, monkeypatch, package, options):
    monkeypatch.setitem(sys.modules, package, None)
    line = refusal("short", *options)
    assert f"{package} is not installed: pip install {package}" in line


@pytest.mark.usefixtures("short_sequence")
def test_matplotlib_is_not_needed_without_a_plot(evaluate, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    code, _, errors = evaluate("short", "--preset", "li2007", "--seeds", "1")
    assert code == 0, errors


def test_plot_shows_the_preset(short_sequence, tmp_path):
    plot = tmp_path / "success.png"
    assert __main__.main([str(short_sequence), "--seeds", "1", "--plot", str(plot)]) == 0
    image = cv2.imread(str(plot))
    assert min(image.shape[:2]) >= 400
    # The preset's curve is the only thing in color.
    assert (image.max(axis=2) - image.min(axis=2) > 60).any()


def test_a_parameter_file_equals_typed_parameters(evaluate, refusal, short_sequence, tmp_path):
    own = tmp_path / "own.yaml"
    text = "/pf_tracker:\n  ros__parameters: {preset: li2007, particles: 20, seed: 5}\n"
    own.write_text(text)
    documents = []
    for name, arguments in {
        "file.json": ("--params-file", own),
        "typed.json": ("--preset", "li2007", "--parameter", "particles=20"),
    }.items():
        given = (short_sequence, *arguments, "--seeds", "1", "--output", name)
        code, output, errors = evaluate(*given)
        assert code == 0, errors
        assert output.startswith("preset li2007, 1 value changed; 1 seed")
        documents.append(json.loads((tmp_path / name).read_text()))
    assert without_times(documents[0]) == without_times(documents[1])
    own.write_text(text.replace("particles", "particels"))
    error = refusal(short_sequence, "--params-file", own)
    assert f"{own}: no parameter 'particels'" in error
    own.write_text(text.replace("preset", "max_targets: 4, preset"))
    error = refusal(short_sequence, "--params-file", own)
    assert f"{own}: parameter 'max_targets' is 4; allowed: 1, as a Tracker has one target" in error
