"""The report: figures of the results in a self-contained page."""

import json
import os
import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest

from pf_tracker_ros.evaluation.__main__ import main
from pf_tracker_ros.evaluation.reports.content import SequenceContent, forward_fill
from pf_tracker_ros.evaluation.reports.page import Report, Section, changes, read_results, render
from pf_tracker_ros.evaluation.results import EvaluationError, Scores

pytest.importorskip("jinja2")
pytest.importorskip("matplotlib")

HOSTILE = """<img src=x onerror="document.title='hit'"> & $\\frac{"""
RUN = ("--preset", "li2007", "--parameter", "particles=20")


def cells(page):
    """The figures of a page: (sequence, figure) to value."""
    found = {}
    for name, row in re.findall(r'<tr data-sequence="([^"]*)">(.*?)</tr>', page, re.DOTALL):
        for figure, value in re.findall(r'data-figure="(\w+)" data-value="([^"]*)"', row):
            found[unescape(name), figure] = float(value)
    return found


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory, write_sequence_in, moving_square):
    """Folder with a report on two sequences and its results."""
    folder = tmp_path_factory.mktemp("evaluated")
    for name, title, first in (("a", HOSTILE, 0), ("b", "b", 8)):
        # The second ground truth is shifted, for figures below 1.
        boxes = moving_square.boxes[first:] + [3 * first, 0, 0, 0]
        boxes[0] = moving_square.boxes[first]
        write_sequence_in(folder, name, moving_square.images[first:], boxes)
        (folder / name / "meta.json").write_text(json.dumps({"name": title}))
    sources = [str(folder / "a"), str(folder / "b")]
    assert main([*sources, *RUN, "--seeds", "1", "--output", str(folder / "before.json")]) == 0
    report = ["--report", str(folder / "report"), "--compare", str(folder / "before.json")]
    assert main([*sources, *RUN, "--output", str(folder / "r.json"), *report]) == 0
    return folder


@pytest.fixture
def page(evaluated):
    return (evaluated / "report" / "report.html").read_text()


def test_every_figure_equals_the_results(evaluated, page):
    document = json.loads((evaluated / "r.json").read_text())
    expected = {
        (name, figure): value
        for name, figures in [*document["sequences"].items(), ("mean", document["mean"])]
        for figure, value in figures.items()
    }
    assert cells(page) == expected
    before, after = (
        json.loads((evaluated / name).read_text())["mean"]["success_auc"]
        for name in ("before.json", "r.json")
    )
    assert f"The mean changed from {before:.3f} (1 seed) to {after:.3f} (3 seeds)." in page
    assert f"default [{document['mean']['success_auc']:.3f}]" not in page
    for figure in ("success_auc", "precision_20px"):
        assert f"li2007, 1 value changed [{document['mean'][figure]:.3f}]" in page


def test_the_page_is_self_contained(page):
    addresses = re.findall(r"""(?:src|href|action|xlink:href)\s*=\s*["']?([^"'\s>]*)""", page)
    addresses += re.findall(r"url\(([^)]*)\)", page)
    # Names are escaped.
    assert {each for each in addresses if not each.startswith(("#", "data:"))} <= {"x"}
    assert "<img src=x" not in page
    assert "@import" not in page
    remote = re.findall(r"https?://[^\s\"'<]*", page)
    assert set(remote) <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    assert not re.findall(r"#0[1-9]0[1-9]0[1-9]\b", page)
    # The ids of the plots are unique.
    names = re.findall(r'<clipPath id="([^"]+)"', page)
    assert len(set(names)) == len(names) > 10


def test_each_sequence_has_thumbnails_and_plots(page):
    sections = page.split('<section class="sequence"')[1:]
    assert len(sections) == 2
    for section, frames in zip(sections, (20, 12), strict=True):
        numbers = re.findall(r"<figcaption>frame (\d+),", section)
        sampled = numbers[:8]
        assert sampled == [str(round(x)) for x in np.linspace(0, frames - 1, 8)]
        # Pictures of bad frames only.
        worst = re.findall(r"overlap (\d\.\d+), confidence", section.partition("<h3>Least")[2])
        assert len(worst) <= 10
        assert all(float(overlap) < 0.5 for overlap in worst)
        for heading in (
            *("overlap", "center error, px", "confidence", "effective sample size", "cue weights"),
        ):
            assert f"<h3>{heading}</h3><svg" in section
        assert section.count("data:image/jpeg;base64,") == len(numbers)


@pytest.mark.parametrize("width", [390, 1280])
def test_a_browser_shows_the_page_without_errors_requests_or_overflow(browse, page, width):
    shown = browse(
        page,
        """
        const figure = document.querySelector(".plots figure").getBoundingClientRect();
        return {
          errors, title: document.title, width: innerWidth,
          scroll: document.documentElement.scrollWidth,
          letters: [...document.querySelectorAll("svg text")].map(
            (each) => each.getBoundingClientRect().height),
          figure: figure.width,
          resources: performance.getEntriesByType("resource").map((one) => one.name)
            .filter((name) => !name.startsWith("data:")),
          unloaded: [...document.images].filter((one) => !one.complete || !one.naturalWidth).length,
        };
        """,
        width,
    )
    assert shown["errors"] == []
    assert shown["title"] == "Evaluation on 2 sequences: li2007, 1 value changed"
    assert shown["scroll"] <= shown["width"] == width
    assert shown["unloaded"] == 0
    assert shown["resources"] == []
    # Two columns on a wide screen, readable letters on a narrow one.
    assert (shown["figure"] < width / 2) == (width > 1000)
    assert min(shown["letters"]) > 8


