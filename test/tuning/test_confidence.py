"""Fit of the confidence to sequences with ground truth."""

import numpy as np
import pytest

from pf_tracker_ros.evaluation import EvaluationError
from pf_tracker_ros.parameter_files import read_parameter_file
from pf_tracker_ros.tracking.assessment import ConfidenceCalibration
from pf_tracker_ros.tuning import __main__

optuna = pytest.importorskip("optuna")
pytest.importorskip("scipy")
pytest.importorskip("jinja2")
pytest.importorskip("matplotlib")
confidence = pytest.importorskip("pf_tracker_ros.tuning.confidence")
run = pytest.importorskip("pf_tracker_ros.tuning.confidence_run")
output = pytest.importorskip("pf_tracker_ros.tuning.confidence_output")

PLAIN = ConfidenceCalibration()
PLANTED = ConfidenceCalibration(0.5, 1.0)
# Undoes the planted one: x / 0.5 - 1 / 0.5.
INVERSE = ConfidenceCalibration(2.0, -2.0)
SEQUENCES, FRAMES = 10, 400


def labeled(seed, planted=PLAIN):
    """Frames that are right with their confidence as probability, which is then miscalibrated.

    The mean confidence of the sequences differs.
    """
    generator = np.random.default_rng(seed)
    sequences = []
    for number in range(SEQUENCES):
        odds = generator.normal(0.5 * number - 2.0, 1.5, (2, FRAMES))
        probability = 1 / (1 + np.exp(-odds))
        is_right = generator.random(probability.shape) < probability
        reported = planted.apply(probability)
        sequences.append(confidence.LabeledConfidences(f"{number}", reported, is_right))
    return sequences


def test_a_planted_miscalibration_is_undone():
    sequences = labeled(0, PLANTED)
    result = confidence.calibrate(sequences, folds=4)
    assert result.calibration.scale == pytest.approx(INVERSE.scale, abs=0.15)
    assert result.calibration.offset == pytest.approx(INVERSE.offset, abs=0.15)
    assert result.is_better
    assert confidence.calibration_error(result.before) > 0.1
    assert confidence.calibration_error(result.left_out) < 0.03


@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_claimed_where_the_confidence_is_calibrated(seed):
    result = confidence.calibrate(labeled(seed), folds=4)
    assert not result.is_better
    assert result.calibration.scale == pytest.approx(1.0, abs=0.1)
    assert result.calibration.offset == pytest.approx(0.0, abs=0.1)


def test_a_sequence_is_tested_with_a_fit_that_has_not_seen_it():
    sequences = labeled(1, PLANTED)
    result = confidence.calibrate(sequences, folds=5)
    without = confidence.fit(sequences[2:])
    for before, after in zip(sequences[:2], result.left_out[:2], strict=True):
        np.testing.assert_array_equal(after.confidence, without.apply(before.confidence))


@pytest.mark.parametrize("is_right", [True, False])
def test_frames_that_are_all_right_or_wrong_have_a_fit(is_right):
    flat = [
        confidence.LabeledConfidences(name, np.full((1, 50), 0.6), np.full((1, 50), is_right))
        for name in "ab"
    ]
    result = confidence.calibrate(flat, folds=2)
    assert not result.is_better
    assert abs(result.calibration.apply(0.6) - is_right) < 0.05
    assert np.isnan(confidence.roc_area(flat))


def test_figures_by_hand():
    """A sequence of four frames and one of two have the same weight."""
    longer = confidence.LabeledConfidences(
        "a", np.array([[0.25, 0.75, 0.75, 0.75]]), np.array([[False, True, True, False]])
    )
    shorter = confidence.LabeledConfidences("b", np.array([[0.25, 1.0]]), np.array([[True, True]]))
    rows = {row.low: row for row in confidence.reliability([longer, shorter]) if row.share}
    assert list(rows) == [0.2, 0.7, 0.9]
    assert rows[0.2] == pytest.approx((0.2, 0.3, 3 / 8, 0.25, 2 / 3))
    assert rows[0.7] == pytest.approx((0.7, 0.8, 3 / 8, 0.75, 2 / 3))
    expected = 3 / 8 * (2 / 3 - 0.25) + 3 / 8 * (0.75 - 2 / 3)
    assert confidence.calibration_error([longer, shorter]) == pytest.approx(expected)
    assert longer.brier_scores == pytest.approx([(3 * 0.25**2 + 0.75**2) / 4])
    # Right: 0.25, 0.75, 0.75 and 1 with weights 2, 1, 1 and 2; wrong: 0.25 and 0.75.
    area = ((2 / 2 + 1 + 1 + 2) + (2 / 2 + 2)) / 2 / 6
    assert confidence.roc_area([longer, shorter]) == pytest.approx(area)


