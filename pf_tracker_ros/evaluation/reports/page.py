"""Renders the HTML page of a report. Needs Jinja2 and Matplotlib."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pf_tracker_ros.evaluation.reports.content import GroundView, SequenceContent, state_columns
from pf_tracker_ros.evaluation.reports.svg_plots import (
    precision_plot,
    series_plots,
    success_plot,
    view_from_above,
)
from pf_tracker_ros.evaluation.reports.thumbnails import FrameThumbnail
from pf_tracker_ros.evaluation.reports.timeline import RecordingVideo, timeline
from pf_tracker_ros.evaluation.results import EvaluationError, Scores
from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.access import read_file
from pf_tracker_ros.plurals import counted

REPORT_FILE = "report.html"
# Bytes of a result file.
_MAX_RESULTS = 100 * 10**6
# Smaller differences of the success AUC are within the noise of the seeds.
_NOTABLE = 0.01
_FIGURES = ("success_auc", "precision_20px", "cpu_ms_median", "frames")


@dataclass(frozen=True, eq=False)
class Section:
    """A sequence of a report.

    Attributes:
        content: Its data.
        thumbnails: Index of a frame to its image.
    """

    content: SequenceContent
    thumbnails: Mapping[int, FrameThumbnail]


@dataclass(frozen=True, eq=False)
class Report:
    """The data of a page.

    Attributes:
        title: Title of the page.
        preset: The preset.
        facts: Further facts about the run, name to value.
        sections: A section for each sequence.
        mean: Means over the sequences, None without ground truth.
        compared: Label to the results of other runs.
        seeds: Number of seeds in the means.
        kind: Kind of the sections, "sequence" or "target".
        ground: Targets and camera from above; None without positions.
        recording_video: How the recording is played; None for several recordings.
    """

    title: str
    preset: str
    facts: Mapping[str, str]
    sections: Sequence[Section]
    mean: Scores | None = None
    compared: Mapping[str, SavedResults] = field(default_factory=dict)
    seeds: int = 1
    kind: str = "sequence"
    ground: GroundView | None = None
    recording_video: RecordingVideo | None = None


class SavedResults(NamedTuple):
    """Content of a result file of `evaluate --output`.

    Attributes:
        preset: The evaluated preset.
        seeds: Number of seeds in the means.
        scores: Name of a sequence to its figures.
    """

    preset: str
    seeds: int
    scores: Mapping[str, Scores]


class Change(NamedTuple):
    """Success AUC of a sequence in two runs."""

    name: str
    before: float
    after: float

    @property
    def difference(self) -> float:
        """Difference of the success AUC; positive for an improvement."""
        return self.after - self.before

    @property
    def verdict(self) -> str:
        """The word "better", "worse" or "same"."""
        if abs(self.difference) < _NOTABLE:
            return "same"
        return "better" if self.difference > 0 else "worse"


def render(report: Report) -> str:
    """The self-contained page with styles, plots and images."""
    from markupsafe import Markup

    contents = [section.content for section in report.sections]
    success = [each.success_curve for each in contents if each.success_curve is not None]
    precision = [each.precision_curve for each in contents if each.precision_curve is not None]
    plots = {}
    if success and precision:
        plots["success"] = Markup(success_plot({report.preset: np.mean(success, axis=0)}))
        plots["precision"] = Markup(precision_plot({report.preset: np.mean(precision, axis=0)}))
    series = [
        {heading: Markup(plot) for heading, plot in series_plots(each).items()} for each in contents
    ]
    return fill(
        "report.html.jinja",
        report=report,
        plots=plots,
        timeline=timeline(contents, report.recording_video)
        if report.recording_video and contents
        else None,
        view_from_above=Markup(view_from_above(report.ground)) if report.ground else "",
        sections=list(zip(report.sections, series, strict=True)),
        changes={
            label: (counted(other.seeds, "seed"), changes(contents, other))
            for label, other in report.compared.items()
        },
        seeds=counted(report.seeds, "seed"),
        states=state_columns({state for each in contents for state in each.states}),
        has_scores=any(each.scores is not None for each in contents),
        is_known=lambda value: not math.isnan(value),
    )


def fill(template: str, **values: Any) -> str:
    """Fill a template of this package; values are escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("pf_tracker_ros.evaluation.reports", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**values)


def changes(contents: Sequence[SequenceContent], other: SavedResults) -> list[Change]:
    """Changes of the sequences in both runs, the largest gain first."""
    shared = [
        Change(each.name, other.scores[each.name].success_auc, each.scores.success_auc)
        for each in contents
        if each.scores is not None and each.name in other.scores
    ]
    return sorted(shared, key=lambda change: -change.difference)


def read_results(path: Path) -> SavedResults:
    """Read a result file.

    Raises:
        EvaluationError: It cannot be read, or is no result file.
    """
    try:
        document: Any = json.loads(read_file(path, "result file", _MAX_RESULTS))
    except FootageError as error:
        raise EvaluationError(str(error)) from error
    except (ValueError, RecursionError) as error:
        raise EvaluationError(f"{path} cannot be read as JSON ({error})") from error
    try:
        scores = {
            str(name): Scores(**{figure: float(figures[figure]) for figure in _FIGURES})
            for name, figures in document["sequences"].items()
        }
        return SavedResults(str(document["preset"]), int(document["seeds"]), scores)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise EvaluationError(
            f"{path} is no result file; allowed: files of `evaluate --output`"
        ) from error
