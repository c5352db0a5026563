import json
import sys
from functools import partial

import pytest

from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation import EvaluationError, evaluate_sequence, read_sequences
from pf_tracker_ros.evaluation.command_line import parse_parameters

SCORES = {"success_auc", "precision_20px", "cpu_ms_median", "frames"}


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
    of_all = {**document["sequences"], "mean": document["mean"]}
    return {name: {**scores, "cpu_ms_median": None} for name, scores in of_all.items()}


def test_result_and_table_have_the_fixed_layout_and_are_reproducible(
    evaluate, moving_square_sequence, short_sequence, tmp_path, monkeypatch
):
    # It is needed for a plot alone.
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    documents = []
    for name in ("first.json", "second.json"):
        arguments = ("--preset", "li2007", "--seeds", "2", "--output", name)
        code, output, errors = evaluate(tmp_path, *arguments)
        assert (code, errors) == (0, "")
        documents.append(json.loads((tmp_path / name).read_text()))
    document = documents[0]
    sequences, mean = document["sequences"], document["mean"]
    assert document == {"preset": "li2007", "seeds": 2, "sequences": sequences, "mean": mean}
    assert list(sequences) == ["moving_square", "short"]
    assert sequences["moving_square"]["frames"] == 20
    for key in SCORES:
        assert mean[key] == pytest.approx(sum(scores[key] for scores in sequences.values()) / 2)
    assert without_times(documents[0]) == without_times(documents[1])
    (footage,) = read_sequences([moving_square_sequence])
    scores = evaluate_sequence(footage, partial(Tracker.from_preset, "li2007"), [0, 1]).scores
    assert sequences["moving_square"]["success_auc"] == scores.success_auc
    assert sequences["moving_square"]["precision_20px"] == scores.precision_20px
    for name, scores in [*documents[1]["sequences"].items(), ("mean", documents[1]["mean"])]:
        assert scores.keys() == SCORES
        (line,) = (line for line in output.splitlines() if f"│ {name} " in line)
        for key, digits in (("success_auc", 3), ("precision_20px", 3), ("cpu_ms_median", 2)):
            assert f"{scores[key]:.{digits}f}" in line


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


def test_overridden_parameters_are_recorded(evaluate, short_sequence, tmp_path):
    values = ("particles=17", "proposal.method=transition", "cues=hog,color_histogram")
    given = [part for value in values for part in ("--parameter", value)]
    code, _, errors = evaluate(short_sequence, "--seeds", "1", "--output", "r.json", *given)
    assert code == 0, errors
    document = json.loads((tmp_path / "r.json").read_text())
    assert document["parameters"] == {
        **{"particles": 17, "proposal.method": "transition"},
        "cues": ["hog", "color_histogram"],
    }


def test_parameters_are_read_by_their_declared_type():
    texts = ["particles = 50", "track.lost_after=1e-2", "hog.sharpness=5", "motion.model=affine"]
    values = list(parse_parameters(texts).values())
    assert values == [50, 0.01, 5.0, "affine"]
    assert [type(value) for value in values] == [int, float, float, str]


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


@pytest.mark.parametrize(
    ("texts", "reason"),
    [
        *(([text], "NAME=VALUE") for text in ("particles", "=3", "")),
        (["particles=1", "particles=2"], "particles is given more than once"),
    ],
)
def test_parameter_without_name_or_value_or_given_twice_is_refused(texts, reason):
    with pytest.raises(EvaluationError, match=reason):
        parse_parameters(texts)


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
    ("package", "options"), [("rich", []), ("matplotlib", ["--plot", "p.png"])]
)
@pytest.mark.usefixtures("short_sequence")
def test_missing_package_is_named_with_its_installation(refusal, monkeypatch, package, options):
    monkeypatch.setitem(sys.modules, package, None)
    line = refusal("short", *options)
    assert f"{package} is not installed: pip install {package}" in line


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
