"""The report of a recording has the scores of an evaluation."""

import json
import re

import numpy as np
import pytest
from common import QUICK, read_boxes

from pf_tracker_ros.evaluation.__main__ import main as evaluate

pytest.importorskip("jinja2")
pytest.importorskip("matplotlib")

# Waits for an event of the video, unless a property tells that it was.
VIDEO_ONCE = """([event, property]) => new Promise((done) => {
  const video = document.getElementById("video");
  if (video[property]) done(); else video.addEventListener(event, () => done(), { once: true });
})"""


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


def test_it_is_written_to_the_given_folder(track, moving_square_sequence, monkeypatch, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    arguments = (*QUICK, "--report", ".")
    assert track(moving_square_sequence, "--output", tmp_path / "out", *arguments)[0] == 0
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["boxes.csv"]
    assert [path.name for path in (tmp_path / "elsewhere").iterdir()] == ["report.html"]
    code, _, errors = track(moving_square_sequence, "--output", tmp_path / "more", *arguments)
    assert code == 4
    assert "report.html exists already" in errors
    assert not (tmp_path / "more").exists()


def test_without_truth_it_shows_the_confidence(track, moving_square_sequence, tmp_path):
    box = ("--box", "20,30,24,24", "--report")
    source = moving_square_sequence / "img"
    assert track(source, "--output", tmp_path / "out", *QUICK, *box)[0] == 0
    page = (tmp_path / "out" / "report.html").read_text()
    assert "success AUC" not in page
    assert "<h3>overlap</h3>" not in page
    # A square that is never lost needs no look at single frames.
    assert "<p>No frame with a confidence below 0.5.</p>" in page
    assert "<p>No target was out of sight for more than two frames.</p>" in page
    assert page.count("data:image/jpeg;base64,") == 8


def test_the_timeline_seeks_in_the_video(track, moving_square_sequence, browser, tmp_path):
    pytest.importorskip("av", reason="browsers do not play what OpenCV of PyPI writes")
    output, report = tmp_path / "a folder", tmp_path / "report"
    arguments = ("--output", output, *QUICK, "--video", "--report", report)
    assert track(moving_square_sequence, *arguments)[0] == 0
    page = browser.new_page(viewport={"width": 390, "height": 844})
    complaints = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    try:
        page.goto((report / "report.html").as_uri())
        page.evaluate(VIDEO_ONCE, ["loadeddata", "readyState"])
        shown = page.locator("#at")
        assert shown.inner_text().startswith("frame 0, 0.00 s: tracking")
        area = page.locator("#timeline svg").bounding_box()
        page.mouse.click(area["x"] + area["width"] * 12.5 / 20, area["y"] + 5)
        page.get_by_text("frame 12, 0.48 s: ").wait_for()
        page.keyboard.press("ArrowRight")
        page.get_by_text("frame 13, 0.52 s: ").wait_for()
        time = page.evaluate("document.getElementById('video').currentTime")
        assert 13 / 25 < time < 14 / 25
        assert page.locator("#timeline").get_attribute("aria-valuenow") == "13"
        page.keyboard.press(" ")
        page.evaluate(VIDEO_ONCE, ["ended", "ended"])
        page.get_by_text("frame 19, 0.76 s: ").wait_for()
        width = page.evaluate("document.documentElement.scrollWidth")
    finally:
        page.close()
    assert complaints == []
    assert width <= 390


def test_the_names_of_targets_beside_the_timeline_are_not_cut(
    track, moving_square_sequence, browser, tmp_path
):
    targets = tmp_path / "moving_square.target.yaml"
    targets.write_text("{target_box: [20, 30, 24, 24], label: person with an umbrella}")
    output = tmp_path / "out"
    several = ("--parameter", "max_targets=2", "--report")
    assert track(moving_square_sequence, "--output", output, *QUICK, *several)[0] == 0
    page = browser.new_page(viewport={"width": 390, "height": 844})
    try:
        page.goto((output / "report.html").as_uri())
        (name,) = page.locator("#timeline a").all()
        assert name.inner_text() == "target 1 person with an umbrella"
        assert name.evaluate("it => it.scrollWidth <= it.clientWidth")
        # Nor a column of the table.
        table = page.locator(".scrolling:has(#sequences)")
        assert table.evaluate("it => it.scrollWidth <= it.clientWidth")
    finally:
        page.close()


def test_a_loss_is_listed_with_cause_and_end(track, moving_square, write_sequence, tmp_path):
    ground = np.full_like(moving_square.images[0], 90)
    images = [*moving_square.images[:10], *[ground] * 20]
    boxes = np.full((30, 4), np.nan)
    boxes[3:10] = moving_square.boxes[3:10]
    source = write_sequence("gone", images, boxes)
    soon = ("--preset", "li2007", "--parameter", "track.lost_after=0.2", "--report")
    assert track(source, "--output", tmp_path / "out", *soon)[0] == 0
    for row in read_boxes(tmp_path / "out")[3:]:
        assert (row["x"] == "") == (row["state"] == "lost")
        assert row["confidence"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "<figcaption>frame 0, idle</figcaption>" in page
    assert re.search(r"Frames 0 to 29: .*lost in \d+ to 29; ", page)
    (row,) = re.findall(r"<tr><td>target</td>.*?</tr>", page)
    assert re.search(r'data-frame="1\d">1\d to 29</button></td>', row)
    assert re.search(r">occluded in 1\d( to 1\d)?; lost in 1\d to 29</td>", row)
    assert "the confidence fell from" in row
    assert "not found again" in row
    assert "With <code>--video</code> it seeks in the video, too." in page
