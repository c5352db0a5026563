"""One pedestrian of several: tracked alone, and together with all others of the same footage.

A window is a sequence with the true boxes of one target, cut from footage whose folder of the MOT
challenge has the boxes of all (see `targets.py`). Three settings are compared by success AUC:

- alone: one `Tracker`, started on the true box;
- with all: a `MultiTracker`, started on the true boxes of the first frame only;
- with a detector: the same, with detections every 12th frame after the first, which also start new
  targets.

    python benchmarks/pedestrians.py --window MOT_DIR SEQUENCE --window MOT_DIR SEQUENCE ...

It prints a table and writes it into the output folder as pedestrians.md.
"""

from __future__ import annotations

import configparser
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

# One thread for linear algebra; read when NumPy is imported.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import arguments as options_of
import cv2
import numpy as np
from numpy.typing import NDArray
from tables import Table
from targets import AnnotatedSequence, read_sequence

from pf_tracker_ros import Detections, MultiTracker, Tracker
from pf_tracker_ros.evaluation.metrics import overlap, success_auc
from pf_tracker_ros.footage import Footage, FootageError
from pf_tracker_ros.footage import read_sequence as read_window

EVERY = 12
"""Interval of the detector in frames."""
# Tolerance in pixels for differently rounded true boxes.
_SAME_WITHIN = 1.0


@dataclass(frozen=True)
class Window:
    """A range of frames with a target, in footage with the true boxes of all.

    Attributes:
        footage: Its frames, with the true boxes of the target.
        everybody: True boxes of all in the whole footage.
        target: Id of the target there.
        first: First frame of the window there, counted from 0.
    """

    footage: Footage
    everybody: AnnotatedSequence
    target: int
    first: int

    @property
    def truth(self) -> NDArray[np.float64]:
        """(frames, 4) true boxes of the target."""
        boxes = self.footage.ground_truth
        assert boxes is not None
        return boxes


def find_window(footage: Footage, everybody: AnnotatedSequence) -> Window:
    """Find a window's target and first frame in the footage by the true boxes.

    Raises:
        ValueError: Nobody has these boxes.
    """
    truth = footage.ground_truth
    assert truth is not None
    count = len(everybody.truth)
    for target in np.unique(np.concatenate([one.ids for one in everybody.truth])).tolist():
        boxes = np.full((count, 4), np.nan)
        for number, one in enumerate(everybody.truth):
            boxes[number] = one.boxes[one.ids == target][0] if target in one.ids else np.nan
        for first in range(count - len(truth) + 1):
            if np.all(np.abs(boxes[first : first + len(truth)] - truth) < _SAME_WITHIN):
                return Window(footage, everybody, target, first)
    raise ValueError(f"nobody of {everybody.name} has the boxes of {footage.name}")


def track_alone(window: Window, seed: int) -> NDArray[np.float64]:
    """(frames, 4) boxes of the target by a single-target tracker."""
    tracker = Tracker.from_preset("default", seed)
    boxes = [window.truth[0]]
    for number, frame in enumerate(window.footage.frames()):
        if number == 0:
            tracker.start(frame.image, boxes[0])
        else:
            boxes.append(np.array(tracker.update(frame.image, window.everybody.interval).box))
    return np.array(boxes)


def track_with_others(window: Window, seed: int, every: int = 0) -> NDArray[np.float64]:
    """(frames, 4) boxes of the target by a multi-target tracker.

    Args:
        window: The target and its footage.
        seed: Seed of the tracker.
        every: Interval of the detector in frames; 0 for no detector.
    """
    tracker = MultiTracker.from_preset("default", seed)
    boxes = [window.truth[0]]
    mine = 0
    for number, frame in enumerate(window.footage.frames()):
        if number == 0:
            mine = tracker.start(frame.image, boxes[0])
            for box in _others(window, frame.image.shape):
                tracker.start(frame.image, box)
            continue
        seen = None
        if every and number % every == 0:
            found = window.everybody.detections[window.first + number]
            seen = Detections(found[:, :4], found[:, 4])
        targets = tracker.update(frame.image, window.everybody.interval, seen)
        boxes.append(np.array(next(one.estimate.box for one in targets if one.id == mine)))
    return np.array(boxes)


def _others(window: Window, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """(K, 4) true boxes of the others in the first frame whose centers are in the image."""
    there = window.everybody.truth[window.first]
    centers = there.boxes[:, :2] + there.boxes[:, 2:] / 2
    inside = ((centers >= 0.0) & (centers < (shape[1], shape[0]))).all(axis=1)
    return there.boxes[inside & (there.ids != window.target)]


WAYS: dict[str, Callable[[Window, int], NDArray[np.float64]]] = {
    "alone": track_alone,
    "with all": track_with_others,
    "with a detector": lambda window, seed: track_with_others(window, seed, EVERY),
}


def compare(windows: Sequence[Window], seeds: int) -> dict[str, list[float]]:
    """Setting to the success AUC of each window's target, mean over seeds."""
    return {
        name: [
            float(
                np.mean(
                    [
                        success_auc(overlap(follow(window, seed), window.truth))
                        for seed in range(seeds)
                    ]
                )
            )
            for window in windows
        ]
        for name, follow in WAYS.items()
    }


def table(windows: Sequence[Window], figures: dict[str, list[float]]) -> Table:
    """A row for each window, and their mean."""
    rows = [
        [window.footage.name, *(f"{of_way[place]:.3f}" for of_way in figures.values())]
        for place, window in enumerate(windows)
    ]
    mean = ["mean", *(f"{np.mean(of_way):.3f}" for of_way in figures.values())]
    return Table("One pedestrian of several: AUC", ("sequence", *figures), [rows, [mean]])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison, print the table and write it."""
    parser = options_of.parser(__doc__)
    parser.add_argument(
        "--window",
        nargs=2,
        type=Path,
        action="append",
        required=True,
        metavar=("MOT_DIR", "SEQUENCE"),
        help="folder with gt.txt, det.txt and seqinfo.ini, and a sequence of the same footage",
    )
    options_of.add_seeds(parser, 1, "runs of each, averaged")
    options_of.add_folder(parser)
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    try:
        windows = [
            find_window(read_window(folder), read_sequence(people, folder, also_unscored=True))
            for people, folder in options.window
        ]
        options.output.mkdir(parents=True, exist_ok=True)
        figures = table(windows, compare(windows, options.seeds))
        figures.show()
        lines = figures.markdown()
        (options.output / "pedestrians.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    except (FootageError, OSError, ValueError, configparser.Error) as error:
        parser.error(" ".join(str(error).split()))
    print(f"files in {options.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
