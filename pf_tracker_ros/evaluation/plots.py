"""The success plot, drawn with Matplotlib."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.evaluation.metrics import SUCCESS_THRESHOLDS
from pf_tracker_ros.evaluation.results import EvaluationError

_MOST_WITH_LEGEND_INSIDE = 4


def check_plot_format(path: str | Path) -> None:
    """Refuse a file that `save_success_plot` could not write.

    Raises:
        EvaluationError: Matplotlib does not know the ending; the message lists those it knows.
    """
    from matplotlib.backend_bases import FigureCanvasBase

    known = FigureCanvasBase.get_supported_filetypes()
    if Path(path).suffix.lower().removeprefix(".") not in known:
        raise EvaluationError(
            f"'{path}' is no image file; allowed: an ending out of {', '.join(sorted(known))}"
        )


def save_success_plot(
    path: str | Path,
    curves: Mapping[str, NDArray[np.float64]],
    details: Mapping[str, NDArray[np.float64]] | None = None,
    dashed: Collection[str] = (),
) -> None:
    """Draw success curves into an image file.

    The legend gives each curve's area under it, highest first; it stands beside the plot where it
    would hide some of many curves.

    Args:
        path: The file; its ending decides on the format (.png, .pdf, .svg, ...).
        curves: Label to (21,) success curve, for example one of each tracker.
        details: Curves of single sequences, in thin gray behind the others.
        dashed: Labels of `curves` to draw as dashed lines, for example of what one compares with.

    Raises:
        EvaluationError: Matplotlib does not know the ending.
        OSError: The file cannot be written.
    """
    check_plot_format(path)
    # A Figure of its own, not pyplot's: no window system, no figures left open.
    from matplotlib.figure import Figure

    is_crowded = len(curves) > _MOST_WITH_LEGEND_INSIDE
    figure = Figure(figsize=(9.0 if is_crowded else 6.4, 4.8), layout="constrained")
    axes = figure.add_subplot(
        xlabel="overlap threshold",
        ylabel="share of frames above",
        xlim=(0, 1),
        ylim=(0, 1.02),
        title="success",
    )
    axes.grid(alpha=0.3)
    # A single one is the mean of itself.
    behind = list(details.values()) if details and len(details) > 1 else []
    for number, curve in enumerate(behind):
        # One of them stands for all in the legend.
        label = None if number else "single sequences"
        axes.plot(SUCCESS_THRESHOLDS, curve, color="0.75", linewidth=0.8, label=label)
    areas = {label: float(np.mean(curve)) for label, curve in curves.items()}
    for label in sorted(areas, key=areas.__getitem__, reverse=True):
        axes.plot(
            SUCCESS_THRESHOLDS,
            curves[label],
            linewidth=2,
            linestyle="--" if label in dashed else "-",
            label=f"{label} [{areas[label]:.3f}]",
        )
    if is_crowded:
        figure.legend(loc="outside right upper")
    else:
        axes.legend()
    figure.savefig(path, dpi=150)
