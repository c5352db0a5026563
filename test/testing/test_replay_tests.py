"""Replay tests detect a broken tracker, but accept different rounding."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

import pf_tracker_ros
from pf_tracker_ros.recordings import tracking
from pf_tracker_ros.targets.session import Outcome, Session

PACKAGES = Path(pf_tracker_ros.__file__).parents[1]
QUICK = {"preset": "li2007", "parameters": {"particles": 60}}
LIMITS = {
    "final_state": "tracking",
    "mean_overlap": 0.8,
    "longest_loss": 0.2,
    "milliseconds_per_frame": 200,
}


@pytest.fixture(autouse=True)
def seconds(monkeypatch):
    """Seconds that the frames take with the library; the last one holds for those after it."""
    spent, readings = [0.01], []

    def perf_counter():
        # Read before and after each frame.
        readings.append(None)
        is_after = len(readings) % 2 == 0
        return (spent.pop(0) if len(spent) > 1 else spent[0]) if is_after else 0.0

    monkeypatch.setattr(tracking, "time", SimpleNamespace(perf_counter=perf_counter))
    return spent


def mutate(monkeypatch, change):
    """Let a function change each estimate of a session."""
    process = Session.process

    def changed(self, frame, arrival=None):
        outcome = process(self, frame, arrival)
        targets = [replace(one, estimate=change(one.estimate)) for one in outcome.targets]
        return replace(outcome, targets=tuple(targets))

    monkeypatch.setattr(Session, "process", changed)


@pytest.fixture
def baseline(tracked_recording, moving_square_sequence, tmp_path):
    """Baseline of the unchanged tracker."""
    path = tmp_path / "square.boxes.csv"
    tracked_recording(moving_square_sequence, baseline=path, **QUICK).store()
    return path


@pytest.mark.parametrize("backend", ["library", "node"])
def test_the_unchanged_tracker_passes_against_ground_truth_and_baseline(
    tracked_recording, moving_square_sequence, baseline, backend
):
    if backend == "node":
        pytest.importorskip("rclpy", reason="needs ROS 2")
    # The node's time is that of a machine that may be busy.
    limits = {**LIMITS, "milliseconds_per_frame": None} if backend == "node" else LIMITS
    run = tracked_recording(moving_square_sequence, backend=backend, **QUICK)
    run.check(**limits)
    assert run.final_state == "tracking"
    assert run.longest_loss == 0.0
    again = tracked_recording(moving_square_sequence, baseline=baseline, backend=backend, **QUICK)
    again.check(**limits)
    # A box in a message has corners in single precision.
    assert again.mean_overlap == pytest.approx(1.0, abs=1e-5)


def test_a_baseline_may_have_labels(tracked_recording, moving_square_sequence, baseline):
    heading, *lines = baseline.read_text().splitlines()
    baseline.write_text("\n".join([f"{heading},label", *(f"{line},car" for line in lines)]) + "\n")
    run = tracked_recording(moving_square_sequence, baseline=baseline, **QUICK)
    run.check(**LIMITS)
    assert run.mean_overlap == 1.0


def test_both_backends_give_the_same_result(tracked_recording, moving_square_sequence, ros_domain):
    runs = [
        tracked_recording(moving_square_sequence, seed=3, backend=backend, **QUICK)
        for backend in ("library", "node")
    ]
    one, other = (run.frames for run in runs)
    assert len(one) == len(other) == 20
    for frame, same in zip(one, other, strict=True):
        assert (frame.stamp, frame.state) == (same.stamp, same.state)
        assert frame.confidence == same.confidence
        assert frame.effective_sample_size == same.effective_sample_size
        assert frame.cue_weights == same.cue_weights
        assert np.allclose(frame.box, same.box, rtol=0, atol=1e-4)


def frozen():
    first = []

    def change(estimate):
        first.append(estimate.box)
        return replace(estimate, box=first[0])

    return change


def giving_up():
    frames = []

    def change(estimate):
        frames.append(1)
        return replace(estimate, state="lost" if len(frames) > 8 else estimate.state)

    return change


@pytest.mark.parametrize(
    ("mutation", "message"),
    [
        (frozen, ", expected at least 0.8; it is lowest in frame "),
        (giving_up, "lost for 0.44 s in frames 8 to 19, expected at most 0.2 s"),
    ],
)
def test_a_broken_tracker_fails(tracked_recording, baseline, monkeypatch, mutation, message):
    source = baseline.parent / "moving_square"
    mutate(monkeypatch, mutation())
    run = tracked_recording(source, baseline=baseline, **QUICK)
    with pytest.raises(pytest.fail.Exception) as caught:
        run.check(**LIMITS)
    text = str(caught.value)
    assert text.startswith(f"{source} with preset li2007, backend library:\n- ")
    assert message in text
    assert text.count("\n- ") == {frozen: 1, giving_up: 3}[mutation]


def test_a_tracker_slow_in_most_frames_fails(tracked_recording, moving_square_sequence, seconds):
    seconds[:] = [0.25] * 12 + [0.01]
    run = tracked_recording(moving_square_sequence, **QUICK)
    with pytest.raises(pytest.fail.Exception, match="takes 250 ms, expected at most 200 ms"):
        run.check(**LIMITS)


def test_another_rounding_passes(tracked_recording, moving_square_sequence, baseline, monkeypatch):
    generator = np.random.default_rng(0)

    def change(estimate):
        noise = generator.uniform(-1e-3, 1e-3, 4)
        return replace(estimate, box=tuple(float(v) for v in np.add(estimate.box, noise)))

    mutate(monkeypatch, change)
    run = tracked_recording(moving_square_sequence, baseline=baseline, **QUICK)
    run.check(**{**LIMITS, "mean_overlap": 0.999})
    assert run.mean_overlap < 1.0


def test_a_failure_has_a_report(tracked_recording, moving_square_sequence, monkeypatch, tmp_path):
    pytest.importorskip("jinja2")
    mutate(monkeypatch, frozen())
    run = tracked_recording(moving_square_sequence, **QUICK)
    with pytest.raises(pytest.fail.Exception, match=r"frame 6: .*frame_00006\.png") as caught:
        run.check(mean_overlap=0.8)
    picture = cv2.imread(str(tmp_path / "frame_00006.png"))
    # Ground truth in green, estimate in white.
    assert picture[42, 55].tolist() == [80, 220, 80]
    assert picture[30, 30].tolist() == [255, 255, 255]
    assert f"report: {tmp_path / 'report.html'}" in str(caught.value)
    assert "Least overlap" in (tmp_path / "report.html").read_text()


def test_a_tracker_that_never_starts_fails(tracked_recording, moving_square_sequence, monkeypatch):
    monkeypatch.setattr(Session, "process", lambda self, frame, arrival: Outcome("waiting"))
    run = tracked_recording(moving_square_sequence, **QUICK)
    with pytest.raises(pytest.fail.Exception) as caught:
        run.check(**LIMITS)
    for message in ("the final state is idle", "no frame could be compared", "takes nan ms"):
        assert message in str(caught.value)


CONFTEST = 'pytest_plugins = ["pf_tracker_ros.testing"]\n'
USER_TEST = """\
def test_the_square_is_tracked(tracked_recording):
    run = tracked_recording("moving_square", preset="li2007", baseline="square.boxes.csv")
    run.check(final_state="tracking", mean_overlap=0.9, longest_loss=0.5)
