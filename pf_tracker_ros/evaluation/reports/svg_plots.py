"""SVG plots in the colors of the surrounding page, light or dark. Needs Matplotlib.

1. Matplotlib draws each part in a placeholder color.
2. The placeholders are replaced by CSS variables of the page.
"""

from __future__ import annotations

import hashlib
import io
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.evaluation.metrics import SUCCESS_THRESHOLDS
from pf_tracker_ros.evaluation.reports.content import GroundView, SequenceContent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Inches; small, so that the letters are readable at a phone's width.
_SIZE = (4.4, 2.5)
_TALL = (4.4, 3.3)
_SQUARE = (5.6, 4.8)
# Arrows where the camera looks.
_ARROWS = 4
# Placeholder color to CSS variable.
_PAGE_COLORS = {
    "#010101": "var(--ink)",
    "#020202": "var(--faint)",
    "#030303": "var(--line-1)",
    "#040404": "var(--line-2)",
    "#050505": "var(--line-3)",
    "#060606": "var(--line-4)",
    "#070707": "var(--line-5)",
    "#080808": "var(--bad)",
    "#090909": "var(--doubtful)",
}
_INK, _FAINT, *_LINES, _BAD, _DOUBTFUL = _PAGE_COLORS
_DASHES = ("-", "--", "-.", ":")


def success_plot(curves: Mapping[str, NDArray[np.float64]]) -> str:
    """Success curves, (21,) each, with the area under each in the legend."""
    figure, axes = _figure(_TALL, "overlap threshold", "share of frames above")
    for label, curve in curves.items():
        _line(axes, SUCCESS_THRESHOLDS, curve, f"{label} [{np.mean(curve):.3f}]")
    axes.set(xlim=(0, 1), ylim=(0, 1.02))
    _legend(axes, "lower left")
    return _svg(figure, "Success plot")


def precision_plot(curves: Mapping[str, NDArray[np.float64]]) -> str:
    """Precision curves, (51,) each, with the value at 20 px in the legend."""
    figure, axes = _figure(_TALL, "center error, px", "share of frames within")
    for label, curve in curves.items():
        _line(axes, np.arange(len(curve)), curve, f"{label} [{curve[20]:.3f}]")
    axes.axvline(20, color=_FAINT, linewidth=0.8)
    axes.set(xlim=(0, 50), ylim=(0, 1.02))
    _legend(axes, "lower right")
    return _svg(figure, "Precision plot")


def reliability_plot(curves: Mapping[str, NDArray[np.float64]]) -> str:
    """Reliability diagram: label to (ranges, 2) mean confidence and share of right frames."""
    figure, axes = _figure(_TALL, "confidence", "share of right frames")
    axes.plot((0, 1), (0, 1), color=_FAINT, linewidth=0.8)
    for label, curve in curves.items():
        _line(axes, curve[:, 0], curve[:, 1], label)
        axes.lines[-1].set(marker="o", markersize=3)
    axes.set(xlim=(0, 1), ylim=(0, 1.02))
    _legend(axes, "lower right")
    return _svg(figure, "Reliability diagram")


def series_plots(content: SequenceContent) -> dict[str, str]:
    """Plots of the known quantities over the frames, heading to SVG."""
    plots = {}
    if content.overlaps is not None:
        plots["overlap"] = _series(content, {"overlap": content.overlaps}, (0, 1.02))
    if content.center_errors is not None:
        plots["center error, px"] = _series(content, {"center error": content.center_errors})
    if not np.isnan(content.confidence).all():
        plots["confidence"] = _series(content, {"confidence": content.confidence}, (0, 1.02))
    if not np.isnan(content.effective_sample_size).all():
        plots["effective sample size"] = _series(
            content, {"effective sample size": content.effective_sample_size}
        )
    if content.cue_weights:
        plots["cue weights"] = _series(content, content.cue_weights, (0, 1.02))
    return plots


def view_from_above(view: GroundView) -> str:
    """Ways of the targets and of the camera on the ground, with 90 % regions; x to the right."""
    return _svg(_view_from_above(view), "View from above")


