"""Tables and the plot of the comparison with the seven families."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import intervals
import numpy as np
from intervals import Interval
from tables import Table, bold


@dataclass(frozen=True)
class Outcome:
    """One tracker on one sequence.

    Attributes:
        sequence: Name of the sequence.
        tracker: Name of the tracker.
        center_rmse: Root mean square of the center error over the frames, px.
        success_auc: As `pf_tracker_ros.evaluation` has it.
        milliseconds: Median CPU time of a frame.
    """

    sequence: str
    tracker: str
    center_rmse: float
    success_auc: float
    milliseconds: float


@dataclass(frozen=True)
class ClutterOutcome:
    """One tracker in one generated street at one level of clutter, 0 to 1."""

    scene: int
    level: float
    outcome: Outcome


HEADINGS = ("sequence", "tracker", "center RMSE px", "success AUC", "CPU ms")
_FORMS = (".1f", ".3f", ".2f")
_CLUTTER_TITLE = "center RMSE over the level of clutter, px"
_CLUTTER_NOTE = (
    "Means over {scenes} generated streets; in brackets 95 % confidence intervals (bootstrap)."
)


def print_table(outcomes: Sequence[Outcome]) -> None:
    """Print the figures of each sequence, and their means, on standard output."""
    _table(outcomes).show()


def write_table(path: Path, outcomes: Sequence[Outcome], seeds: int) -> None:
    """Write the table as Markdown."""
    runs = "1 seed" if seeds == 1 else f"mean of {seeds} seeds"
    table = _table(outcomes)
    lines = [f"# {table.title}, {runs}", "", *table.markdown()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def print_clutter(outcomes: Sequence[ClutterOutcome]) -> None:
    """Print the error of each tracker at each level, without the intervals."""
    heading, *rows = _clutter_rows(outcomes)
    rows = [[cell.partition(" [")[0] for cell in row] for row in rows]
    Table(_CLUTTER_TITLE, heading, [rows]).show()


def write_clutter_table(path: Path, outcomes: Sequence[ClutterOutcome]) -> None:
    """Write the errors as a Markdown table."""
    scenes = len({one.scene for one in outcomes})
    heading, *rows = _clutter_rows(outcomes)
    table = Table(_CLUTTER_TITLE, heading, [rows])
    lines = [f"# {table.title}", "", *table.markdown(), ""]
    path.write_text("\n".join([*lines, _CLUTTER_NOTE.format(scenes=scenes), ""]), encoding="utf-8")


def _curve(outcomes: Sequence[ClutterOutcome], tracker: str) -> list[Interval]:
    """The mean error of a tracker at each level."""
    return [
        intervals.mean(
            [
                one.outcome.center_rmse
                for one in outcomes
                if one.level == level and one.outcome.tracker == tracker
            ]
        )
        for level in sorted({one.level for one in outcomes})
    ]


def _clutter_rows(outcomes: Sequence[ClutterOutcome]) -> list[list[str]]:
    """Headings, then a row for each tracker."""
    levels = sorted({one.level for one in outcomes})
    rows = [["tracker", *(f"{level:g}" for level in levels)]]
    for tracker in _names(one.outcome.tracker for one in outcomes):
        curve = _curve(outcomes, tracker)
        cells = [f"{point.value:.1f} [{point.low:.1f}, {point.high:.1f}]" for point in curve]
        rows.append([tracker, *cells])
    return rows


def _table(outcomes: Sequence[Outcome]) -> Table:
    return Table("zhang_bo and the seven families", HEADINGS, _groups(outcomes), names=2)


def _groups(outcomes: Sequence[Outcome]) -> list[list[list[str]]]:
    """Rows of each sequence and of the means, the best figures in bold."""
    trackers = _names(one.tracker for one in outcomes)
    figures = {
        (one.sequence, one.tracker): (one.center_rmse, one.success_auc, one.milliseconds)
        for one in outcomes
    }
    sequences = _names(one.sequence for one in outcomes)
    values = np.array([[figures[name, tracker] for tracker in trackers] for name in sequences])
    groups = []
    for name, group in zip([*sequences, "mean"], [*values, values.mean(axis=0)], strict=True):
        best = (group[:, 0].min(), group[:, 1].max(), group[:, 2].min())
        groups.append(
            [
                [name, tracker, *_cells(row, best)]
                for tracker, row in zip(trackers, group, strict=True)
            ]
        )
    return groups


def _cells(row: Iterable[float], best: Iterable[float]) -> list[str]:
    texts = [format(value, form) for value, form in zip(row, _FORMS, strict=True)]
    return [bold(text, value == top) for text, value, top in zip(texts, row, best, strict=True)]


def _names(names: Iterable[str]) -> list[str]:
    """Each name once, in the order of its first appearance."""
    return list(dict.fromkeys(names))
