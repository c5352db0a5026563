"""The tracker node compared with a bare subscriber: latency, losses, CPU, start, memory, overload.

Camera, tracker and bare subscriber are separate processes on the loopback. The bare subscriber
publishes a polygon for each image at once, so its figures are ROS' share. Both alternate in one
run, so that other load slows both.

    python benchmarks/node.py --output benchmarks/results/node.md

`--only` selects a part:

- latency: time from publishing a frame to its box, frames without a box, frames answered after the
  next one was due, processing time in the status, and share of one core; by size of the image, rate
  and QoS: a best-effort camera, a reliable one, and a reliable one with the Fast DDS profile for
  large images on both sides.
- cost: CPU time per frame of the tracker's process, and its excess over `Tracker.update` in a
  separate process plus the bare subscriber.
- start: seconds from the start of a process to its first answer to a running camera.
- overload: age of the answered frames while a camera sends more than can be tracked.
- memory: memory of the tracker's process after 500 frames and at the end.
- side_by_side: 1, 2, 4 and 8 trackers, each with its own images.
"""

from __future__ import annotations

import argparse
import math
import os
import subprocess
import sys
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from statistics import median
from typing import NamedTuple

import arguments as options_of
import numpy as np
from arguments import at_least
from limits import Limit, limits_table, save_tables
from node_runs.camera import (
    SIZES,
    Footage,
    Run,
    percentiles,
    play,
    seconds_to_first_answer,
)
from node_runs.processes import (
    BARE,
    NAMES,
    TRACKER,
    bare_command,
    process,
    profile,
    tracker_command,
)
from numpy.typing import NDArray
from rich.console import Console
from tables import Table

from pf_tracker_ros.ros_domains import unused_domain
from pf_tracker_ros.tracking.presets import PRESETS

QOS_SETTINGS = {
    "best effort": {"reliability": "best_effort", "large_images": False},
    "reliable": {"reliability": "reliable", "large_images": False},
    "large images": {"reliability": "reliable", "large_images": True},
}
RATES = (30, 60, 120)
EARLY_FRAME = 500
# Of the values of a run, in order.
Quarters = list[NDArray[np.float64]]
SIDE_BY_SIDE = (1, 2, 4, 8)
PERCENTILES = (50, 99, 99.9)


class Measured(NamedTuple):
    """Result of a part of the benchmark."""

    tables: list[Table]
    limits: list[Limit]


def turn(footage: Footage, listener: str, *parameters: str, every: int = 100) -> Run:
    """One turn of the tracker or the bare subscriber."""
    commands = {TRACKER: tracker_command(*parameters), BARE: bare_command(footage.reliability)}
    with process(commands[listener], large_images=footage.large_images) as child:
        return play(footage, NAMES[listener], watched=[child.pid], every=every)


def by_turns(footage: Footage, rounds: int, *parameters: str) -> dict[str, list[Run]]:
    """Turns of both subscribers; the parameters are the tracker's."""
    runs: dict[str, list[Run]] = {TRACKER: [], BARE: []}
    for _ in range(rounds):
        for listener, done in runs.items():
            done.append(turn(footage, listener, *parameters))
    return runs


def measure_latency(given: argparse.Namespace) -> Measured:
    """Latency, losses and share of a core of both, for every selected camera."""
    groups = []
    for size in given.size or SIZES:
        for rate in given.rate or RATES:
            for quality in given.qos or QOS_SETTINGS:
                footage = Footage(size, float(rate), given.seconds, **QOS_SETTINGS[quality])
                name = f"{size}, {rate} fps, {quality}"
                progress(name)
                runs = by_turns(footage, given.rounds, f"preset:={given.preset}")
                groups.append(
                    [[name, who, *_latency_cells(runs[who], rate)] for who in (TRACKER, BARE)]
                )
    headings = ["camera", "", "frames", "without a box %", "late %", "core %", "own"]
    headings += ["p50", "p99", "p99.9"]
    title = "From publishing a frame to its box, ms, and the share of one core of the process"
    return Measured([Table(title, headings, groups, names=2)], [])


def _latency_cells(runs: Sequence[Run], rate: float) -> list[str]:
    answers = [run.answers[0] for run in runs]
    latencies = [value for one in answers for value in one.latencies]
    published = sum(len(one.published) for one in answers)
    shares = [run.cpu_shares[0] for run in runs]
    own = [1e3 * value for one in answers for value in one.processing.values()]
    late = sum(value > 1e3 / rate for value in latencies)
    return [
        str(published),
        f"{100 * (1 - len(latencies) / published):.1f}",
        f"{100 * late / published:.1f}",
        f"{100 * median(shares):.0f}",
        f"{median(own):.1f}" if own else "",
        *(f"{value:.1f}" for value in percentiles(latencies, *PERCENTILES)),
    ]


