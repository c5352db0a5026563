r"""Calibration of `default`: confidence and states compared with ground truth.

A frame is right if its overlap is above one half; frames without a target take no part.

    python benchmarks/uncertainty.py SEQUENCE_DIR... --seeds 3

With `--group`, such as for kinds of footage, it also reports all figures of each group. It writes
uncertainty.png.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import arguments as options_of
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from tables import Table
from tracking_runs import estimates_of, followed, timed_images

from pf_tracker_ros import Estimate
from pf_tracker_ros.evaluation import EvaluationError, has_target, overlap, read_sequences
from pf_tracker_ros.evaluation.sequences import usable_ground_truth
from pf_tracker_ros.footage import Footage
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.tuning.confidence import (
    LabeledConfidences,
    calibration_error,
    reliability,
    roc_area,
)

RIGHT_ABOVE = 0.5
# Overlap below which the box is not on the target at all.
GONE_BELOW = 0.1


@dataclass(frozen=True)
class Frames:
    """A tracker's output for F frames, and the truth."""

    overlap: NDArray[np.float64]  # (F,) of box and true box
    confidence: NDArray[np.float64]  # (F,) 0 to 1
    is_tracking: NDArray[np.bool_]  # (F,) whether the state was tracking

    @property
    def is_right(self) -> NDArray[np.bool_]:
        """(F,) whether the box is right."""
        return self.overlap > RIGHT_ABOVE

    @property
    def labeled(self) -> list[LabeledConfidences]:
        """All frames, with the same weight."""
        return [LabeledConfidences("", self.confidence[None], self.is_right[None])]


def compared(estimates: Sequence[Estimate], true_boxes: NDArray[np.float64]) -> Frames:
    """Output for the frames with a true box, of an estimate for each frame."""
    known = has_target(true_boxes)
    estimates = [one for one, is_known in zip(estimates, known, strict=True) if is_known]
    return Frames(
        overlap(np.array([one.box for one in estimates]), true_boxes[known]),
        np.array([one.confidence for one in estimates]),
        np.array([one.state == "tracking" for one in estimates]),
    )


def together(parts: Sequence[Frames]) -> Frames:
    """Concatenate the frames of several runs."""
    names = [field.name for field in fields(Frames)]
    return Frames(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def measured(sequences: Sequence[Footage], seeds: int) -> list[Frames]:
    """Output of `default` for all frames but the first, for each sequence, all seeds."""
    parts = []
    for footage in followed(sequences):
        truth = usable_ground_truth(footage)
        runs = [
            estimates_of("default", seed, timed_images(footage), truth[0]) for seed in range(seeds)
        ]
        parts.append(together([compared(one, truth[1:]) for one in runs]))
    return parts


def grouped(names: Sequence[str], wanted: Sequence[str]) -> dict[str, list[int]]:
    """Name of a group, NAME=PATTERN or PATTERN, to the indices that it matches from their start.

    Raises:
        EvaluationError: A pattern is no regular expression, or matches no name.
    """
    groups = {}
    for one in wanted:
        title, _, pattern = one.rpartition("=")
        try:
            members = [number for number, name in enumerate(names) if re.match(pattern, name)]
        except re.error as error:
            raise EvaluationError(f"--group '{pattern}': {error}") from error
        if not members:
            raise EvaluationError(f"--group '{pattern}' matches no sequence")
        groups[title or pattern] = members
    return groups


def summary(groups: Mapping[str, Frames], title: str) -> Table:
    """The figures of each group of sequences, such as a kind of footage."""
    columns = [figures(frames) for frames in groups.values()]
    rows = []
    for name in columns[0]:
        values = [one[name] for one in columns]
        rows.append([name, *("-" if math.isnan(one) else f"{one:.3f}" for one in values)])
    return Table(title, ("figure", *groups), rows)


def figures(frames: Frames) -> dict[str, float]:
    """Figures by name."""
    right, tracking, labeled = frames.is_right, frames.is_tracking, frames.labeled
    return {
        "area under the ROC curve of the confidence": roc_area(labeled),
        "expected calibration error": calibration_error(labeled),
        "right frames that are called tracking": _mean(tracking[right]),
        "wrong frames that are called tracking": _mean(tracking[~right]),
        f"frames with an overlap below {GONE_BELOW} that are called tracking": _mean(
            tracking[frames.overlap < GONE_BELOW]
        ),
    }


def plot(path: Path, frames: Frames, title: str) -> None:
    """Draw the share of right frames over the confidence, and the numbers of frames."""
    rows = reliability(frames.labeled)
    middle = [(row.low + row.high) / 2 for row in rows]
    figure = Figure(figsize=(5.0, 5.5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    above.plot([0, 1], [0, 1], color="0.7", linestyle="--", label="calibrated")
    above.plot(middle, [row.right for row in rows], marker="o", label="measured")
    above.set(ylabel=f"share with overlap above {RIGHT_ABOVE}", ylim=(0, 1.02), title=title)
    above.legend()
    below.bar(middle, [len(frames.overlap) * row.share for row in rows], 0.09, color="0.6")
    below.set(xlabel="confidence", ylabel="frames", xlim=(0, 1))
    for axes in (above, below):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=120)


def _mean(values: NDArray[Any]) -> float:
    return float(values.mean()) if len(values) else math.nan


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print the tables and write the plot."""
    parser = options_of.sequence_parser(__doc__)
    options_of.add_folder(parser)
    parser.add_argument(
        "--group",
        action="append",
        default=[],
        metavar="[NAME=]PATTERN",
        help="a regular expression for the beginning of names of sequences; may be repeated",
    )
    options = parser.parse_args(arguments)
    with options_of.told_errors(parser):
        sequences = read_sequences(options.sequences)
        members = grouped([footage.name for footage in sequences], options.group)
        parts = measured(sequences, options.seeds)
        frames = together(parts)
        groups = {"all": frames} | {
            name: together([parts[number] for number in numbers])
            for name, numbers in members.items()
        }
        runs = f"{counted(len(sequences), 'sequence')}, {counted(options.seeds, 'seed')}"
        title = f"Uncertainty: {runs}"
        summary(groups, title).show()
        options.output.mkdir(parents=True, exist_ok=True)
        plot(options.output / "uncertainty.png", frames, f"default: {runs}")


if __name__ == "__main__":
    main()
