"""Growth of each stage's cost, fitted and plotted."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from rich.progress import track

from kernel_stages.setting import KINDS, PARTICLES, SIDES, SIZES, Setting
from kernel_stages.stages import MAPS, SCORING, STAGES, UPDATES, Stage, floor
from kernel_stages.timing import by_turns

mpl.use("Agg")
from matplotlib import pyplot
from matplotlib.ticker import NullLocator

# Field of a setting to the values that it takes, the others being as they usually are.
AXES: Mapping[str, Sequence[Any]] = {
    "size": SIZES,
    "side": SIDES,
    "particles": PARTICLES,
    "kind": KINDS,
}
# What of a setting grows, to the number that it is measured by.
_MEASURES = {
    "particles": ("particles", lambda setting: setting.particles),
    "side": ("side of the box, px", lambda setting: setting.side),
    "size": ("pixels of the image", lambda setting: math.prod(setting.size)),
}
_FIGURE = (15.0, 5.5)


class Cost(NamedTuple):
    """Milliseconds of a stage in a setting, and of its floor in the same run."""

    stage: float
    floor: float


Costs = dict[str, dict[Setting, Cost]]


def measure_stages(turns: int, names: Sequence[str] = tuple(STAGES)) -> Costs:
    """Each stage in each setting, one property of it varied at a time."""
    usual = Setting()
    settings = {
        replace(usual, **{axis: value}): None for axis, values in AXES.items() for value in values
    }
    costs: Costs = {name: {} for name in names}
    for setting in track([*settings], "stages", transient=True):
        for name in names:
            if _counts(STAGES[name], name, setting):
                stage = STAGES[name]
                found = by_turns([stage.make(setting), floor(stage, setting)], turns)
                costs[name][setting] = Cost(*found)
    return costs


def _counts(stage: Stage, name: str, setting: Setting) -> bool:
    """Whether a setting says anything of a stage: maps do not know the particles."""
    usual = Setting()
    return name not in MAPS or setting.particles == usual.particles


def exponent(costs: Mapping[Setting, Cost], axis: str) -> float:
    """The power by which a stage's cost grows; not a number where it was not measured."""
    settings = _along(costs, axis)
    if len(settings) < 2:
        return math.nan
    measure = _MEASURES[axis][1]
    values = [math.log(measure(setting)) for setting in settings]
    times = [math.log(costs[setting].stage) for setting in settings]
    return float(np.polyfit(values, times, 1)[0])


def _along(costs: Mapping[Setting, Cost], axis: str) -> list[Setting]:
    usual = Setting()
    return [
        setting for value in AXES[axis] if (setting := replace(usual, **{axis: value})) in costs
    ]


def along(costs: Mapping[Setting, Cost], axis: str) -> list[Cost | None]:
    """The costs for each value of a property, None where it was not measured."""
    usual = Setting()
    return [costs.get(replace(usual, **{axis: value})) for value in AXES[axis]]


def draw_growth(costs: Costs, path: Path) -> None:
    """Draw how the stages grow, with the fitted exponents."""
    figure, axes = pyplot.subplots(1, 3, figsize=_FIGURE, sharey=True)
    shown = {"particles": {**SCORING, **UPDATES}, "side": STAGES, "size": STAGES}
    colors = mpl.colormaps["tab20"]
    colored = {name: colors(number % 20) for number, name in enumerate(STAGES)}
    for plot, (axis, stages) in zip(axes, shown.items(), strict=True):
        title, measure = _MEASURES[axis]
        for name in stages:
            settings = _along(costs.get(name, {}), axis)
            if len(settings) < 2:
                continue
            plot.loglog(
                [measure(setting) for setting in settings],
                [costs[name][setting].stage for setting in settings],
                color=colored[name],
                linestyle="-" if name in UPDATES else "--" if name in SCORING else ":",
                marker=".",
                label=f"{name}: {exponent(costs[name], axis):+.2f}",
            )
        measures = [measure(replace(Setting(), **{axis: value})) for value in AXES[axis]]
        plot.set_xticks(measures, [f"{value:,}" for value in measures])
        plot.xaxis.set_minor_locator(NullLocator())
        plot.set_xlabel(title)
        plot.grid(visible=True, which="major", alpha=0.3)
        plot.legend(fontsize=5.5, loc="upper left", bbox_to_anchor=(0.0, -0.12), ncols=2)
    axes[0].set_ylabel("CPU ms, one thread")
    figure.suptitle("Cost of each stage, with the fitted exponents")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, bbox_inches="tight")
    pyplot.close(figure)
