r"""Calibration of a preset: confidence, states and covariance compared with ground truth.

A frame is right if its overlap is above one half.

    python benchmarks/uncertainty.py SEQUENCE_DIR... --preset default --seeds 3

With `--group`, such as for kinds of footage, it also reports all figures of each group.

It writes uncertainty.md, uncertainty.csv (a line for each range of confidence) and uncertainty.png.
"""

from __future__ import annotations

import csv
import math
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import arguments as options_of
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from tables import Table

from pf_tracker_ros import Estimate, Tracker
from pf_tracker_ros.evaluation import (
    EvaluationError,
    evaluate_sequence,
    has_target,
    overlap,
    read_sequences,
)
from pf_tracker_ros.evaluation.sequences import frame_count
from pf_tracker_ros.footage import Footage
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.progress import progress_bar

RIGHT_ABOVE = 0.5
# The target is truly lost if the overlap has been below this for so many seconds.
GONE_BELOW, GONE_FOR = 0.1, 3.0
SHARES = (0.5, 0.9, 0.99)
RANGES = 10
NOTE = (
    f"A frame is right where the box overlaps the true one by more than {RIGHT_ABOVE}. Area under "
    "the ROC curve: probability that a right frame has more confidence than a wrong one. Ellipses: "
    "share of the frames called tracking, with the box on the target (overlap of at least "
    f"{GONE_BELOW}), whose ellipse of that probability contains the true center; NEES: squared "
    "error of the center normalized by the covariance, over its two degrees of freedom, 1 where "
    "the covariance is consistent."
)


@dataclass(frozen=True)
class Frames:
    """A tracker's output for F frames, and the truth."""

    overlap: NDArray[np.float64]  # (F,) of box and true box
    confidence: NDArray[np.float64]  # (F,) 0 to 1
    is_tracking: NDArray[np.bool_]  # (F,) whether the state was tracking
    distance: NDArray[np.float64]  # (F,) squared Mahalanobis distance of the true center
    astray: NDArray[np.float64]  # (F,) seconds for which the box has been beside the target
    number: NDArray[np.intp]  # (F,) of the frame among those of its run, from 0 on

    @property
    def is_right(self) -> NDArray[np.bool_]:
        """(F,) whether the box is right."""
        return self.overlap > RIGHT_ABOVE

    def by_confidence(self) -> list[NDArray[np.bool_]]:
        """Whether the boxes are right, of the frames in each of `RANGES` ranges of confidence."""
        number = np.minimum((self.confidence * RANGES).astype(np.intp), RANGES - 1)
        return [self.is_right[number == one] for one in range(RANGES)]


class _Recorder:
    """Records the estimates of a tracker.

    Args:
        tracker: Any tracker.
    """

    def __init__(self, tracker: Tracker) -> None:
        self._tracker = tracker
        self.estimates: list[Estimate] = []

    def start(self, image: NDArray[np.generic], box: tuple[float, float, float, float]) -> None:
        self._tracker.start(image, box)

    def update(self, image: NDArray[np.generic], dt: float | None) -> Estimate:
        self.estimates.append(self._tracker.update(image, dt))
        return self.estimates[-1]


def compared(
    estimates: Sequence[Estimate], true_boxes: NDArray[np.float64], interval: float
) -> Frames:
    """Output for the frames with a true box.

    Args:
        estimates: An estimate for each frame.
        true_boxes: (frames, 4), pixels.
        interval: Seconds between frames.
    """
    known = has_target(true_boxes)
    estimates = [one for one, is_known in zip(estimates, known, strict=True) if is_known]
    true_boxes = true_boxes[known]
    boxes = np.array([one.box for one in estimates])
    offsets = true_boxes[:, :2] + true_boxes[:, 2:] / 2 - boxes[:, :2] - boxes[:, 2:] / 2
    # Keeps the covariance of collapsed particles invertible.
    covariances = np.array([one.covariance for one in estimates]) + 1e-12 * np.eye(2)
    overlaps = overlap(boxes, true_boxes)
    return Frames(
        overlaps,
        np.array([one.confidence for one in estimates]),
        np.array([one.state == "tracking" for one in estimates]),
        np.einsum("fi,fi->f", offsets, np.linalg.solve(covariances, offsets[..., None])[..., 0]),
        interval * _in_a_row(overlaps < GONE_BELOW),
        np.flatnonzero(known),
    )


