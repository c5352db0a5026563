"""The comparison of Zhang Bo: `zhang_bo` and the seven families of trackers in the same footage.

Pedestrians in generated streets with increasing clutter: root mean square of the center error over
the level of clutter.

    python benchmarks/families.py --scenes 5
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence

import arguments as options_of
import numpy as np
from scenes import ClutteredStreet
from tables import Table
from tracker_families import FAMILIES

from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation import SequenceResult, TrackerFactory, evaluate_sequence
from pf_tracker_ros.progress import progress_bar

TRACKERS: Mapping[str, TrackerFactory] = {
    **FAMILIES,
    "zhang_bo": functools.partial(Tracker.from_preset, "zhang_bo"),
}
"""The compared trackers: name to factory from a seed."""


def center_rmse(result: SequenceResult) -> float:
    """Root mean square of the center error over the frames, px, mean of the seeds."""
    return float(np.sqrt(np.nanmean(result.center_errors**2, axis=1)).mean())


def clutter_table(scenes: int, levels: int = 5, frames: int = 120) -> Table:
    """Generated streets, each at evenly spaced levels of clutter, 0 to 1.

    A scene's seed is the trackers' seed too. Errors are means over the scenes.
    """
    shares = np.linspace(0.0, 1.0, levels).tolist()
    errors = np.empty((scenes, levels, len(TRACKERS)))
    with progress_bar(scenes * levels * frames * len(TRACKERS)) as on_progress:
        for scene in range(scenes):
            for number, level in enumerate(shares):
                street = ClutteredStreet(scene, level, frames)
                errors[scene, number] = [
                    center_rmse(evaluate_sequence(street, make, (scene,), on_progress))
                    for make in TRACKERS.values()
                ]
    rows = [
        [tracker, *(f"{one:.1f}" for one in means)]
        for tracker, means in zip(TRACKERS, errors.mean(axis=0).T, strict=True)
    ]
    headings = ("tracker", *(f"{level:g}" for level in shares))
    return Table(f"Center RMSE over the clutter, px, streets: {scenes}", headings, rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the experiment and print the table."""
    parser = options_of.parser(__doc__)
    options_of.add_seeds(parser, 5, "generated streets")
    clutter_table(parser.parse_args(arguments).seeds).show()


if __name__ == "__main__":
    main()
