"""The ViBe background model on recorded sequences: time of an update, precision and recall.

    python benchmarks/vibe.py SEQUENCE... --output benchmarks/results/vibe.md

A sequence has the box of one target, not its silhouette, which bounds the figures: a person fills
about half of a box, which limits the recall, and other moving objects reduce the precision of the
whole frame. The precision nearby is that in the box and half its size around it. A frame is
detected if at least a fifth of the box is foreground. The first frames, which still contain the
initial background, are skipped.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# One thread for linear algebra; read when NumPy is imported.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import arguments as options_of
import cv2
import numpy as np
from numpy.typing import NDArray
from tables import Table

from pf_tracker_ros.background import BackgroundModel
from pf_tracker_ros.footage import Footage, FootageError, read_sequence
from pf_tracker_ros.progress import progress_bar

HEADINGS = (
    "sequence",
    "image",
    "CPU ms",
    "95 % of",
    "precision %",
    "nearby %",
    "recall %",
    "detected %",
)
LEAST_SHARE = 0.2

# Factory of the model from the first image.
BeginModel = Callable[[NDArray[Any]], BackgroundModel]


@dataclass(frozen=True)
class Outcome:
    """Result of the model on a sequence.

    Attributes:
        name: Of the sequence.
        size: (width, height) of its images.
        milliseconds: (frames - 1,) CPU time of each update, the reduction of the image included.
        counts: (judged frames, 4) pixels: foreground in the box, in the box and half its size
            around it, in the frame; pixels of the box.
    """

    name: str
    size: tuple[int, int]
    milliseconds: NDArray[np.float64]
    counts: NDArray[np.float64]

    def row(self) -> tuple[str, ...]:
        """The figures under `HEADINGS`."""
        inside, near, everywhere, area = self.counts.sum(axis=0)
        detected = self.counts[:, 0] >= LEAST_SHARE * self.counts[:, 3]
        shares = (inside / max(everywhere, 1), inside / max(near, 1), inside / max(area, 1))
        return (
            self.name,
            f"{self.size[0]}x{self.size[1]}",
            f"{np.median(self.milliseconds):.2f}",
            f"{np.quantile(self.milliseconds, 0.95):.2f}",
            *(f"{100 * share:.1f}" for share in shares),
            f"{100 * detected.mean():.1f}",
        )


def count_inside(mask: NDArray[np.uint8], box: NDArray[np.float64]) -> tuple[int, int]:
    """Foreground pixels and all pixels of a mask in a (4,) box in mask pixels."""
    height, width = mask.shape
    left, right = np.clip(np.rint([box[0], box[0] + box[2]]).astype(int), 0, width)
    top, bottom = np.clip(np.rint([box[1], box[1] + box[3]]).astype(int), 0, height)
    patch = mask[top:bottom, left:right]
    return int(np.count_nonzero(patch)), patch.size


def measure(footage: Footage, begin: BeginModel, skip: int) -> Outcome:
    """Evaluate a model on all frames of a sequence with a target but the first `skip`.

    Args:
        footage: The sequence.
        begin: Factory of the model.
        skip: Number of first frames not to evaluate.
    """
    boxes = footage.ground_truth
    assert boxes is not None
    frames = footage.frames()
    image = next(frames).image
    model = begin(image)
    milliseconds, counts = [], []
    with progress_bar(len(boxes) - 1) as on_progress:
        for index, frame in enumerate(frames, start=1):
            on_progress(footage.name, 1)
            before = time.process_time()
            mask = model.update(frame.image)
            milliseconds.append(1000 * (time.process_time() - before))
            if index < skip or np.isnan(boxes[index]).any():
                continue
            box = boxes[index] / model.reduction
            x, y, width, height = box
            around = np.array([x - width / 2, y - height / 2, 2 * width, 2 * height])
            inside, area = count_inside(mask, box)
            counts.append((inside, count_inside(mask, around)[0], np.count_nonzero(mask), area))
    return Outcome(
        footage.name,
        (image.shape[1], image.shape[0]),
        np.array(milliseconds),
        np.array(counts, float),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table and optionally save it."""
    parser = options_of.parser(__doc__)
    parser.add_argument("sequences", nargs="+", type=Path, metavar="SEQUENCE")
    parser.add_argument("--reduction", type=int, default=2, choices=range(1, 17), metavar="1..16")
    parser.add_argument("--gray", action="store_true", help="model gray levels instead of colors")
    parser.add_argument("--skip", type=int, default=50, help="first frames to skip [50]")
    parser.add_argument("--output", type=Path, help="Markdown file for the table")
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)

    def begin(image: NDArray[Any]) -> BackgroundModel:
        return BackgroundModel(
            image,
            np.random.default_rng(0),
            reduction=options.reduction,
            color=not options.gray,
        )

    rows = []
    try:
        for path in options.sequences:
            footage = read_sequence(path)
            frames = footage.frame_count or 0
            if not 1 <= options.skip < frames:
                parser.error(f"--skip is {options.skip}; allowed for {path}: 1 to {frames - 1}")
            rows.append(measure(footage, begin, options.skip).row())
    except FootageError as error:
        parser.error(str(error))
    table = Table("ViBe, one thread", HEADINGS, [rows])
    table.show()
    if options.output:
        options.output.parent.mkdir(parents=True, exist_ok=True)
        options.output.write_text("\n".join([*table.markdown(), ""]), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
