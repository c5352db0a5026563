"""The report of one tracked recording. Needs Jinja2 and Matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.evaluation import metrics
from pf_tracker_ros.evaluation.reports.content import SequenceContent, kept_boxes
from pf_tracker_ros.evaluation.reports.page import Report, Section, render
from pf_tracker_ros.evaluation.reports.pictures import take_pictures
from pf_tracker_ros.evaluation.results import Scores
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.recordings.recording import Recording
from pf_tracker_ros.recordings.tracking import TrackedFrame

_ABSENT = (np.nan, np.nan, np.nan, np.nan)


@dataclass(frozen=True)
class _Row:
    """What a report needs of a frame, which is little beside its image."""

    state: str
    outcome: str
    box: Box | None
    true_box: Box | None
    confidence: float
    effective_sample_size: float
    powers: Mapping[str, float]
    seconds: float


class RecordingReport:
    """Writes the page of one recording once all of its frames are known.

    Args:
        path: The file, made anew.
        recording: What is tracked in; its frames are read again for the pictures.
        preset: That tracks.
        facts: Further facts of the run, name to value.
    """

    def __init__(
        self, path: Path, *, recording: Recording, preset: str, facts: Mapping[str, str]
    ) -> None:
        self._file = path.open("wb")
        self._recording = recording
        self._preset = preset
        self._facts = facts
        self._rows: list[_Row] = []

    def write(self, tracked: TrackedFrame) -> None:
        """Remember what is known of a frame."""
        estimate = tracked.estimate
        self._rows.append(
            _Row(
                tracked.state,
                tracked.outcome,
                tracked.box,
                tracked.frame.true_box,
                float(estimate.confidence) if estimate else np.nan,
                float(estimate.effective_sample_size) if estimate else np.nan,
                dict(estimate.powers) if estimate else {},
                tracked.seconds,
            )
        )

    def close(self) -> None:
        """Write the page.

        Raises:
            OSError: It cannot be written.
        """
        with self._file:
            self._file.write(self._page().encode("utf-8", "replace"))

    def _page(self) -> str:
        content = self._content()
        # What could be read once is there again, or the page has fewer pictures.
        try:
            pictures = take_pictures(content, self._images())
        except FootageError:
            pictures = {}
        return render(
            Report(
                title=f"{self._recording.path.name}, tracked",
                preset=self._preset,
                facts=self._facts,
                sections=[Section(content, pictures)],
                mean=content.scores,
            )
        )

    def _images(self) -> Iterator[tuple[int, NDArray[Any] | None]]:
        with closing(self._recording.frames()) as frames:
            for frame in frames:
                yield frame.index, frame.image

    def _content(self) -> SequenceContent:
        rows = self._rows
        names = dict.fromkeys(name for row in rows for name in row.powers)
        boxes = kept_boxes([row.box for row in rows])
        true_boxes = None
        if self._recording.has_ground_truth:
            true_boxes = np.array([row.true_box or _ABSENT for row in rows])
        content = SequenceContent(
            name=self._recording.path.name,
            boxes=boxes,
            true_boxes=true_boxes,
            states=tuple(row.state for row in rows),
            confidence=_column(rows, lambda row: row.confidence),
            effective_sample_size=_column(rows, lambda row: row.effective_sample_size),
            powers={
                name: _column(rows, lambda row, name=name: row.powers.get(name, np.nan))  # type: ignore[misc]
                for name in names
            },
            scores=None,
            success_curve=None,
            precision_curve=None,
        )
        return _scored(content, [row.seconds for row in rows if row.outcome == "tracked"])


def _column(rows: list[_Row], value: Callable[[_Row], float]) -> NDArray[np.float64]:
    return np.array([value(row) for row in rows], dtype=np.float64)


def _scored(content: SequenceContent, seconds: list[float]) -> SequenceContent:
    """The same with the figures of an evaluation, where there is a truth to compare with."""
    overlaps, errors = content.overlaps, content.center_errors
    if overlaps is None or errors is None or np.isnan(overlaps).all():
        return content
    return replace(
        content,
        scores=Scores(
            success_auc=metrics.success_auc(overlaps),
            precision_20px=metrics.precision(errors),
            cpu_ms_median=1e3 * float(np.median(seconds)) if seconds else np.nan,
            frames=content.frames,
        ),
        success_curve=metrics.success_curve(overlaps),
        precision_curve=metrics.precision_curve(errors),
    )
