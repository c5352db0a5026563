"""Cost of a frame: each stage of the library, and its growth.

CPU time of one thread, medians. Compared functions alternate in one process, so that other load
slows both. Quote the ratios.

    python benchmarks/kernels.py --output benchmarks/results/kernels.md --plot docs/growth.png

`--only` selects a part:

- loop: an update of `li2007` against a loop over particles as in tutorials, with `cv2.calcHist`,
  `cv2.compareHist` and a gradient orientation vector.
- stages: every map, every cue's scoring and every preset's update, by size of the image (320x240 to
  1920x1080), side of the box (20 to 200 px), number of particles (30 to 10,000) and kind of image;
  with a lower bound: one pass of OpenCV over the same pixels, or one number read per particle.
- python: share of Python's overhead in an update of `default`.
- bars: the ratios that have a limit.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path

# One thread for linear algebra; read when NumPy is imported.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import arguments as options_of
import cv2
from arguments import at_least
from kernel_stages.growth import AXES, Cost, along, draw_growth, exponent, measure_stages
from kernel_stages.li2007 import CLOUDS, Row, measure_li2007
from kernel_stages.measured_limits import measure_limits
from kernel_stages.python_share import measure_python_share
from kernel_stages.setting import Setting
from kernel_stages.stages import STAGES
from limits import limits_table, save_tables
from tables import Table

LOOP_SIDES = (20, 40, 80, 160)
LOOP_PARTICLES = (60, 1000, 10_000)
AXIS_NAMES = {"size": "image", "side": "box, px", "particles": "N", "kind": "kind of image"}


def loop_tables(given: argparse.Namespace) -> list[Table]:
    """`li2007` compared with the loop over particles, where that is not too slow."""
    rows = [
        measure_li2007(
            particles,
            side,
            cloud,
            given.turns,
            against_loop=side == 40 and particles <= 1000,
        )
        for side in LOOP_SIDES
        for cloud in CLOUDS
        for particles in LOOP_PARTICLES
    ]
    headings = ["N", "box", "cloud over", "spread, px", "update", "loop", "ratio"]
    headings += ["us per further particle"]
    least = {(row.side, row.cloud): row for row in rows if row.particles == LOOP_PARTICLES[0]}
    groups = [
        [_loop_cells(row, least[row.side, row.cloud]) for row in rows if row.side == side]
        for side in LOOP_SIDES
    ]
    title = "One update of li2007 at 768x576, CPU ms"
    return [Table(title, headings, groups, names=3)]


def _loop_cells(row: Row, least: Row) -> list[str]:
    further = ""
    if row is not least:
        more = row.update - least.update
        further = f"{1e3 * more / (row.particles - least.particles):.1f}"
    return [
        str(row.particles),
        f"{row.side} px",
        row.cloud,
        f"{row.spread:.1f}",
        f"{row.update:.2f}",
        f"{row.loop:.1f}" if row.loop else "",
        f"{row.ratio:.1f}" if row.ratio else "",
        further,
    ]


def stage_tables(given: argparse.Namespace) -> list[Table]:
    """Cost of each stage, and its growth."""
    costs = measure_stages(given.turns)
    usual = Setting()
    rows = []
    for name in STAGES:
        cost = costs[name][usual]
        exponents = [exponent(costs[name], axis) for axis in ("particles", "side", "size")]
        rows.append(
            [
                name,
                f"{1e3 * cost.stage:.0f}",
                f"{1e3 * cost.floor:.1f}",
                f"{cost.stage / cost.floor:.0f}",
                *("" if math.isnan(value) else f"{value:+.2f}" for value in exponents),
            ]
        )
    headings = ["stage", "us", "floor, us", "ratio", "exponent in N", "in the box", "in the image"]
    tables = [Table(f"Each stage at {usual.text}", headings, [rows])]
    for axis, values in AXES.items():
        texts = ["x".join(map(str, value)) if axis == "size" else str(value) for value in values]
        rows = [
            [name, *(_cost_text(cost) for cost in along(costs[name], axis))]
            for name in STAGES
            if sum(cost is not None for cost in along(costs[name], axis)) > 1
        ]
        title = f"us (ratio to the floor) by {AXIS_NAMES[axis]}"
        tables.append(Table(title, ["stage", *texts], [rows]))
    if given.plot:
        draw_growth(costs, given.plot)
    return tables


def _cost_text(cost: Cost | None) -> str:
    return f"{1e3 * cost.stage:.0f} ({cost.stage / cost.floor:.0f})" if cost else ""


def python_tables(given: argparse.Namespace) -> list[Table]:
    """The share of Python's overhead in an update of `default`."""
    found = measure_python_share(given.turns)
    rows = [
        ["an update", f"{found.update:.2f}", f"{found.calls:.0f}"],
        [
            "the same calls with next to nothing",
            f"{found.overhead:.2f}",
            f"{found.least_calls:.0f}",
        ],
        ["**share**", f"**{100 * found.overhead / found.update:.0f} %**", ""],
    ]
    headings = ["", "CPU ms", "functions called"]
    return [Table("Python's overhead in an update of `default` at 768x576", headings, [rows])]


def limit_tables(given: argparse.Namespace) -> list[Table]:
    """The ratios with limits."""
    return [limits_table(measure_limits(given.turns))]


PARTS = {
    "loop": loop_tables,
    "stages": stage_tables,
    "python": python_tables,
    "limits": limit_tables,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables and optionally save them.

    Args:
        arguments: Command line without program name; None for the process'.
    """
    parser = options_of.parts_parser(__doc__, PARTS)
    parser.add_argument("--turns", type=at_least(1), default=10, help="of each comparison [10]")
    parser.add_argument("--plot", type=Path, help="image file for the growth of the stages")
    given = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    tables = []
    for part in given.only or PARTS:
        for table in PARTS[part](given):
            table.show()
            tables.append(table)
    save_tables(given.output, tables, "kernels.py", arguments)
    return 0


if __name__ == "__main__":
    sys.exit(main())
