"""The comparison of Zhang Bo: `zhang_bo` and the seven families of trackers on the same footage.

1. Recorded sequences: root mean square of the center error, success AUC and CPU time per frame on
   one thread.
2. Pedestrians in generated streets with increasing clutter: error over the level of clutter.

    python benchmarks/families.py SEQUENCE_DIR... --output benchmarks/results --seeds 3

It writes families.md.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import arguments as options_of
import numpy as np
from scene_footage import SceneFootage
from scenes import ClutteredStreet
from scenes.clutter import FRAME_INTERVAL
from tables import Table, bold, save_tables
from tracker_families import FAMILIES

from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation import (
    SequenceResult,
    TrackerFactory,
    evaluate_sequence,
    read_sequences,
)
from pf_tracker_ros.evaluation.sequences import frame_count
from pf_tracker_ros.footage import Footage
from pf_tracker_ros.progress import OnProgress, progress_bar

TRACKERS: Mapping[str, TrackerFactory] = {
    **FAMILIES,
    "zhang_bo": functools.partial(Tracker.from_preset, "zhang_bo"),
}
"""The compared trackers: name to factory from a seed."""
HEADINGS = ("sequence", "tracker", "center RMSE px", "success AUC", "CPU ms")


@dataclass(frozen=True)
class Outcome:
    """One tracker on one sequence."""

    sequence: str  # name of the sequence
    tracker: str  # name of the tracker
    # root mean square of the center error over the frames, px, mean of the seeds
    center_rmse: float
    success_auc: float  # as `pf_tracker_ros.evaluation` has it
    milliseconds: float  # median CPU time of a frame


def outcome(tracker: str, result: SequenceResult) -> Outcome:
    """The figures of a tracker on a sequence, averaged over the seeds."""
    rmse = float(np.sqrt(np.nanmean(result.center_errors**2, axis=1)).mean())
    scores = result.scores
    return Outcome(result.name, tracker, rmse, scores.success_auc, scores.cpu_ms_median)


def compare(footage: Footage, seeds: Sequence[int], on_progress: OnProgress) -> list[Outcome]:
    """Run all trackers on a sequence, one after the other."""
    return [
        outcome(name, evaluate_sequence(footage, make_tracker, seeds, on_progress))
        for name, make_tracker in TRACKERS.items()
    ]


def sequence_table(folders: Sequence[Path], seeds: int) -> Table:
    """The first experiment: figures on each recorded sequence and means, the best in bold."""
    sequences = read_sequences(folders)
    with progress_bar(frame_count(sequences) * len(TRACKERS)) as on_progress:
        outcomes = [compare(each, range(seeds), on_progress) for each in sequences]
    figures = np.array(
        [[(o.center_rmse, o.success_auc, o.milliseconds) for o in each] for each in outcomes]
    )
    names = [each[0].sequence for each in outcomes]
    groups = []
    for name, group in zip([*names, "mean"], [*figures, figures.mean(axis=0)], strict=True):
        best = (group[:, 0].min(), group[:, 1].max(), group[:, 2].min())
        rows = []
        for tracker, row in zip(TRACKERS, group, strict=True):
            cells = [f"{row[0]:.1f}", f"{row[1]:.3f}", f"{row[2]:.2f}"]
            are_best = row == best
            marked = [bold(cell, is_best) for cell, is_best in zip(cells, are_best, strict=True)]
            rows.append([name, tracker, *marked])
        groups.append(rows)
    return Table(f"zhang_bo and the seven families, seeds: {seeds}", HEADINGS, groups, names=2)


def clutter_table(scenes: int, levels: int, frames: int) -> Table:
    """The second experiment: generated streets, each at evenly spaced levels of clutter, 0 to 1.

    A scene's seed is the trackers' seed too. Errors are means over the scenes.
    """
    shares = np.linspace(0.0, 1.0, levels).tolist()
    errors = np.empty((scenes, levels, len(TRACKERS)))
    with progress_bar(scenes * levels * frames * len(TRACKERS)) as on_progress:
        for scene in range(scenes):
            for number, level in enumerate(shares):
                street = ClutteredStreet(scene, {"clutter": level, "frames": frames})
                name = f"street {scene}, clutter {level:.2f}"
                footage = SceneFootage(name, street, FRAME_INTERVAL)
                found = compare(footage, (scene,), on_progress)
                errors[scene, number] = [one.center_rmse for one in found]
    rows = [
        [tracker, *(f"{one:.1f}" for one in means)]
        for tracker, means in zip(TRACKERS, errors.mean(axis=0).T, strict=True)
    ]
    headings = ("tracker", *(f"{level:g}" for level in shares))
    return Table(f"Center RMSE over the clutter, px, streets: {scenes}", headings, [rows])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the experiments, print the tables and write the file."""
    parser = options_of.parser(__doc__)
    parser.add_argument("sequences", nargs="*", type=Path, metavar="SEQUENCE_DIR")
    options_of.add_folder(parser)
    options_of.add_seeds(parser, 1, "on the sequences")
    at_least = options_of.at_least
    parser.add_argument("--scenes", type=at_least(0), default=5, help="generated streets [5]")
    parser.add_argument("--levels", type=at_least(2), default=5, help="levels of clutter [5]")
    parser.add_argument("--frames", type=int, default=120, help="of a generated street [120]")
    options = parser.parse_args(arguments)
    if not options.sequences and not options.scenes:
        parser.error("nothing to do; give a SEQUENCE_DIR, or --scenes of at least 1")
    with options_of.told_errors(parser):
        ClutteredStreet(0, {"frames": options.frames})
        tables = [sequence_table(options.sequences, options.seeds)] if options.sequences else []
        if options.scenes:
            tables.append(clutter_table(options.scenes, options.levels, options.frames))
        for table in tables:
            table.show()
        save_tables(options.output / "families.md", tables)
    print(f"files in {options.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
