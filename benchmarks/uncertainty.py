r"""Calibration of a preset: confidence, states and covariance compared with ground truth.

A frame is right if its overlap is above one half.

    python benchmarks/uncertainty.py SEQUENCE_DIR... --preset default --seeds 3

With two or more `--group`s, such as kinds of footage, it also reports all figures of each group,
and the area under the ROC curve of a confidence fitted to the other groups.

It writes uncertainty.md, uncertainty.csv (a line for each range of confidence) and uncertainty.png.
"""

from __future__ import annotations

import csv
import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

# One thread for linear algebra; read when NumPy is imported.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import arguments as options_of
import confidence_cross_validation
import cross_validation
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
from pf_tracker_ros.footage import Footage, FootageError
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.progress import progress_bar

AnyTracker = Tracker | confidence_cross_validation.RecordingTracker
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
    """A tracker's output for F frames, and the truth.

    Attributes:
        overlap: (F,) of box and true box.
        confidence: (F,) 0 to 1.
        is_tracking: (F,) whether the state was tracking.
        distance: (F,) squared Mahalanobis distance of the true center.
        astray: (F,) seconds for which the box has been beside the target.
        number: (F,) of the frame among those of its run, from 0 on.
    """

    overlap: NDArray[np.float64]
    confidence: NDArray[np.float64]
    is_tracking: NDArray[np.bool_]
    distance: NDArray[np.float64]
    astray: NDArray[np.float64]
    number: NDArray[np.intp]

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

    def __init__(self, tracker: AnyTracker) -> None:
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


def measured(
    sequences: Sequence[Footage], trackers: Callable[[int, int], AnyTracker], seeds: int
) -> list[list[Frames]]:
    """Output for all frames but the first, for each sequence and seed.

    Args:
        sequences: Sequences with true boxes.
        trackers: Makes a tracker for the index of a sequence and a seed.
        seeds: Number of runs.
    """
    parts = []
    with progress_bar(frame_count(sequences)) as on_progress:
        for number, footage in enumerate(sequences):
            recorders = [_Recorder(trackers(number, seed)) for seed in range(seeds)]
            result = evaluate_sequence(footage, recorders.__getitem__, range(seeds), on_progress)
            true_boxes, interval = result.true_boxes[1:], footage.nominal_interval
            parts.append([compared(one.estimates, true_boxes, interval) for one in recorders])
    return parts


@dataclass(frozen=True)
class CarriedOver:
    """A cross-validated confidence.

    Attributes:
        frames: Name of a group to its frames.
        weights: Name of a group to the weights fitted on the others, "none" to those of all.
    """

    frames: Mapping[str, Frames]
    weights: Mapping[str, confidence_cross_validation.Weights]


def carried_over(
    sequences: Sequence[Footage],
    preset: str,
    groups: Mapping[str, Sequence[int]],
    outputs: Sequence[Sequence[Frames]],
    recorded: Mapping[tuple[int, int], confidence_cross_validation.RecordedConfidence],
) -> CarriedOver | None:
    """Track each group with a confidence fitted on the other groups.

    Args:
        sequences: Sequences with true boxes.
        preset: Preset of the tracker.
        groups: Name to the indices of its sequences.
        outputs: Output for each sequence and seed, with the preset's confidence.
        recorded: Recorded confidence by index of sequence and seed.

    Returns:
        None where the confidence asks no questions.
    """

    def answers(numbers: Sequence[int]) -> list[confidence_cross_validation.LabeledOdds]:
        runs = [(number, seed) for number in numbers for seed in range(len(outputs[number]))]
        return [
            confidence_cross_validation.LabeledOdds(
                [recorded[number, seed].odds[one] for one in outputs[number][seed].number],
                outputs[number][seed].is_right,
            )
            for number, seed in runs
        ]

    labeled = {name: answers(numbers) for name, numbers in groups.items()}
    if not any(odds for runs in labeled.values() for of in runs for odds in of.odds):
        return None
    carried, fitted = {}, {}
    for left, numbers in groups.items():
        others = [of for name, runs in labeled.items() if name != left for of in runs]
        fitted[left] = confidence_cross_validation.fit(others)
        make_tracker = partial(confidence_cross_validation.fitted_tracker, preset, fitted[left])
        members = [sequences[number] for number in numbers]
        runs = measured(members, lambda _, seed, make=make_tracker: make(seed), len(outputs[0]))
        carried[left] = together([frames for of in runs for frames in of])
    fitted["none"] = confidence_cross_validation.fit(
        [of for runs in labeled.values() for of in runs]
    )
    return CarriedOver(carried, fitted)


