"""The success plot, drawn with Matplotlib."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.evaluation.metrics import SUCCESS_THRESHOLDS
from pf_tracker_ros.evaluation.results import EvaluationError

_MAX_CURVES_WITH_INNER_LEGEND = 4


def check_plot_format(path: str | Path) -> None:
    """Check that `save_success_plot` supports a file's format.

    Raises:
        EvaluationError: Matplotlib does not support the suffix.
    """
    from matplotlib.backend_bases import FigureCanvasBase

    known = FigureCanvasBase.get_supported_filetypes()
    if Path(path).suffix.lower().removeprefix(".") not in known:
        raise EvaluationError(
            f"'{path}' is no image file; allowed suffixes: {', '.join(sorted(known))}"
        )


def save_success_plot(
    path: str | Path,
    curves: Mapping[str, NDArray[np.float64]],
    details: Mapping[str, NDArray[np.float64]] | None = None,
    dashed: Collection[str] = (),
) -> None:
    """Draw success curves into an image file.

    The legend has the area under each curve, highest first. With many curves it is beside the plot.

    Args:
        path: The file; its suffix selects the format (.png, .pdf, .svg, ...).
        curves: Label to (21,) success curve, for example one for each tracker.
        details: Curves of single sequences, drawn in thin gray behind the others.
        dashed: Labels of `curves` to draw as dashed lines, for example baselines.

    Raises:
        EvaluationError: Matplotlib does not support the suffix.
        OSError: The file cannot be written.
    """
    check_plot_format(path)
    # Not pyplot's: needs no window system and leaves no figures open.
    from matplotlib.figure import Figure

    is_crowded = len(curves) > _MAX_CURVES_WITH_INNER_LEGEND
    figure = Figure(figsize=(9.0 if is_crowded else 6.4, 4.8), layout="constrained")
    axes = figure.add_subplot(
        xlabel="overlap threshold",
        ylabel="share of frames above",
        xlim=(0, 1),
        ylim=(0, 1.02),
        title="success",
    )
    axes.grid(alpha=0.3)
    # A single sequence equals the mean.
    sequences = list(details.values()) if details and len(details) > 1 else []
    for number, curve in enumerate(sequences):
        # One legend entry for all.
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
