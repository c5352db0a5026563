"""The experiment of Zhang, Hu, Shi 2015: HOG against a color histogram in infrared footage.

`zhang2015`, and `li2007` with color alone, track the same targets of recorded sequences. The
paper's figures are the share of frames that overlap the true box by more than 60 % of its area, and
the frame after which the overlap stays 0. As the first favors boxes that are too large, the success
AUC is reported as well.

    python benchmarks/infrared.py SEQUENCE_DIR... --seeds 3
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import arguments as options_of
import numpy as np
from numpy.typing import NDArray
from tables import Table

from pf_tracker_ros import Tracker
from pf_tracker_ros.boxes import intersection_areas
from pf_tracker_ros.evaluation import (
    SequenceResult,
    evaluate_sequence,
    has_target,
    read_sequences,
)

COLOR_ALONE = {"cues": ("color_histogram",)}
TRACKERS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "zhang2015": ("zhang2015", {}),
    "zhang2015, template replaced": ("zhang2015", {"hog.keep": 0.0}),
    "li2007, color alone": ("li2007", COLOR_ALONE),
    # The paper compares at the same number of particles.
    "li2007, color alone, N = 100": ("li2007", COLOR_ALONE | {"particles": 100}),
}
NEEDED_SHARE = 0.6
"""Minimum share of the true box's area in a tracked frame."""


def covered_shares(
    boxes: NDArray[np.float64], true_boxes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(..., frames) share of the true box inside the box; NaN without true box."""
    return intersection_areas(boxes, true_boxes) / true_boxes[..., 2:].prod(axis=-1)


def frame_of_loss(shares: NDArray[np.float64]) -> int | None:
    """The frame, counted from 1, after which the box never covers the target; None if none.

    Frames without a target, of share NaN, tell neither.
    """
    known = np.flatnonzero(~np.isnan(shares))
    uncovered = known[shares[known] == 0.0]
    seen = known[shares[known] > 0.0]
    lost = uncovered[uncovered > seen[-1]] if len(seen) else uncovered
    return int(lost[0]) + 1 if len(lost) else None


def row(tracker: str, result: SequenceResult) -> list[str]:
    """The figures of one tracker on one sequence, means over the seeds."""
    shares = covered_shares(result.boxes, result.true_boxes)
    known = shares[:, has_target(result.true_boxes)]
    losses = [loss for loss in map(frame_of_loss, shares) if loss is not None]
    return [
        result.name,
        tracker,
        f"{(known > NEEDED_SHARE).mean():.0%}",
        f"{len(losses)} of {len(shares)}",
        f"{np.median(losses):.0f}" if losses else "-",
        f"{result.scores.success_auc:.3f}",
    ]


TITLES = ["sequence", "tracker", "overlap > 60 %", "lost", "frame of loss", "AUC"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the experiment and print the table."""
    parser = options_of.sequence_parser(__doc__)
    options = parser.parse_args(arguments)
    with options_of.told_errors(parser):
        rows = []
        for one in read_sequences(options.sequences):
            for name, (preset, parameters) in TRACKERS.items():
                make = functools.partial(Tracker.from_preset, preset, parameters=parameters)
                rows.append(row(name, evaluate_sequence(one, make, range(options.seeds))))
    Table("Infrared", TITLES, rows, names=2).show()


if __name__ == "__main__":
    main()