def _view_from_above(view: GroundView) -> Figure:
    from matplotlib.patches import Ellipse

    figure, axes = _figure(_SQUARE, f"x in {view.frame}, m", "y, m")
    for track in view.tracks:
        _line(axes, track.positions[:, 0], track.positions[:, 1], track.name)
        color = axes.lines[-1].get_color()
        for region in track.regions:
            ellipse = Ellipse(
                (region.x, region.y),
                2.0 * region.first,
                2.0 * region.second,
                angle=float(np.degrees(region.angle)),
                facecolor=color,
                edgecolor=color,
                alpha=0.3,
                linewidth=0.6,
            )
            axes.add_patch(ellipse)
        known = track.positions[np.isfinite(track.positions).all(axis=1)]
        axes.plot(*known[-1:].T, color=color, marker="o", markersize=4)
    if len(view.camera):
        axes.plot(*view.camera.T, color=_INK, linewidth=1.0, label="camera")
        length = 0.08 * max(np.ptp(axes.dataLim.intervalx), np.ptp(axes.dataLim.intervaly), 1.0)
        for index in np.linspace(0, len(view.camera) - 1, _ARROWS).astype(int):
            start, end = view.camera[index], view.camera[index] + length * view.axes[index]
            arrow = {"arrowstyle": "->", "color": _INK, "linewidth": 0.8}
            axes.annotate("", xy=end, xytext=start, arrowprops=arrow)
    axes.set_aspect("equal", adjustable="datalim")
    _legend(axes)
    return figure


def _series(
    content: SequenceContent,
    lines: Mapping[str, NDArray[np.float64]],
    limits: tuple[float, float] | None = None,
) -> str:
    figure, axes = _figure(_SIZE, "frame", "")
    for state, color in (("lost", _BAD), ("occluded", _DOUBTFUL)):
        for first, last in content.frame_ranges(state):
            axes.axvspan(first - 0.5, last + 0.5, color=color, alpha=0.25, linewidth=0)
    for label, values in lines.items():
        _line(axes, content.first + np.arange(content.frames), values, label)
    axes.set_xlim(content.first, content.first + max(1, content.frames - 1))
    axes.set_ylim(*(limits or (0, None)))
    if len(lines) > 1:
        _legend(axes)
    return _svg(figure, f"{', '.join(lines)} over the frames of {content.name}")


def _figure(size: tuple[float, float], x_label: str, y_label: str) -> tuple[Figure, Axes]:
    # Not pyplot's: needs no window system and leaves no figures open.
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    axes = figure.add_subplot()
    axes.set_xlabel(x_label, color=_INK, fontsize=9)
    axes.set_ylabel(y_label, color=_INK, fontsize=9)
    axes.tick_params(colors=_INK, labelsize=8)
    axes.grid(color=_FAINT, linewidth=0.5)
    for spine in axes.spines.values():
        spine.set_color(_FAINT)
    figure.patch.set_visible(False)
    axes.patch.set_visible(False)
    return figure, axes


def _line(axes: Axes, x: NDArray[Any], y: NDArray[np.float64], label: str) -> None:
    number = len(axes.lines)
    axes.plot(
        x,
        y,
        # Matplotlib would take dollar signs for formulas.
        label=label.replace("$", r"\$"),
        color=_LINES[number % len(_LINES)],
        linestyle=_DASHES[number // len(_LINES) % len(_DASHES)],
        linewidth=1.4,
        # Without markers, a single known frame between unknown ones would be invisible.
        marker="." if np.isnan(y).any() else None,
        markersize=2,
    )


def _legend(axes: Axes, place: Literal["best", "lower left", "lower right"] = "best") -> None:
    legend = axes.legend(loc=place, fontsize=8, labelcolor=_INK, framealpha=0.0)
    legend.get_frame().set_linewidth(0.0)


def _svg(figure: Figure, title: str) -> str:
    import matplotlib

    output = io.StringIO()
    # Texts stay texts. The salt makes element ids unique among the plots of a page.
    salt = hashlib.sha256(title.encode("utf-8", "replace")).hexdigest()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": salt}):
        figure.savefig(output, format="svg", metadata={"Date": None, "Creator": None})
    text = output.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    # The page sets size and font.
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    text = re.sub(r"(font: [\d.]+px )'[^;\"]*", r"\1var(--letters)", text)
    for color, variable in _PAGE_COLORS.items():
        text = text.replace(color, variable)
    return text