@pytest.fixture
def folder(write_sequence, moving_square, tmp_path, monkeypatch):
    """The current folder, with two sequences in `sequences`.

    The boxes are right in one and wrong in the other. In both, the target is absent at the end.
    """
    for name, offset in (("left", 0), ("right", 60)):
        boxes = np.array(moving_square.boxes[:5], dtype=float)
        boxes[1:, 1] += offset
        boxes[4] = np.nan
        write_sequence(name, moving_square.images[:5], boxes, tmp_path / "sequences")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def arguments(*more):
    few = ("--preset", "li2007", "--seeds", "2", "--folds", "2", "--parameter", "particles=20")
    return ["sequences", "--confidence", *few, "--output", "mine.yaml", *more]


def test_the_command_writes_parameters_and_report(folder, capsys, monkeypatch):
    earlier = ("--parameter", f"{run.PARAMETER}=[0.5, 1.0]")
    assert __main__.main(arguments(*earlier)) == 0
    printed = capsys.readouterr().out
    assert "on sequences left out, the Brier score changes from" in printed
    written = read_parameter_file(folder / "mine.yaml")
    # Of two sequences, nothing is proven, and the earlier calibration is not kept.
    assert (written.preset, written.parameters) == ("li2007", {"particles": 20})
    assert f"#   {run.PARAMETER}: [" in (folder / "mine.yaml").read_text()
    page = (folder / "mine.html").read_text()
    assert "<svg" in page
    assert "<td>left</td>" in page
    before = (folder / "mine.yaml").read_bytes()
    # The journal has all evaluations.
    monkeypatch.setattr(run, "labeled_frames", None)
    assert __main__.main(arguments()) == 0
    assert (folder / "mine.yaml").read_bytes() == before


def test_an_absent_target_is_wrong_and_a_better_calibration_is_used(folder, monkeypatch, capsys):
    frames = []

    def calibrated(labeled, folds):
        frames.extend(labeled)
        return confidence.CalibrationResult(INVERSE, worse, better)

    worse = labeled(0, PLANTED)
    better = [one.calibrated(INVERSE) for one in worse]
    monkeypatch.setattr(run, "calibrate", calibrated)
    assert __main__.main(arguments()) == 0
    assert [one.is_right.shape for one in frames] == [(2, 4), (2, 4)]
    assert not any(one.is_right[:, -1].any() for one in frames)
    assert frames[0].is_right.any()
    assert not frames[1].is_right.any()
    assert "used: track.confidence_calibration: scale 2, offset -2" in capsys.readouterr().out
    written = read_parameter_file(folder / "mine.yaml").parameters
    assert written == {"particles": 20, run.PARAMETER: (2.0, -2.0)}


@pytest.mark.parametrize("more", [("--trials", "3"), ("--only", "motion.position_noise")])
def test_options_of_the_search_are_refused(folder, capsys, more):
    assert __main__.main(arguments(*more)) == 2
    assert "allowed: no --trials and no --only with it" in capsys.readouterr().err


def test_a_journal_of_a_search_is_refused(folder):
    from pf_tracker_ros.tuning.journal import open_journal
    from pf_tracker_ros.tuning.tuning import RUN, check_tuning_request

    with open_journal(folder / "mine.journal") as storage:
        study = optuna.create_study(storage=storage, study_name=RUN)
        check_tuning_request(study, {"preset": "li2007", "ranges": {}}, [])
        request = run.ConfidenceRequest("li2007", {}, seeds=1, folds=2)
        with pytest.raises(EvaluationError, match="of another run"):
            run.ConfidenceRun(request, [], storage, None)


@pytest.mark.parametrize(("is_right", "remedy"), [(True, "add footage"), (False, "check the gr")])
def test_footage_that_fits_nothing_is_reported_with_the_remedy(tmp_path, is_right, remedy):
    one = confidence.LabeledConfidences("all", np.full((1, 9), 0.9), np.full((1, 9), is_right))
    request = run.ConfidenceRequest("li2007", {}, seeds=1, folds=2)
    files = output.CalibrationFiles(tmp_path / "mine.yaml", request)
    assert remedy in files.verdict(confidence.calibrate([one, one], folds=2))