def measure_cost(given: argparse.Namespace) -> Measured:
    """CPU time of a frame, and the node's excess over the library and a bare subscriber."""
    footage = Footage(seconds=given.seconds)
    width, height = SIZES[footage.size]
    script = Path(__file__).parent / "node_runs" / "library_updates.py"
    count = int(footage.rate * footage.seconds)
    update = [str(value) for value in (width, height, int(footage.rate), count)]
    library, tracker, bare, shares = [], [], [], []
    for _ in range(given.rounds):
        progress("cost of a frame")
        found = subprocess.run(
            [sys.executable, str(script), *update], check=True, capture_output=True, text=True
        )
        library.append(float(found.stdout))
        run = turn(footage, TRACKER)
        tracker.append(run.cpu_a_frame[0])
        shares.append(run.cpu_shares[0])
        bare.append(turn(footage, BARE).cpu_a_frame[0])
    added = [whole - own - ros for whole, own, ros in zip(tracker, library, bare, strict=True)]
    rows = [
        ["tracker's process", f"{median(tracker):.2f}"],
        ["`Tracker.update` alone", f"{median(library):.2f}"],
        ["bare subscriber's process", f"{median(bare):.2f}"],
        ["added by the node", f"{median(added):.2f}"],
    ]
    title = f"CPU ms a frame at {footage.size}, {footage.rate:g} fps, `default`"
    return Measured(
        [Table(title, ["", "ms"], [rows])],
        [
            Limit("CPU that the node adds to a frame", median(added), 0.8, unit=" ms"),
            Limit("share of one core at 30 fps", 100 * median(shares), 40.0, unit=" %"),
        ],
    )


def measure_start(given: argparse.Namespace) -> Measured:
    """Seconds from the start of a process to its first answer."""
    footage = Footage()
    commands = {TRACKER: tracker_command(), BARE: bare_command(footage.reliability)}
    found: dict[str, list[float]] = {TRACKER: [], BARE: []}
    os.environ |= profile(footage.large_images)
    for _ in range(max(given.rounds, 5)):
        for who, command in commands.items():
            progress(f"start of the {who}")
            found[who].append(seconds_to_first_answer(footage, NAMES[who], command))
    rows = [
        [who, f"{median(values):.2f}", f"{min(values):.2f}", f"{max(values):.2f}"]
        for who, values in found.items()
    ]
    # The minimum, as Fast DDS randomly delays either by three seconds.
    bound = 1.5 * min(found[BARE]) + 0.7
    return Measured(
        [Table("Seconds from the start of a process to its first answer", _SPREAD, [rows])],
        [Limit("start to the first box, least", min(found[TRACKER]), round(bound, 2), unit=" s")],
    )


_SPREAD = ["", "median", "least", "most"]


def measure_overload(given: argparse.Namespace) -> Measured:
    """The age of processed frames over time while the camera is too fast."""
    footage = Footage(rate=120.0, seconds=given.seconds)
    progress("overload")
    groups = []
    for who, runs in by_turns(footage, given.rounds).items():
        answered, begun = (
            [_quarters(ages(run.answers[0])) for run in runs]
            for ages in (attrgetter("latencies"), attrgetter("ages_when_begun"))
        )
        rows = []
        for part in range(4):
            cells = [f"quarter {part + 1}"]
            for ages in (answered, begun):
                found = percentiles(np.concatenate([run[part] for run in ages]), 50, 100)
                cells += ["" if math.isnan(value) else f"{value:.1f}" for value in found]
            rows.append([who, *cells])
        groups.append(rows)
        if who == TRACKER:
            bars = _age_bars(answered, begun, footage.rate)
    title = f"Age of the frames that are processed, ms: {footage.size} at {footage.rate:g} fps"
    headings = ["", "", "when answered", "most", "when begun", "most"]
    return Measured([Table(title, headings, groups, names=2)], bars)


def _age_bars(answered: Sequence[Quarters], begun: Sequence[Quarters], rate: float) -> list[Limit]:
    intervals = rate / 1e3
    first, last = (median(percentiles(run[part], 50)[0] for run in answered) for part in (0, 3))
    return [
        Limit(
            f"oldest processed frame of the last quarter at {rate:g} fps, {moment}",
            median(percentiles(run[3], 100)[0] for run in ages) * intervals,
            2.0,
            unit=" intervals",
        )
        for moment, ages in (("when begun", begun), ("when answered", answered))
    ] + [Limit("median age of the last quarter, of that of the first", last / first, 1.1)]


