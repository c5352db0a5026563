"""Where the preset `learned`, `default` and the network alone follow a target, over time.

    python benchmarks/learned.py SEQUENCE_DIR... --model FOLDER --output docs

It writes learned.png: the overlap with the true box in each frame, a plot for each sequence.
"""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Mapping
from pathlib import Path

# One thread for linear algebra; read when NumPy is imported.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import arguments as options_of
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from peer_trackers import NetworkAlone

from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation import (
    EvaluationError,
    TrackerFactory,
    evaluate_sequence,
    has_target,
    overlap,
    read_sequences,
)
from pf_tracker_ros.footage import Footage, FootageError
from pf_tracker_ros.networks.siamese import SiameseNetwork
from pf_tracker_ros.parameters import ParameterError

# Plots side by side, and the size of each, inches.
COLUMNS, WIDTH, HEIGHT = 2, 4.6, 2.1


def trackers(model: str) -> dict[str, TrackerFactory]:
    """Name to factory of each tracker.

    Args:
        model: Folder of a network.

    Raises:
        ParameterError: The network cannot be used.
    """
    parameters = {"siamese.model": model}
    return {
        "default": functools.partial(Tracker.from_preset, "default"),
        NetworkAlone.name: functools.partial(NetworkAlone, network=SiameseNetwork(model)),
        "learned": functools.partial(Tracker.from_preset, "learned", parameters=parameters),
    }


def overlaps(
    sequence: Footage, makers: Mapping[str, TrackerFactory]
) -> dict[str, NDArray[np.float64]]:
    """Name of each tracker to its (F,) overlap with the true box, not a number without one."""
    found = {}
    for name, make_tracker in makers.items():
        result = evaluate_sequence(sequence, make_tracker, [0])
        values = overlap(result.boxes[0], result.true_boxes)
        found[name] = np.where(has_target(result.true_boxes), values, np.nan)
    return found


def draw(path: Path, curves: Mapping[str, Mapping[str, NDArray[np.float64]]]) -> None:
    """Write the plots.

    Args:
        path: The image file.
        curves: Name of a sequence to the overlaps of each tracker.
    """
    rows = -(-len(curves) // COLUMNS)
    figure = Figure(figsize=(COLUMNS * WIDTH, rows * HEIGHT + 0.4), layout="constrained")
    axes = np.ravel(figure.subplots(rows, COLUMNS, squeeze=False))
    for one, (sequence, by_tracker) in zip(axes, curves.items(), strict=False):
        for name, values in by_tracker.items():
            width = 1.8 if name == "learned" else 1.0
            one.plot(values, linewidth=width, label=name)
        one.set(title=sequence, ylim=(0, 1), xlabel="frame", ylabel="overlap")
        one.grid(alpha=0.3)
    for unused in axes[len(curves) :]:
        unused.set_axis_off()
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    figure.savefig(path, dpi=90)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line, and return its exit code."""
    parser = options_of.parser(__doc__)
    parser.add_argument("sequences", nargs="+", type=Path, metavar="SEQUENCE_DIR")
    options_of.add_folder(parser)
    parser.add_argument("--model", required=True, metavar="FOLDER", help="folder of a network")
    options = parser.parse_args(arguments)
    try:
        makers = trackers(options.model)
        curves = {one.name: overlaps(one, makers) for one in read_sequences(options.sequences)}
        options.output.mkdir(parents=True, exist_ok=True)
        draw(options.output / "learned.png", curves)
    except (EvaluationError, FootageError, ParameterError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(options.output / "learned.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
