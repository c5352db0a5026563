"""The pytest plugin: the fixture `tracked_recording` and two options."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pytest

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.recordings.recording import open_recording
from pf_tracker_ros.recordings.target import choose_target
from pf_tracker_ros.testing.runs import TrackedRun, run_library, run_node

Backend = Literal["library", "node"]


@dataclass(frozen=True)
class TrackRecording:
    """Tracks recordings for a test; see `tracked_recording`.

    Attributes:
        folder: Folder that sources are relative to.
        reports: Folder for the reports of failed checks.
        updates_baseline: Whether the result is stored as the baseline.
    """

    folder: Path
    reports: Path
    updates_baseline: bool

    def __call__(
        self,
        source: str | Path,
        *,
        box: Box | None = None,
        preset: str = "default",
        parameters: Mapping[str, Any] | None = None,
        seed: int = 0,
        backend: Backend = "library",
        baseline: str | Path | None = None,
        bag_topic: str = "",
    ) -> TrackedRun:
        """Track a recording; see `tracked_recording`."""
        recording = open_recording(self.folder / source, bag_topic=bag_topic)
        target = choose_target(recording, box)
        if backend == "library":
            frames = run_library(recording, target, preset, parameters or {}, seed)
        else:
            tunables = {**(parameters or {}), "preset": preset, "seed": seed}
            frames = run_node(recording, target, tunables, bag_topic)
        path = None if baseline is None else self.folder / baseline
        run = TrackedRun(recording, frames, preset, backend, path, self.reports)
        if self.updates_baseline:
            run.store()
        return run


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the plugin's options."""
    group = parser.getgroup("pf_tracker_ros", "replay tests of pf_tracker_ros")
    group.addoption(
        "--update",
        action="store_true",
        help="store the results of replay tests as their baselines",
    )
    group.addoption(
        "--tracking-reports",
        metavar="DIR",
        help="folder for reports and images of failed replay tests, such as a CI artifact "
        "(default: the test's temporary folder)",
    )


@pytest.fixture
def tracked_recording(request: pytest.FixtureRequest, tmp_path: Path) -> TrackRecording:
    """A function that tracks a recording and returns a `TrackedRun`.

    Its arguments:

    - `source`: the recording, relative to the test's file.
    - `box`: the target, by default from the source's target file or ground truth.
    - `preset`, `parameters`, `seed`: of the tracker.
    - `backend`: "library", which is fast, or "node", a replay in lockstep over DDS.
    - `baseline`: file of boxes to compare with instead of the ground truth, written by
      `pytest --update`.
    - `bag_topic`: image topic of a bag with several.
    """
    given = request.config.getoption("--tracking-reports")
    reports = tmp_path
    if given:
        reports = Path(given).resolve() / re.sub(r"[^\w.-]+", "_", request.node.nodeid)
    updates_baseline = bool(request.config.getoption("--update"))
    return TrackRecording(request.path.parent, reports, updates_baseline)