def _quarters(values: Sequence[float]) -> Quarters:
    return np.array_split(np.array(values), 4)


def measure_memory(given: argparse.Namespace) -> Measured:
    """Memory over many frames, each sent after the answer to the last."""
    footage = Footage(rate=0.0, frames=given.frames)
    progress(f"memory over {given.frames} frames")
    run = turn(footage, TRACKER, every=EARLY_FRAME)
    memory = {sample.frame: sample.memory[0] for sample in run.samples}
    early, end = memory[EARLY_FRAME], run.samples[-1].memory[0]
    rows = [[str(frame), f"{megabytes:.1f}"] for frame, megabytes in memory.items()]
    kept = rows if len(rows) <= 12 else [*rows[:4], *rows[4:-1:4], rows[-1]]
    growth = 100 * (end / early - 1)
    return Measured(
        [Table("Memory that the tracker's process holds, MB", ["after frame", "MB"], [kept])],
        [
            Limit(
                f"growth of memory from frame {EARLY_FRAME} to {given.frames}",
                growth,
                5.0,
                unit=" %",
            )
        ],
    )


def measure_side_by_side(given: argparse.Namespace) -> Measured:
    """Several trackers at a time, each with its own images."""
    rows = []
    footage = Footage("640x480", 30.0, given.seconds)
    for count in SIDE_BY_SIDE:
        progress(f"{count} side by side")
        namespaces = [f"/camera_{number}" for number in range(count)]
        children, contexts = [], []
        try:
            for namespace in namespaces:
                contexts.append(process(tracker_command(namespace=namespace)))
                children.append(contexts[-1].__enter__())
            watched = [child.pid for child in children]
            run = play(footage, NAMES[TRACKER], namespaces, watched)
        finally:
            for context in contexts:
                context.__exit__(None, None, None)
        latencies = [value for one in run.answers for value in one.latencies]
        first, last = run.samples[0], run.samples[-1]
        rate = (last.frame - first.frame) / (last.moment - first.moment)
        lost = sum(one.frame_loss_rate for one in run.answers) / count
        rows.append(
            [
                str(count),
                f"{rate:.0f}",
                f"{100 * lost:.1f}",
                f"{100 * sum(run.cpu_shares):.0f}",
                f"{sum(run.cpu_a_frame) / count:.1f}",
                *(f"{value:.1f}" for value in percentiles(latencies, *PERCENTILES)),
                f"{sum(run.samples[-1].memory) / count:.0f}",
            ]
        )
    headings = [
        "nodes",
        "fps each",
        "without a box %",
        "cores %",
        "CPU ms a frame",
        "p50",
        "p99",
        "p99.9",
        "MB each",
    ]
    title = f"Trackers side by side, each with {footage.size} at {footage.rate:g} fps"
    return Measured([Table(title, headings, [rows])], [])


def progress(text: str) -> None:
    """Print the name of a measurement."""
    Console(stderr=True).print(f"[dim]{text} ...[/dim]")


PARTS = {
    "latency": measure_latency,
    "cost": measure_cost,
    "start": measure_start,
    "overload": measure_overload,
    "memory": measure_memory,
    "side_by_side": measure_side_by_side,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables and optionally save them.

    Args:
        arguments: Command line without program name; None for the process'.
    """
    parser = options_of.parts_parser(__doc__, PARTS)
    parser.add_argument("--seconds", type=at_least(1), default=10, help="of each turn [10]")
    parser.add_argument("--rounds", type=at_least(1), default=3, help="turns of each [3]")
    parser.add_argument(
        "--frames", type=at_least(EARLY_FRAME + 1), default=10_000, help="for the memory [10000]"
    )
    parser.add_argument("--size", action="append", choices=SIZES, help="for the latency")
    parser.add_argument("--rate", action="append", type=at_least(1), help="for the latency")
    parser.add_argument("--qos", action="append", choices=QOS_SETTINGS, help="for the latency")
    parser.add_argument("--preset", choices=PRESETS, default="default", help="for the latency")
    given = parser.parse_args(arguments)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    tables, bars = [], []
    with unused_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        for part in given.only or PARTS:
            found = PARTS[part](given)
            tables += found.tables
            bars += found.limits
            for table in found.tables:
                table.show()
    if bars:
        tables.append(limits_table(bars))
        tables[-1].show()
    save_tables(given.output, tables, "node.py", arguments)
    return 0


if __name__ == "__main__":
    sys.exit(main())
