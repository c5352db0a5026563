"""Tables and plots of the umbrella experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import intervals
import numpy as np
from intervals import Interval
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scenes import UmbrellaScene
from tables import Table
from umbrella_runs import PAPER_FRAMES, Run

HEADINGS = (
    "setting",
    "switched %",
    "lost %",
    "held %",
    "center error px",
    "error if held px",
    "jitter if held px",
    "CPU ms",
)
NOTE = (
    "In brackets: 95 % confidence intervals over the scenes (Wilson for shares, bootstrap for "
    "means). Center error: mean over all frames. Jitter: root mean square of the change of the "
    "error vector from frame to frame. CPU ms: median of one update on one thread."
)


def print_table(runs: Sequence[Run]) -> None:
    """Print the table on standard output."""
    _table(runs).show()
    print(_comparison(runs))


def write_table(path: Path, runs: Sequence[Run], overrides: Mapping[str, Any]) -> None:
    """Write the table as Markdown, with the overridden parameters."""
    lines = [f"# Umbrella experiment, {_scenes(runs)}", ""]
    if overrides:
        changes = ", ".join(f"`{name}` = {value}" for name, value in overrides.items())
        lines += [f"Parameters over the preset's: {changes}.", ""]
    lines += [*_table(runs).markdown(), "", _comparison(runs), "", NOTE, ""]
    path.write_text("\n".join(lines), encoding="utf-8")


def write_frames(path: Path, runs: Sequence[Run]) -> None:
    """Draw estimates and particles into the paper's frames of a scene, a row for each setting.

    The scene is the first in which color alone switched at the meeting and the other settings held;
    without one, the first of all.
    """
    settings = _by_setting(runs)
    scenes = list(zip(*settings.values(), strict=True))
    as_in_paper = [
        (color, few, many)
        for color, few, many in scenes
        if color.true_switch and few.outcome == many.outcome == "held"
    ]
    chosen = (as_in_paper or scenes)[0]
    scene = UmbrellaScene(chosen[0].seed)
    figure = Figure(figsize=(15.0, 5.8), layout="constrained")
    figure.suptitle(f"Scene {chosen[0].seed}: estimate (large) and particles (size by weight)")
    axes = figure.subplots(len(chosen), len(PAPER_FRAMES), squeeze=False)
    for row, run in zip(axes, chosen, strict=True):
        for cell, number, snapshot in zip(row, PAPER_FRAMES, run.snapshots, strict=True):
            image = _with_boxes(scene.render(number - 1), *snapshot)
            cell.imshow(image[210:430, 110:660, ::-1])
            cell.set(xticks=[], yticks=[], title=f"{run.setting}, frame {number}")
            cell.title.set_fontsize(9)
    figure.savefig(path, dpi=120)


def _with_boxes(
    image: NDArray[np.uint8],
    box: NDArray[np.float64],
    particle_boxes: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> NDArray[np.uint8]:
    centers = particle_boxes[:, :2] + particle_boxes[:, 2:] / 2
    halves = 1.0 + 4.0 * np.sqrt(weights / weights.max())
    for center, half in zip(centers, halves, strict=True):
        low, high = np.round(center - half).astype(int), np.round(center + half).astype(int)
        cv2.rectangle(image, low.tolist(), high.tolist(), (255, 255, 255), 1)
    low, high = np.round(box[:2]).astype(int), np.round(box[:2] + box[2:]).astype(int)
    cv2.rectangle(image, low.tolist(), high.tolist(), (255, 255, 255), 2)
    return image


def _table(runs: Sequence[Run]) -> Table:
    rows = []
    for name, of_setting in _by_setting(runs).items():
        held = [run for run in of_setting if run.outcome == "held"]
        shares = [_share(of_setting, outcome) for outcome in ("switched", "lost", "held")]
        rows.append(
            [
                name,
                *(_cell(figure, 100.0, 0) for figure in shares),
                _cell(intervals.mean([run.mean_error for run in of_setting])),
                _cell(intervals.mean([run.mean_error for run in held])),
                _cell(intervals.mean([run.jitter for run in held]), digits=2),
                f"{np.median([run.milliseconds for run in of_setting]):.2f}",
            ]
        )
    return Table(f"Umbrellas, {_scenes(runs)}", HEADINGS, [rows])


def _comparison(runs: Sequence[Run]) -> str:
    """Sentences on where color alone switched from, and on 60 particles instead of 30."""
    color, few, many = _by_setting(runs).values()
    switched = sum(run.outcome == "switched" for run in color)
    on_target = sum(run.true_switch for run in color)
    ratios = [
        second.jitter / first.jitter
        for first, second in zip(few, many, strict=True)
        if first.outcome == second.outcome == "held"
    ]
    figure = intervals.mean(ratios)
    return (
        f"Color alone was on the target right before the meeting in {on_target} of the {switched} "
        "scenes in which it switched. "
        f"Jitter of N = 60 over that of N = 30 in the {len(ratios)} scenes that both hold: "
        f"{_cell(figure, digits=2)}."
    )


def _share(runs: Sequence[Run], outcome: str) -> Interval:
    return intervals.share(sum(run.outcome == outcome for run in runs), len(runs))


def _cell(figure: Interval, factor: float = 1.0, digits: int = 1) -> str:
    if np.isnan(figure.value):
        return "-"
    value, low, high = (
        f"{factor * number:.{digits}f}" for number in (figure.value, figure.low, figure.high)
    )
    return value if np.isnan(figure.low) else f"{value} ({low}-{high})"


def _by_setting(runs: Sequence[Run]) -> dict[str, list[Run]]:
    settings: dict[str, list[Run]] = {}
    for run in runs:
        settings.setdefault(run.setting, []).append(run)
    return settings


def _scenes(runs: Sequence[Run]) -> str:
    seeds = {run.seed for run in runs}
    return f"scenes {min(seeds)} to {max(seeds)}" if len(seeds) > 1 else f"scene {min(seeds)}"