def test_a_click_on_a_heading_sorts_and_a_second_one_reverses(browse, page):
    shown = browse(
        page,
        """
        const orders = [];
        const press = (column) => {
          document.querySelectorAll("#sequences th button")[column].click();
          orders.push([...document.querySelectorAll("#sequences tbody tr")].map(
            (row) => Number(row.cells[1].dataset.value)));
        };
        press(1); press(1); press(2); press(0);
        return {errors, orders};
        """,
        1280,
    )
    assert shown["errors"] == []
    assert shown["orders"] == [[12, 20], [20, 12], [12, 20], [20, 12]]


def content(name="one", states=("tracking",) * 9, confidence=None):
    count = len(states)
    unknown = np.full(count, np.nan)
    return SequenceContent(
        name=name,
        boxes=np.tile([0.0, 0.0, 10.0, 10.0], (count, 1)),
        true_boxes=None,
        states=states,
        confidence=unknown if confidence is None else np.array(confidence),
        effective_sample_size=unknown,
        cue_weights={},
        scores=Scores(success_auc=0.5, precision_20px=1.0, cpu_ms_median=1.0, frames=9),
    )


def test_changes_are_sorted_and_classified(tmp_path):
    figures = {"precision_20px": 1, "cpu_ms_median": 1, "frames": 9}
    sequences = {
        name: {"success_auc": value, **figures}
        for name, value in (("up", 0.4), ("down", 0.7), ("same", 0.495), ("gone", 0.1))
    }
    path = tmp_path / "old.json"
    path.write_text(json.dumps({"preset": "li2007", "seeds": 1, "sequences": sequences}))
    found = changes([content(name) for name in ("down", "same", "up", "new")], read_results(path))
    verdicts = [(one.name, one.verdict) for one in found]
    assert verdicts == [("up", "better"), ("same", "same"), ("down", "worse")]
    assert found[0].difference == pytest.approx(0.1)


@pytest.mark.parametrize("text", ["{", "[]", '{"preset": "a", "seeds": 1, "sequences": {"b": {}}}'])
def test_a_file_that_is_no_result_file_is_refused(tmp_path, text):
    (tmp_path / "old.json").write_text(text)
    with pytest.raises(EvaluationError, match=r"old\.json"):
        read_results(tmp_path / "old.json")
    with pytest.raises(EvaluationError, match="cannot be read"):
        read_results(tmp_path / "nowhere.json")
    os.mkfifo(tmp_path / "pipe.json")
    with pytest.raises(EvaluationError, match="is a FIFO"):
        read_results(tmp_path / "pipe.json")


def test_shares_of_a_target_that_ended_and_returned():
    states = ("tracking", *["unreported"] * 2, "skipped", "lost", *["tracking"] * 3)
    other = ("tracking", "tracking")
    came_back = replace(content(states=states), first=4)
    ended = replace(content("ended", states=other), first=3, has_ended=True)
    shown = (came_back, content("other", states=other), ended)
    sections = [Section(one, {}) for one in shown]
    page = render(Report("several", "default", {}, sections, kind="target"))
    found = re.findall(r'<td data-state="(\w+)" data-value="([^"]*)"', page)
    names = ("tracking", "occluded", "lost", "unreported", "skipped")
    assert [name for name, _ in found] == 3 * [*names]
    shares = [float(share) for _, share in found]
    assert shares == [0.5, 0, 0.125, 0.25, 0.125, *2 * [1, 0, 0, 0, 0]]
    text = " ".join(re.sub("<[^>]*>", " ", page).split())
    of_states = "lost in 8; unreported in 5 to 6; skipped in 7; otherwise tracking."
    assert f"Frames 4 to 11: {of_states}" in text
    assert "Frames 0 to 1: tracking." in text
    assert "Frames 3 to 4, where it ended: tracking." in text


def test_lost_ranges_and_worst_frames_which_are_sorted_and_not_neighbors():
    states = ("tracking", "lost", "lost", "occluded", "lost", "tracking")
    assert content(states=states).frame_ranges("lost") == [(1, 2), (4, 4)]
    assert content(states=("lost",) * 2).states_in_words == "lost in 0 to 1"
    assert content(states=states).share_by_state["lost"] == 0.5
    confidence = np.full(60, 0.4)
    confidence[20:25] = 0.5
    confidence[[10, 11, 12, 30, 50]] = (0.3, 0.1, 0.2, 0.15, np.nan)
    worst = content(states=("tracking",) * 60, confidence=confidence).worst_frames
    assert worst[:2] == [11, 30]
    assert len(worst) == 10
    assert not {20, 21, 22, 23, 24, 50} & {*worst}
    assert min(np.diff(sorted(worst))) >= 5
    # Gaps have the last box.
    kept = forward_fill([None, (1, 2, 3, 4), None, (5, 6, 7, 8)])
    assert np.isnan(kept[0]).all()
    assert kept[1:].tolist() == [[1, 2, 3, 4], [1, 2, 3, 4], [5, 6, 7, 8]]


@pytest.mark.parametrize(
    ("option", "reason"),
    [
        ("--compare", "--compare needs --report DIR"),
        ("--report", "r.json cannot be made (File exists)"),
    ],
)
def test_a_request_is_refused_before_the_first_frame(evaluated, capsys, option, reason):
    assert main([str(evaluated / "a"), *RUN, option, str(evaluated / "r.json")]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert reason in output.err