def weights_table(weights: Mapping[str, confidence_cross_validation.Weights]) -> Table:
    """The fitted weights by the group left out."""
    questions = sorted({name for of in weights.values() for name in of.factors})
    rows = [
        [name, *(f"{of.factors.get(name, math.nan):.2f}" for of in weights.values())]
        for name in questions
    ]
    rows.append(["constant", *(f"{of.constant:+.2f}" for of in weights.values())])
    return Table(
        "Factors of what each question says, by what is left out", ("question", *weights), [rows]
    )


def summary(
    frames: Frames,
    title: str,
    groups: Mapping[str, Frames] | None = None,
    carried: Mapping[str, Frames] | None = None,
) -> Table:
    """The figures as a table.

    Args:
        frames: All frames.
        title: Title of the table.
        groups: Name of a group of sequences to its frames.
        carried: The same, with the confidence fitted on the other groups.
    """
    area, *others = figures(frames)
    rows = [list(area)]
    rows += [[f"the same in {name}", _area(one)] for name, one in (groups or {}).items()]
    if carried:
        rows.append(
            ["the area, each group's fitted on the others", _area(together([*carried.values()]))]
        )
        rows += [[f"the same in {name}", _area(one)] for name, one in carried.items()]
    return Table(title, ("figure", "value"), [[*rows, *map(list, others)]])


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
        ("area under the ROC curve of the confidence", _area(frames)),
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


def _area(frames: Frames) -> str:
    return _text(roc_area(frames.confidence, frames.is_right))


def _text(figure: float) -> str:
    return "-" if math.isnan(figure) else f"{figure:.3f}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables and write the files."""
    parser = options_of.sequence_parser(__doc__)
    options_of.add_preset(parser)
    options_of.add_groups(parser)
    options = parser.parse_args(arguments)
    try:
        Tracker.from_preset(options.preset)
        sequences = read_sequences(options.sequences)
        options.output.mkdir(parents=True, exist_ok=True)
        names = [footage.name for footage in sequences]
        members = cross_validation.grouped(names, options.group) if options.group else {}
        recorded: dict[tuple[int, int], confidence_cross_validation.RecordedConfidence] = {}

        def tracker(number: int, seed: int) -> AnyTracker:
            made = confidence_cross_validation.RecordingTracker(options.preset, seed)
            recorded[number, seed] = made.recorded
            return made

        outputs = measured(sequences, tracker, options.seeds)
        parts = [together(runs) for runs in outputs]
        frames = together(parts)
        groups = {
            name: together([parts[number] for number in numbers])
            for name, numbers in members.items()
        }
        runs = f"{counted(len(sequences), 'sequence')}, "
        runs += counted(options.seeds, "seed")
        title = f"Uncertainty of preset {options.preset}: {runs}"
        carried = carried_over(sequences, options.preset, members, outputs, recorded)
        tables = [summary(frames, title, groups, carried.frames if carried else None)]
        tables.append(reliability(frames))
        if groups:
            tables.append(group_table(groups))
        if carried:
            tables.append(weights_table(carried.weights))
        for table in tables:
            table.show()
        lines = [f"# {tables[0].title}", "", *tables[0].markdown(), "", NOTE, ""]
        for table in tables[1:]:
            lines += [f"## {table.title}", "", *table.markdown(), ""]
        (options.output / "uncertainty.md").write_text("\n".join(lines), encoding="utf-8")
        with (options.output / "uncertainty.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([tables[1].headings, *tables[1].groups[0]])
        plot(options.output / "uncertainty.png", frames, f"{options.preset}: {runs}")
    except (EvaluationError, FootageError, ParameterError, OSError) as error:
        parser.error(" ".join(str(error).split()))
    print(f"files in {options.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