"""


@pytest.fixture
def run_pytest(tmp_path, moving_square_sequence):
    """Run a user's test in its own process."""
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "test_square.py").write_text(USER_TEST)

    def run(*arguments):
        return subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(PACKAGES)},
            capture_output=True,
            text=True,
            errors="surrogateescape",
            timeout=120,
            check=False,
        )

    return run


def test_a_users_test_stores_and_compares_its_baseline(run_pytest, tmp_path):
    assert run_pytest("--update").returncode == 0
    baseline = tmp_path / "square.boxes.csv"
    assert len(baseline.read_text().splitlines()) == 21

    lines = baseline.read_text().splitlines()
    moved = [lines[0]] + [
        ",".join([*line.split(",")[:3], "0.0", "0.0", *line.split(",")[5:]]) for line in lines[1:]
    ]
    baseline.write_text("\n".join(moved) + "\n")
    folder = os.fsdecode(os.fsencode(tmp_path) + b"/k\xe4pt")
    outcome = run_pytest("--tracking-reports", folder)
    assert outcome.returncode == 1
    assert "the overlap with the baseline is 0.000, expected at least 0.9" in outcome.stdout
    assert not {"Traceback", "UnicodeEncodeError"} & set(outcome.stdout.split())
    (kept,) = Path(folder).iterdir()
    assert kept.name == "test_square.py_test_the_square_is_tracked"
    assert {path.name for path in kept.iterdir()} == {"frame_00000.png", "report.html"}


@pytest.mark.parametrize(
    ("change", "messages"),
    [
        (lambda lines: lines[:10], ("has 9 frames", "it belongs to another recording")),
        (lambda lines: ["something else"], ("is no baseline",)),
        (None, (".csv; pytest --update stores one",)),
    ],
)
def test_a_wrong_baseline_is_refused(
    tracked_recording, moving_square_sequence, baseline, change, messages
):
    lines = baseline.read_text().splitlines()
    baseline.unlink()
    if change:
        baseline.write_text("\n".join(change(lines)))
    with pytest.raises(pytest.fail.Exception) as caught:
        tracked_recording(moving_square_sequence, baseline=baseline, **QUICK).check(**LIMITS)
    assert all(message in str(caught.value) for message in messages)


@pytest.mark.parametrize("name", ["otb_bolt", pytest.param("ir_drone_074", marks=pytest.mark.slow)])
def test_real_recordings_are_tracked(tracked_recording, sequences_directory, name):
    tracked_recording(sequences_directory / name).check(
        final_state="tracking", mean_overlap=0.6, longest_loss=0.5
    )
