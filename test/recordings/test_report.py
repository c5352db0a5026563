"""The report of a recording has the scores of an evaluation."""

import json
import re

import numpy as np
import pytest

from pf_tracker_ros.evaluation.__main__ import main as evaluate

pytest.importorskip("jinja2")
pytest.importorskip("matplotlib")

QUICK = ("--preset", "li2007", "--parameter", "particles=20")


def figures(page):
    found = re.findall(r'<td data-figure="(\w+)" data-value="([^"]*)"', page)
    return {name: float(value) for name, value in found}


def test_its_scores_equal_those_of_the_evaluation(track, moving_square_sequence, tmp_path):
    output = tmp_path / "out"
    assert track(moving_square_sequence, "--output", output, *QUICK, "--report")[0] == 0
    result = tmp_path / "r.json"
    arguments = [str(moving_square_sequence), *QUICK, "--seeds", "1", "--output", str(result)]
    assert evaluate(arguments) == 0
    expected = json.loads(result.read_text())["sequences"]["moving_square"]
    found = figures((output / "report.html").read_text())
    for name in ("success_auc", "precision_20px", "frames"):
        assert found[name] == expected[name]
    assert 0 < expected["success_auc"] < 0.95


def test_it_is_written_to_the_given_folder(track, moving_square_sequence, tmp_path):
    arguments = (*QUICK, "--report", tmp_path / "elsewhere")
    assert track(moving_square_sequence, "--output", tmp_path / "out", *arguments)[0] == 0
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["boxes.csv"]
    assert [path.name for path in (tmp_path / "elsewhere").iterdir()] == ["report.html"]
    code, _, errors = track(moving_square_sequence, "--output", tmp_path / "more", *arguments)
    assert code == 4
    assert "report.html exists already" in errors
    assert not (tmp_path / "more").exists()


def test_it_can_be_written_to_the_current_folder(
    track, moving_square_sequence, monkeypatch, tmp_path
):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    arguments = (*QUICK, "--report", ".")
    assert track(moving_square_sequence, "--output", tmp_path / "out", *arguments)[0] == 0
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["boxes.csv"]
    assert [path.name for path in (tmp_path / "here").iterdir()] == ["report.html"]


def test_without_truth_it_shows_the_confidence(track, moving_square_sequence, tmp_path):
    box = ("--box", "20,30,24,24", "--report")
    source = moving_square_sequence / "img"
    assert track(source, "--output", tmp_path / "out", *QUICK, *box)[0] == 0
    page = (tmp_path / "out" / "report.html").read_text()
    assert "success AUC" not in page
    assert "<h3>overlap</h3>" not in page
    assert "<h3>Least confidence</h3>" in page
    assert page.count("data:image/jpeg;base64,") >= 10


def test_frames_before_the_target_and_after_its_loss_are_shown(
    track, moving_square, write_sequence, tmp_path
):
    noise = np.random.default_rng(0).integers(0, 255, (30, 120, 160, 3), dtype=np.uint8)
    images = [*moving_square.images[:8], *noise]
    boxes = np.full((38, 4), np.nan)
    boxes[3:8] = moving_square.boxes[3:8]
    source = write_sequence("gone", images, boxes)
    soon = ("--preset", "li2007", "--parameter", "track.lost_after=0.2", "--report")
    assert track(source, "--output", tmp_path / "out", *soon)[0] == 0
    page = (tmp_path / "out" / "report.html").read_text()
    assert re.search(r"Lost in frames \d+ to 37\.", page)
    assert "<figcaption>frame 0, idle</figcaption>" in page


def test_the_report_covers_the_frames_before_an_unreadable_one(
    track, moving_square_sequence, tmp_path
):
    (moving_square_sequence / "img" / "0013.png").write_bytes(b"not a picture")
    output = tmp_path / "out"
    assert track(moving_square_sequence, "--output", output, *QUICK, "--report")[0] == 3
    page = (output / "report.html").read_text()
    assert figures(page)["frames"] == 12
    assert page.count("<figure><img") >= 8
