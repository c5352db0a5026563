"""The experiment of Zhang, Hu, Shi 2015: HOG against a color histogram in infrared footage.

`zhang2015`, and `li2007` with color alone, track the same targets: generated infrared scenes, with
and without a flip of polarity, and recorded sequences. The paper's figures are the share of frames
that overlap the true box by more than 60 % of its area, and the frame after which the overlap stays
0. As the first favors boxes that are too large, the success AUC is reported as well.

    python benchmarks/infrared.py SEQUENCE_DIR... --seeds 3 --output benchmarks/results/infrared.md
"""

from __future__ import annotations

import argparse
import functools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import arguments as options_of
import numpy as np
from numpy.typing import NDArray
from scene_footage import SceneFootage
from scenes import InfraredScene
from scenes.infrared import FRAME_INTERVAL
from tables import Table

from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation import (
    SequenceResult,
    evaluate_sequence,
    has_target,
    read_sequences,
)
from pf_tracker_ros.footage import Footage

COLOR_ALONE = {"cues": ("color_histogram",)}
TRACKERS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "zhang2015": ("zhang2015", {}),
    "li2007, color alone": ("li2007", COLOR_ALONE),
    # The paper compares at the same number of particles.
    "li2007, color alone, N = 100": ("li2007", COLOR_ALONE | {"particles": 100}),
}
NEEDED_SHARE = 0.6
"""Minimum share of the true box's area in a tracked frame."""


@dataclass(frozen=True)
class Row:
    """One tracker on one sequence, means over the seeds."""

    sequence: str
    tracker: str
    tracked: float
    lost_runs: int
    runs: int
    frame_of_loss: float | None
    success_auc: float
    milliseconds: float


def covered_shares(
    boxes: NDArray[np.float64], true_boxes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(..., frames) share of the true box inside the box; NaN without true box."""
    near = np.maximum(boxes[..., :2], true_boxes[..., :2])
    far = np.minimum(boxes[..., :2] + boxes[..., 2:], true_boxes[..., :2] + true_boxes[..., 2:])
    return np.maximum(far - near, 0.0).prod(axis=-1) / true_boxes[..., 2:].prod(axis=-1)


def frame_of_loss(shares: NDArray[np.float64]) -> int | None:
    """The frame, counted from 1, after which the box never covers the target; None if none.

    Frames without a target, of share NaN, tell neither.
    """
    known = np.flatnonzero(~np.isnan(shares))
    uncovered = known[shares[known] == 0.0]
    seen = known[shares[known] > 0.0]
    lost = uncovered[uncovered > seen[-1]] if len(seen) else uncovered
    return int(lost[0]) + 1 if len(lost) else None


def row(tracker: str, result: SequenceResult) -> Row:
    """The figures of one tracker on one sequence."""
    shares = covered_shares(result.boxes, result.true_boxes)
    known = shares[:, has_target(result.true_boxes)]
    losses = [loss for loss in map(frame_of_loss, shares) if loss is not None]
    return Row(
        sequence=result.name,
        tracker=tracker,
        tracked=float((known > NEEDED_SHARE).mean()),
        lost_runs=len(losses),
        runs=len(shares),
        frame_of_loss=float(np.median(losses)) if losses else None,
        success_auc=result.scores.success_auc,
        milliseconds=result.scores.cpu_ms_median,
    )


def cells(line: Row) -> list[str]:
    """A row as texts."""
    return [
        line.sequence,
        line.tracker,
        f"{line.tracked:.0%}",
        f"{line.lost_runs} of {line.runs}",
        "-" if line.frame_of_loss is None else f"{line.frame_of_loss:.0f}",
        f"{line.success_auc:.3f}",
        f"{line.milliseconds:.2f}",
    ]


TITLES = ["sequence", "tracker", "overlap > 60 %", "lost", "frame of loss", "AUC", "CPU ms"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the experiment, print the table and write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n", maxsplit=1)[0])
    parser.add_argument("sequences", nargs="*", metavar="SEQUENCE_DIR", help="recorded sequences")
    options_of.add_seeds(parser, 3, "of the trackers")
    parser.add_argument(
        "--scenes", type=options_of.at_least(0), default=3, help="generated scenes [3]"
    )
    parser.add_argument("--output", type=Path, metavar="FILE.md", help="write the table")
    options = parser.parse_args(arguments)
    footage: list[Footage] = []
    for seed in range(options.scenes):
        for name, settings in (
            (f"generated {seed}", {"flip": 0}),
            (f"generated {seed}, polarity flips", {}),
        ):
            footage.append(SceneFootage(name, InfraredScene(seed, settings), FRAME_INTERVAL))
    footage += read_sequences(options.sequences) if options.sequences else []
    rows = []
    for one in footage:
        for name, (preset, parameters) in TRACKERS.items():
            make = functools.partial(Tracker.from_preset, preset, parameters=parameters)
            rows.append(row(name, evaluate_sequence(one, make, range(options.seeds))))
    table = Table("Infrared", TITLES, [[cells(one) for one in rows]], names=2)
    table.show()
    if options.output is not None:
        options.output.parent.mkdir(parents=True, exist_ok=True)
        options.output.write_text("\n".join([*table.markdown(), ""]), encoding="utf-8")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except ValueError as error:
        sys.exit(f"infrared.py: error: {error}")
