"""The presets compared with trackers of other libraries on sequences with ground truth.

Success AUC, precision at 20 px and CPU time of a frame on one thread, as in `evaluate`, and the
time relative to OpenCV's CSRT. The trackers alternate by sequence, so that other load slows all of
them. Libraries that are not installed are omitted; `make bench` installs all of them.

    make bench SEQUENCES="SEQUENCE_DIR ..." BENCH_ARGS="--seeds 3 --nanotrack BACKBONE HEAD"
    python benchmarks/peers.py SEQUENCE_DIR... --output benchmarks/results --seeds 3

It writes peers.md and peers.png.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import arguments as options_of
import numpy as np
from peer_trackers import PEERS, ChannelSpatialReliability, NanoTrack
from tables import Table, bold, publish

from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation import (
    EvaluationError,
    Scores,
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

HEADINGS = ("tracker", "AUC", "± seeds", "precision 20 px", "CPU ms", f"CPU / {YARDSTICK}")
NOTE = (
    "AUC, precision and median CPU time of a frame are means over the sequences; ± is the standard "
    "deviation of a sequence's AUC over the seeds, mean over the sequences."
)


@dataclass(frozen=True)
class Contender:
    """A tracker to compare."""

    name: str  # name in the tables
    make_tracker: TrackerFactory  # factory from a seed
    is_random: bool  # whether the result depends on the seed; if not, one run suffices


@dataclass(frozen=True)
class Outcome:
    """Results of a contender on all sequences."""

    name: str  # name of the tracker or setting
    results: Sequence[SequenceResult]  # a result for each sequence, at least one

    @property
    def scores(self) -> Scores:
        """Means over the sequences."""
        return mean_scores(self.results)

    @property
    def deviation(self) -> float:
        """Standard deviation of the success AUC over the seeds, mean over the sequences.

        NaN for a single seed.
        """
        return float(np.mean([result.success_auc_std for result in self.results]))


def contenders(
    nanotrack: tuple[Path, Path] | None,
) -> tuple[list[Contender], dict[str, str]]:
    """All installed trackers, and of each that is left out the name and what to do.

    Args:
        nanotrack: Model files of NanoTrack, backbone and head, if any.
    """
    found = [
        Contender(name, functools.partial(Tracker.from_preset, name), is_random=True)
        for name in PRESETS
    ]
    missing = {peer.name: what for peer in (*PEERS, NanoTrack) if (what := peer.missing())}
    found += [
        Contender(peer.name, peer, peer.is_random) for peer in PEERS if peer.name not in missing
    ]
    if nanotrack is None:
        missing.setdefault(NanoTrack.name, "name its model files with --nanotrack BACKBONE HEAD")
    elif NanoTrack.name not in missing:
        backbone, head = nanotrack
        make_tracker = functools.partial(NanoTrack, backbone=backbone, head=head)
        found.append(Contender(NanoTrack.name, make_tracker, is_random=False))
    return found, missing


def chosen(
    found: Sequence[Contender], missing: dict[str, str], names: Sequence[str]
) -> list[Contender]:
    """Contenders selected by name; all without names.

    Raises:
        EvaluationError: A name is unknown, or its tracker cannot run here.
    """
    known = {contender.name: contender for contender in found}
    for name in names:
        if name in missing:
            raise EvaluationError(f"{name} cannot run: {missing[name]}")
        if name not in known:
            raise EvaluationError(f"no tracker '{name}'; there are: {', '.join(known)}")
    return [contender for contender in found if not names or contender.name in names]


def compare(
    sequences: Sequence[Footage], trackers: Sequence[Contender], seeds: int
) -> list[Outcome]:
    """Run all trackers on all sequences.

    Returns:
        One outcome a tracker, the highest success AUC first.
    """
    results = {contender.name: [] for contender in trackers}
    with progress_bar(frame_count(sequences) * len(trackers)) as on_progress:
        for footage in sequences:
            for one in trackers:
                runs = range(seeds if one.is_random else 1)
                try:
                    result = evaluate_sequence(footage, one.make_tracker, runs, on_progress)
                except EvaluationError as error:
                    raise EvaluationError(f"{one.name}: {error}") from error
                results[one.name].append(result)
    outcomes = [Outcome(name, of_one) for name, of_one in results.items()]
    return sorted(outcomes, key=lambda outcome: outcome.scores.success_auc, reverse=True)


def ratios(outcomes: Sequence[Outcome]) -> list[float]:
    """CPU time of each tracker relative to CSRT; NaN if CSRT did not run."""
    times = {outcome.name: outcome.scores.cpu_ms_median for outcome in outcomes}
    return [time / times.get(YARDSTICK, np.nan) for time in times.values()]


def summary(outcomes: Sequence[Outcome], title: str) -> Table:
    """The figures of each tracker, our presets in bold."""
    rows = []
    for outcome, ratio in zip(outcomes, ratios(outcomes), strict=True):
        scores = outcome.scores
        cells = [
            outcome.name,
            f"{scores.success_auc:.3f}",
            figure(outcome.deviation, ".3f"),
            f"{scores.precision_20px:.3f}",
            f"{scores.cpu_ms_median:.2f}",
            figure(ratio, ".2f"),
        ]
        rows.append([bold(cell, outcome.name in PRESETS) for cell in cells])
    return Table(title, HEADINGS, [rows])


def by_sequence(outcomes: Sequence[Outcome]) -> Table:
    """The success AUC of each tracker on each sequence, the best in bold."""
    aucs = np.array(
        [[result.scores.success_auc for result in outcome.results] for outcome in outcomes]
    ).T
    names = [result.name for result in outcomes[0].results]
    rows = [
        [name, *(bold(f"{auc:.3f}", auc == row.max()) for auc in row)]
        for name, row in zip(names, aucs, strict=True)
    ]
    headings = ("sequence", *(outcome.name for outcome in outcomes))
    return Table("Success AUC on each sequence", headings, [rows])


def figure(value: float, form: str) -> str:
    """A number as text; NaN as a dash."""
    return "-" if np.isnan(value) else format(value, form)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison, print the table and write the files."""
    parser = options_of.sequence_parser(__doc__)
    parser.add_argument(
        "--nanotrack",
        nargs=2,
        type=Path,
        metavar=("BACKBONE", "HEAD"),
        help="NanoTrack's two model files, in ONNX format",
    )
    parser.add_argument(
        "--tracker",
        action="append",
        default=[],
        metavar="NAME",
        help="run only this tracker; may be repeated",
    )
    options = parser.parse_args(arguments)
    with options_of.told_errors(parser):
        found, missing = contenders(options.nanotrack)
        trackers = chosen(found, missing, options.tracker)
        sequences = read_sequences(options.sequences)
        left_out = [f"{name} is left out: {what}." for name, what in missing.items()]
        left_out = [] if options.tracker else left_out
        for sentence in left_out:
            print(sentence)
        outcomes = compare(sequences, trackers, options.seeds)
        table = summary(outcomes, f"Presets and peers, {counted(options.seeds, 'seed')}")
        frames = sum(len(result.true_boxes) for result in outcomes[0].results)
        footage = f"{counted(len(sequences), 'sequence')}, {frames} frames."
        note = " ".join([NOTE, footage, *left_out])
        publish(options.output / "peers.md", [table, by_sequence(outcomes)], note)
        curves = {
            outcome.name: np.mean([result.success_curve for result in outcome.results], axis=0)
            for outcome in outcomes
        }
        peers = curves.keys() - PRESETS.keys()
        save_success_plot(options.output / "peers.png", curves, dashed=peers)
    return 0


if __name__ == "__main__":
    sys.exit(main())
