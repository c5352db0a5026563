"""The experiment of Zhang, Hu, Shi 2015: HOG against a color histogram in infrared footage.

`zhang2015`, and `li2007` with color alone, track the same targets of recorded sequences. The
paper's figure is the share of frames that overlap the true box by more than 60 % of its area. As it
favors boxes that are too large, the success AUC is reported as well.

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


def row(tracker: str, result: SequenceResult) -> list[str]:
    """The figures of one tracker on one sequence, means over the seeds."""
    shares = covered_shares(result.boxes, result.true_boxes)
    known = shares[:, has_target(result.true_boxes)]
    share = f"{(known > NEEDED_SHARE).mean():.0%}"
    return [result.name, tracker, share, f"{result.scores.success_auc:.3f}"]


TITLES = ["sequence", "tracker", "overlap > 60 %", "AUC"]


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
