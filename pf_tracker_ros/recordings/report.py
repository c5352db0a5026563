"""The report of one tracked recording. Needs Jinja2 and Matplotlib."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.evaluation import metrics
from pf_tracker_ros.evaluation.reports.content import SequenceContent
from pf_tracker_ros.evaluation.reports.page import Report, Section, render
from pf_tracker_ros.evaluation.reports.pictures import Picture, take_pictures
from pf_tracker_ros.evaluation.results import Scores
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.recordings.recording import Recording
from pf_tracker_ros.recordings.summaries import ABSENT, FrameSummary, content_of_frames, summary_of
from pf_tracker_ros.recordings.tracking import Tracked, TrackedFrame


class Known(Protocol):
    """What is known of the frames of a recording, and the page that tells of it."""

    def add(self, tracked: Tracked) -> None:
        """Take what is known of a frame."""
        ...

    def page(self, recording: Recording, preset: str, facts: Mapping[str, str]) -> str:
        """The page; see `RecordingReport`."""
        ...


class RecordingReport:
    """Writes the page of one recording once all of its frames are known.

    Args:
        path: The file, made anew.
        known: Takes the frames, and makes the page.
        recording: What is tracked in; its frames are read again for the pictures.
        preset: That tracks.
        facts: Further facts of the run, name to value.
    """

    def __init__(
        self,
        path: Path,
        *,
        known: Known,
        recording: Recording,
        preset: str,
        facts: Mapping[str, str],
    ) -> None:
        self._path = path
        self._known = known
        self._page = functools.partial(known.page, recording, preset, facts)

    def write(self, tracked: Tracked) -> None:
        """Remember what is known of a frame."""
        self._known.add(tracked)

    def close(self) -> None:
        """Write the page.

        Raises:
            OSError: It cannot be written.
        """
        self._path.write_bytes(self._page().encode("utf-8", "replace"))

    def discard(self) -> None:
        """Give the file up, which is not begun yet."""


class KnownTarget:
    """What is known of a recording with one target; see `Known`."""

    def __init__(self) -> None:
        self._frames: list[FrameSummary] = []

    def add(self, tracked: Tracked) -> None:
        """Take what is known of a frame."""
        assert isinstance(tracked, TrackedFrame)
        self._frames.append(summary_of(tracked))

    def page(self, recording: Recording, preset: str, facts: Mapping[str, str]) -> str:
        """The page; see `recording_page`."""
        true_boxes = None
        if recording.has_ground_truth:
            true_boxes = np.array([each.true_box or ABSENT for each in self._frames])
        return recording_page(recording, self._frames, true_boxes, preset=preset, facts=facts)


def recording_page(
    recording: Recording,
    frames: Sequence[FrameSummary],
    true_boxes: NDArray[np.float64] | None,
    *,
    preset: str,
    facts: Mapping[str, str],
) -> str:
    """The page of one recording, with the figures of an evaluation where there is a truth.

    Args:
        recording: What was tracked in; its frames are read again for the pictures.
        frames: What is known of them, in order, at least one.
        true_boxes: (frames, 4) what the boxes are compared with; None without such.
        preset: That tracked.
        facts: Further facts of the run, name to value.
    """
    content = content_of_frames(recording.path.name, frames, true_boxes)
    content = _scored(content, np.array([each.seconds for each in frames]))
    return render(
        Report(
            title=f"{recording.path.name}, tracked",
            preset=preset,
            facts=facts,
            sections=[Section(content, pictures_of([content], recording)[0])],
            mean=content.scores,
        )
    )


def pictures_of(
    contents: Sequence[SequenceContent], recording: Recording
) -> list[dict[int, Picture]]:
    """The pictures of each target of a recording, whose frames are read again."""

    def images() -> Iterator[tuple[int, NDArray[Any] | None]]:
        with closing(recording.frames()) as frames:
            for frame in frames:
                yield frame.index, frame.image

    # What could be read once is there again, or the page has no pictures.
    try:
        return take_pictures(contents, images())
    except FootageError:
        return [{} for _ in contents]


def _scored(content: SequenceContent, seconds: NDArray[np.float64]) -> SequenceContent:
    overlaps, errors = content.overlaps, content.center_errors
    if overlaps is None or errors is None or np.isnan(overlaps).all():
        return content
    is_timed = not np.isnan(seconds).all()
    return replace(
        content,
        scores=Scores(
            success_auc=metrics.success_auc(overlaps),
            precision_20px=metrics.precision(errors),
            cpu_ms_median=1e3 * float(np.nanmedian(seconds)) if is_timed else np.nan,
            frames=content.frames,
        ),
        success_curve=metrics.success_curve(overlaps),
        precision_curve=metrics.precision_curve(errors),
    )
