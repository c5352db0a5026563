"""The presets compared with trackers of other libraries on sequences with ground truth.

Success AUC, precision at 20 px and CPU time of a frame on one thread, as in `evaluate`, and the
time relative to OpenCV's CSRT. The trackers alternate by sequence, so that other load slows all of
them. Libraries that are not installed are omitted; `make bench` installs all of them.

    make bench SEQUENCES="SEQUENCE_DIR ..." BENCH_ARGS="--seeds 3"
    python benchmarks/peers.py SEQUENCE_DIR... --seeds 3

AUC, precision and median CPU time of a frame are means over the sequences. It writes peers.png.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence

import arguments as options_of
import numpy as np
from peer_trackers import PEERS, ChannelSpatialReliability
from tables import Table, bold

from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation import (
    EvaluationError,
    SequenceResult,
    TrackerFactory,
    evaluate_sequence,
    mean_scores,
    read_sequences,
)
from pf_tracker_ros.evaluation.plots import save_success_plot
from pf_tracker_ros.evaluation.sequences import frame_count
from pf_tracker_ros.footage import Footage
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.progress import progress_bar
from pf_tracker_ros.tracking.presets import PRESETS

YARDSTICK = ChannelSpatialReliability.name
"""The tracker whose time is the reference."""


def contenders() -> tuple[dict[str, TrackerFactory], dict[str, str]]:
    """All installed trackers by name, and of each that is left out the name and what to do."""
    found: dict[str, TrackerFactory] = {
        name: functools.partial(Tracker.from_preset, name) for name in PRESETS
    }
    missing = {peer.name: what for peer in PEERS if (what := peer.missing())}
    return found | {peer.name: peer for peer in PEERS if peer.name not in missing}, missing


def compare(
    sequences: Sequence[Footage], trackers: Mapping[str, TrackerFactory], seeds: int
) -> dict[str, list[SequenceResult]]:
    """Run all trackers on all sequences; name to results, the highest success AUC first."""
    results: dict[str, list[SequenceResult]] = {name: [] for name in trackers}
    with progress_bar(frame_count(sequences) * len(trackers)) as on_progress:
        for footage in sequences:
            for name, make in trackers.items():
                try:
                    result = evaluate_sequence(footage, make, range(seeds), on_progress)
                except EvaluationError as error:
                    raise EvaluationError(f"{name}: {error}") from error
                results[name].append(result)
    return dict(sorted(results.items(), key=lambda item: -mean_scores(item[1]).success_auc))


def summary(results: Mapping[str, Sequence[SequenceResult]], title: str) -> Table:
    """The figures of each tracker, our presets in bold; a dash for the time without CSRT."""
    scores = {name: mean_scores(of_one) for name, of_one in results.items()}
    reference = scores[YARDSTICK].cpu_ms_median if YARDSTICK in scores else math.nan
    rows = []
    for name, one in scores.items():
        ratio = one.cpu_ms_median / reference
        cells = [name, f"{one.success_auc:.3f}", f"{one.precision_20px:.3f}"]
        cells.append("-" if math.isnan(ratio) else f"{ratio:.2f}")
        rows.append([bold(cell, name in PRESETS) for cell in cells])
    return Table(title, ("tracker", "AUC", "precision 20 px", f"CPU / {YARDSTICK}"), rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the comparison, print the table and write the plot."""
    parser = options_of.sequence_parser(__doc__)
    options_of.add_folder(parser)
    options = parser.parse_args(arguments)
    with options_of.told_errors(parser):
        trackers, missing = contenders()
        sequences = read_sequences(options.sequences)
        for name, what in missing.items():
            print(f"{name} is left out: {what}.")
        results = compare(sequences, trackers, options.seeds)
        summary(results, f"Presets and peers, {counted(options.seeds, 'seed')}").show()
        curves = {
            name: np.mean([result.success_curve for result in of_one], axis=0)
            for name, of_one in results.items()
        }
        options.output.mkdir(parents=True, exist_ok=True)
        peers = curves.keys() - PRESETS.keys()
        save_success_plot(options.output / "peers.png", curves, dashed=peers)


if __name__ == "__main__":
    main()
