"""A robot that follows a person, in a closed loop: worlds drawn by seed, tracker and localizer.

    python benchmarks/follow.py --scenario depth_hand --seeds 0 4 --seconds 100 --jobs 2

Seeds below 100 are for development, those from 100 on for reports. `follow_parts/` has the world
(`world.py`), what happens in it (`scenarios.py`), the loop (`loop.py`) and the figures
(`metrics.py`). One seed gives one run, to the bit.

right: share of the frames that show the person whose box is on them. pose: share of those frames
with a pose. off: share of the poses that are wrong by more than 0.7 m. kept: share of the time at
1.5 to 3 m. astray: seconds on somebody else, each time for over a second. silence: the longest time
without a pose. first: seconds from the end of an occlusion of under a second to the first right
pose, median and 90 %; late: of longer ones. back: share of the absences of over 2 s after which
that takes at most 2 s. stands: speed and acceleration of the pose while the person stands, 95 %.
rms: of the pose's distance, and of the unfiltered one. lag: of the pose, seconds. NEES: over its
degrees of freedom.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing
from importlib import import_module
from typing import Any

import arguments as options_of
import cv2
import numpy as np
from follow_parts.chain import LibraryChain
from follow_parts.loop import moments
from follow_parts.metrics import figures, row_of
from follow_parts.scenarios import SCENARIOS
from follow_parts.world import World
from tables import Table

from pf_tracker_ros.progress import progress_bar

# Heading to the figures of a cell.
_COLUMNS = {
    "right": ("right",),
    "pose": ("pose",),
    "off": ("off",),
    "kept": ("kept",),
    "astray s": ("astray",),
    "silence s": ("silence",),
    "first s": ("first_50", "first_90"),
    "late s": ("late_50", "late_90"),
    "back": ("back",),
    "stands": ("stands_speed", "stands_acceleration"),
    "rms / raw m": ("rms", "raw_rms"),
    "lag s": ("lag",),
    "NEES": ("nees",),
}


def run(name: str, seed: int, options: argparse.Namespace) -> dict[str, float]:
    """The figures of a run."""
    cv2.setNumThreads(1)
    scenario = SCENARIOS[name]
    world = World.draw(seed, scenario, options.seconds)
    kind: Any = LibraryChain
    if options.nodes:
        # Only here, as ROS is not installed everywhere.
        kind = import_module("follow_parts.nodes").NodeChain
    with closing(kind(scenario, seed, has_imu=world.has_imu)) as chain:
        rows = [row_of(one) for one in moments(world, scenario, seed, options.seconds, chain)]
    return figures(rows)


def table(results: dict[str, dict[int, dict[str, float]]]) -> Table:
    """Rows for each scenario: its seeds, and their mean."""
    rows = []
    for name, by_seed in results.items():
        rows += [[name, str(seed), *_cells([one])] for seed, one in sorted(by_seed.items())]
        rows.append([name, "mean", *_cells(list(by_seed.values()))])
    return Table("Following a person", ("scenario", "seed", *_COLUMNS), rows, names=2)


def _cells(runs: Sequence[dict[str, float]]) -> list[str]:
    """The means of the runs that have a figure."""
    cells = []
    for names in _COLUMNS.values():
        means = []
        for name in names:
            values = [one[name] for one in runs if not math.isnan(one[name])]
            means.append(f"{np.mean(values):.2f}" if values else "-")
        cells.append(" / ".join(means))
    return cells


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, print, and write `follow.json`."""
    made = options_of.parser(__doc__)
    made.add_argument("--scenario", action="append", choices=SCENARIOS, help="may be repeated")
    made.add_argument(
        "--seeds", nargs=2, type=options_of.at_least(0), default=(0, 2), metavar=("FIRST", "COUNT")
    )
    made.add_argument("--seconds", type=float, default=100.0, help="of each run [%(default)s]")
    made.add_argument("--jobs", type=options_of.at_least(1), default=1, help="[%(default)s]")
    made.add_argument("--nodes", action="store_true", help="the nodes of ROS, not the library")
    options_of.add_folder(made)
    options = made.parse_args(arguments)
    names = options.scenario or list(SCENARIOS)
    first, count = options.seeds
    runs = [(name, seed) for name in names for seed in range(first, first + count)]
    results: dict[str, dict[int, dict[str, float]]] = {name: {} for name in names}
    path = options.output / "follow.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    context = multiprocessing.get_context("spawn")
    with (
        progress_bar(len(runs), "runs") as on_progress,
        ProcessPoolExecutor(options.jobs, mp_context=context) as pool,
    ):
        waiting = {pool.submit(run, *one, options): one for one in runs}
        for done in as_completed(waiting):
            name, seed = waiting[done]
            try:
                results[name][seed] = done.result()
            except Exception as error:
                # At once, not after hours of other runs.
                pool.shutdown(wait=False, cancel_futures=True)
                raise RuntimeError(f"the run of {name} with seed {seed} has failed") from error
            on_progress(f"{name} {seed}", 1)
            # A long measurement may be stopped.
            path.write_text(json.dumps(results, indent=1), encoding="utf-8")
    table(results).show()


if __name__ == "__main__":
    main()