def _in_a_row(holds: NDArray[np.bool_]) -> NDArray[np.intp]:
    """(F,) number of consecutive frames so far in which a condition, (F,), holds."""
    number = np.arange(1, len(holds) + 1)
    return number - np.maximum.accumulate(np.where(holds, 0, number))


def together(parts: Sequence[Frames]) -> Frames:
    """Concatenate the frames of several runs."""
    return Frames(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in (field.name for field in fields(Frames))
        )
    )


def roc_area(confidence: NDArray[np.float64], is_right: NDArray[np.bool_]) -> float:
    """Probability that a right frame has more confidence than a wrong one, equal ones by half.

    Args:
        confidence: (F,).
        is_right: (F,); NaN is returned if all are right, or none is.
    """
    right, wrong = np.sort(confidence[is_right]), confidence[~is_right]
    if not len(right) or not len(wrong):
        return math.nan
    above = len(right) - np.searchsorted(right, wrong, side="right")
    not_below = len(right) - np.searchsorted(right, wrong, side="left")
    return float((above + not_below).mean() / 2 / len(right))


def on_target(frames: Frames) -> NDArray[np.float64]:
    """Squared Mahalanobis distances of the tracked frames whose box is on the target."""
    return frames.distance[frames.is_tracking & (frames.overlap >= GONE_BELOW)]


def inside(frames: Frames, share: float) -> float:
    """How often the covariance's ellipse contains the true center, while the box is on the target.

    For a Gaussian of two dimensions the squared distance is below -2 ln(1 - share) with that
    probability.
    """
    return _mean(on_target(frames) <= -2.0 * math.log1p(-share))


def measured(sequences: Sequence[Footage], preset: str, seeds: int) -> list[Frames]:
    """Output of a preset for all frames but the first, for each sequence, all seeds."""
    parts = []
    with progress_bar(frame_count(sequences)) as on_progress:
        for footage in sequences:
            recorders = [_Recorder(Tracker.from_preset(preset, seed)) for seed in range(seeds)]
            result = evaluate_sequence(footage, recorders.__getitem__, range(seeds), on_progress)
            true_boxes, interval = result.true_boxes[1:], footage.nominal_interval
            runs = [compared(one.estimates, true_boxes, interval) for one in recorders]
            parts.append(together(runs))
    return parts


def grouped(names: Sequence[str], patterns: Sequence[str]) -> dict[str, list[int]]:
    """Pattern to the indices of the names that it matches from their start.

    Raises:
        EvaluationError: A pattern is no regular expression, or matches no name.
    """
    groups = {}
    for pattern in patterns:
        try:
            groups[pattern] = [
                number for number, name in enumerate(names) if re.match(pattern, name)
            ]
        except re.error as error:
            raise EvaluationError(f"--group '{pattern}': {error}") from error
        if not groups[pattern]:
            raise EvaluationError(f"--group '{pattern}' matches no sequence")
    return groups


def summary(frames: Frames, title: str) -> Table:
    """The figures as a table."""
    return Table(title, ("figure", "value"), [[*map(list, figures(frames))]])


def group_table(groups: Mapping[str, Frames]) -> Table:
    """The figures of each group of sequences, such as a kind of footage."""
    columns = [figures(frames) for frames in groups.values()]
    rows = [[cells[0][0], *(value for _, value in cells)] for cells in zip(*columns, strict=True)]
    return Table("By group", ("figure", *groups), [rows])


