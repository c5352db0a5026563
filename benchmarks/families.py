"""The comparison of Zhang Bo: `zhang_bo` and the seven families of trackers on the same footage.

1. Recorded sequences: root mean square of the center error, success AUC and CPU time per frame on
   one thread.
2. Pedestrians in generated streets with increasing clutter: error over the level of clutter.

    python benchmarks/families.py SEQUENCE_DIR... --output benchmarks/results --seeds 3

It writes families.md and clutter.md.
"""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

# One thread for linear algebra; read when NumPy is imported.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import arguments as options_of
import families_report as report
import numpy as np
from scene_footage import SceneFootage
from scenes import ClutteredStreet
from scenes.clutter import FRAME_INTERVAL
from tracker_families import FAMILIES

from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation import (
    EvaluationError,
    SequenceResult,
    TrackerFactory,
    evaluate_sequence,
    read_sequences,
)
from pf_tracker_ros.evaluation.sequences import frame_count
from pf_tracker_ros.footage import Footage, FootageError
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.progress import OnProgress, progress_bar

PRESET = "zhang_bo"


TRACKERS: Mapping[str, TrackerFactory] = {
    **FAMILIES,
    PRESET: functools.partial(Tracker.from_preset, PRESET),
}
"""The compared trackers: name to factory from a seed."""


def outcome(tracker: str, result: SequenceResult) -> report.Outcome:
    """The figures of a tracker on a sequence, averaged over the seeds."""
    squares = np.nanmean(result.center_errors**2, axis=1)
    return report.Outcome(
        sequence=result.name,
        tracker=tracker,
        center_rmse=float(np.sqrt(squares).mean()),
        success_auc=result.scores.success_auc,
        milliseconds=result.scores.cpu_ms_median,
    )


def compare(
    footage: Footage, seeds: Sequence[int], on_progress: OnProgress
) -> list[report.Outcome]:
    """Run all trackers on a sequence, one after the other."""
    return [
        outcome(name, evaluate_sequence(footage, make_tracker, seeds, on_progress))
        for name, make_tracker in TRACKERS.items()
    ]


def run_sequences(folders: Sequence[Path], seeds: int) -> list[report.Outcome]:
    """The first experiment: recorded sequences."""
    sequences = read_sequences(folders)
    with progress_bar(frame_count(sequences) * len(TRACKERS)) as on_progress:
        return [one for each in sequences for one in compare(each, range(seeds), on_progress)]


def run_clutter(scenes: int, levels: int, frames: int) -> list[report.ClutterOutcome]:
    """The second experiment: generated streets, each at evenly spaced levels of clutter, 0 to 1.

    A scene's seed is the trackers' seed too.
    """
    outcomes = []
    with progress_bar(scenes * levels * frames * len(TRACKERS)) as on_progress:
        for scene in range(scenes):
            for level in np.linspace(0.0, 1.0, levels).tolist():
                street = ClutteredStreet(scene, {"clutter": level, "frames": frames})
                name = f"street {scene}, clutter {level:.2f}"
                footage = SceneFootage(name, street, FRAME_INTERVAL)
                outcomes += [
                    report.ClutterOutcome(scene, level, one)
                    for one in compare(footage, (scene,), on_progress)
                ]
    return outcomes


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the experiments, print the tables and write the files."""
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
    try:
        ClutteredStreet(0, {"frames": options.frames})
        read_sequences(options.sequences)
        options.output.mkdir(parents=True, exist_ok=True)
        if options.sequences:
            outcomes = run_sequences(options.sequences, options.seeds)
            report.print_table(outcomes)
            report.write_table(options.output / "families.md", outcomes, options.seeds)
        if options.scenes:
            cluttered = run_clutter(options.scenes, options.levels, options.frames)
            report.print_clutter(cluttered)
            report.write_clutter_table(options.output / "clutter.md", cluttered)
    except (EvaluationError, FootageError, ParameterError, OSError) as error:
        parser.error(" ".join(str(error).split()))
    print(f"files in {options.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
