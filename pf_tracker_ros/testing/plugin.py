"""What the plugin adds to pytest: the fixture `tracked_recording`, and two options."""

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
        folder: That sources are relative to.
        reports: Folder for what a check that fails leaves behind.
        updates_baseline: Whether what is found is stored as the result to compare with.
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
        """Track one; see `tracked_recording`."""
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
        help="store what the replay tests find as the results to compare with",
    )
    group.addoption(
        "--tracking-reports",
        metavar="DIR",
        help="where replay tests that fail leave report and pictures, such as a folder that CI "
        "keeps; by default the test's temporary folder",
    )


@pytest.fixture
def tracked_recording(request: pytest.FixtureRequest, tmp_path: Path) -> TrackRecording:
    """A function that tracks a recording and returns what came of it, to be checked.

    Its arguments: `source`, relative to the test's file; the target's `box`, by default that of the
    target file beside the source, or of its ground truth; `preset`, `parameters` and `seed` of the
    tracker; `backend` "library", which is fast, or "node", which replays it in lockstep over DDS
    into the real node; `baseline`, a file of boxes to compare with in place of the truth, which
    `pytest --update` writes; `bag_topic`, the image topic of a bag that has several.
    """
    given = request.config.getoption("--tracking-reports")
    reports = tmp_path
    if given:
        reports = Path(given).resolve() / re.sub(r"[^\w.-]+", "_", request.node.nodeid)
    updates_baseline = bool(request.config.getoption("--update"))
    return TrackRecording(request.path.parent, reports, updates_baseline)