def figures(frames: Frames) -> list[tuple[str, str]]:
    """Name and value of each figure, the area under the ROC curve first."""
    right, tracking = frames.is_right, frames.is_tracking
    gone = frames.astray > GONE_FOR
    return [
        (
            "area under the ROC curve of the confidence",
            _text(roc_area(frames.confidence, right)),
        ),
        ("expected calibration error", _text(calibration_error(frames))),
        *(
            (f"true center inside the {share:.0%} ellipse", _text(inside(frames, share)))
            for share in SHARES
        ),
        ("NEES of the center", _text(_mean(on_target(frames)) / 2)),
        ("right frames that are called tracking", _text(_mean(tracking[right]))),
        ("wrong frames that are called tracking", _text(_mean(tracking[~right]))),
        (
            f"frames with an overlap below {GONE_BELOW} that are called tracking",
            _text(_mean(tracking[frames.overlap < GONE_BELOW])),
        ),
        (
            f"frames more than {GONE_FOR:g} s after the target was lost that are called occluded "
            "or lost",
            _text(_mean(~tracking[gone])),
        ),
    ]


def calibration_error(frames: Frames) -> float:
    """Expected difference of confidence and share of right frames, over `RANGES` ranges."""
    number = np.minimum((frames.confidence * RANGES).astype(np.intp), RANGES - 1)
    excess = np.bincount(number, frames.confidence - frames.is_right, RANGES)
    return float(np.abs(excess).sum() / len(number))


def reliability(frames: Frames) -> Table:
    """Share of right frames in each range of confidence."""
    rows = [
        [f"{one / RANGES:.1f} to {(one + 1) / RANGES:.1f}", str(len(right)), _text(_mean(right))]
        for one, right in enumerate(frames.by_confidence())
    ]
    return Table("Right frames by confidence", ("confidence", "frames", "right"), [rows])


def plot(path: Path, frames: Frames, title: str) -> None:
    """Draw the share of right frames over the confidence, and the numbers of frames."""
    ranges = frames.by_confidence()
    middle = (np.arange(RANGES) + 0.5) / RANGES
    figure = Figure(figsize=(5.0, 5.5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    above.plot([0, 1], [0, 1], color="0.7", linestyle="--", label="calibrated")
    above.plot(middle, [_mean(right) for right in ranges], marker="o", label="measured")
    above.set(ylabel=f"share with overlap above {RIGHT_ABOVE}", ylim=(0, 1.02), title=title)
    above.legend()
    below.bar(middle, [len(right) for right in ranges], 0.9 / RANGES, color="0.6")
    below.set(xlabel="confidence", ylabel="frames", xlim=(0, 1))
    for axes in (above, below):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=120)


def _mean(values: NDArray[Any]) -> float:
    return float(values.mean()) if len(values) else math.nan


def _text(figure: float) -> str:
    return "-" if math.isnan(figure) else f"{figure:.3f}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables and write the files."""
    parser = options_of.sequence_parser(__doc__)
    options_of.add_preset(parser)
    parser.add_argument(
        "--group",
        action="append",
        default=[],
        metavar="PATTERN",
        help="a regular expression for the beginning of names of sequences; may be repeated",
    )
    options = parser.parse_args(arguments)
    with options_of.told_errors(parser):
        Tracker.from_preset(options.preset)
        sequences = read_sequences(options.sequences)
        options.output.mkdir(parents=True, exist_ok=True)
        members = grouped([footage.name for footage in sequences], options.group)
        parts = measured(sequences, options.preset, options.seeds)
        frames = together(parts)
        groups = {
            name: together([parts[number] for number in numbers])
            for name, numbers in members.items()
        }
        runs = f"{counted(len(sequences), 'sequence')}, {counted(options.seeds, 'seed')}"
        title = f"Uncertainty of preset {options.preset}: {runs}"
        tables = [summary(frames, title), reliability(frames)]
        if groups:
            tables.append(group_table(groups))
        for table in tables:
            table.show()
        lines = [f"# {tables[0].title}", "", *tables[0].markdown(), "", NOTE, ""]
        for table in tables[1:]:
            lines += [f"## {table.title}", "", *table.markdown(), ""]
        (options.output / "uncertainty.md").write_text("\n".join(lines), encoding="utf-8")
        with (options.output / "uncertainty.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([tables[1].headings, *tables[1].groups[0]])
        plot(options.output / "uncertainty.png", frames, f"{options.preset}: {runs}")
    print(f"files in {options.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
