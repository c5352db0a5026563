"""Ranges and positions before a moving car, from tables of KITTI tracking labels.

A table has a first line `# fx ... fy ... cx ... cy ... offset_x ...`, then the columns frame, id,
class, truncated, occluded, x, y, width, height (pixels), height_m and so on, X, Y, Z (meters, of
the lower center, z forward).
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tables import Table

from pf_tracker_ros.progress import OnProgress
from pf_tracker_ros.world import CameraModel, Localizer, Place
from world_parts.errors import Array, position_errors


@dataclass(frozen=True, eq=False)
class LabeledBoxes:
    """Boxes with their targets' positions before one camera."""

    name: str  # of the sequence
    camera: CameraModel  # of all boxes
    boxes: Array  # (N, 4), pixels
    positions: Array  # (N, 3) lower centers in camera coordinates, meters
    is_whole: NDArray[np.bool_]  # (N,) whether all of the target is visible and inside the image
    at_border: NDArray[np.bool_]  # (N,) whether the box reaches the border of the image


def read_kitti(path: Path) -> LabeledBoxes:
    """The labels of one sequence. The image ends where the farthest box does."""
    first, *lines = path.read_text(encoding="utf-8").splitlines()
    words = first.lstrip("# ").split()
    numbers = dict(zip(words[::2], map(float, words[1::2]), strict=True))
    rows = list(csv.DictReader(lines))
    boxes = _columns(rows, "x", "y", "width", "height")
    positions = _columns(rows, "X", "Y", "Z")
    hidden = _columns(rows, "truncated", "occluded")
    fx, fy, cx, cy, offset = (numbers[name] for name in ("fx", "fy", "cx", "cy", "offset_x"))
    positions[:, 0] += offset
    ends = boxes[:, :2] + boxes[:, 2:]
    # Boxes end at the last pixel of the image, counted from 0.
    width, height = (int(end) for end in np.maximum(np.rint(ends.max(axis=0)) + 1.0, (1224, 370)))
    at_border = (boxes[:, :2] < 2.0).any(axis=1) | (ends > (width - 2.0, height - 2.0)).any(axis=1)
    is_whole = ~at_border & (hidden == 0.0).all(axis=1)
    camera = CameraModel(fx, fy, cx, cy, width, height)
    return LabeledBoxes(path.stem, camera, boxes, positions, is_whole, at_border)


def kitti_table(sequences: Sequence[LabeledBoxes], on_progress: OnProgress) -> Table:
    """Range and position before a moving car, with the defaults of `Localizer`."""
    kinds = {
        "ground and height": ("ground", "height"),
        "ground": ("ground",),
        "height": ("height",),
    }
    positions = np.concatenate([one.positions for one in sequences])
    whole = np.concatenate([one.is_whole for one in sequences])
    border = np.concatenate([one.at_border for one in sequences])
    groups, fused = [], []
    for name, methods in kinds.items():
        places: list[Place | None] = []
        for sequence in sequences:
            localizer = Localizer(sequence.camera)
            places += [localizer.locate(box, methods=methods) for box in sequence.boxes]
            on_progress(sequence.name, len(sequence.boxes))
        fused = fused or places
        groups.append(_kitti_row(f"{name}, whole", places, positions, whole))
    rows = [_kitti_row("at the border", fused, positions, border)]
    numbers = np.repeat(np.arange(len(sequences)), [len(one.boxes) for one in sequences])
    for number, sequence in enumerate(sequences):
        of_sequence = whole & (numbers == number)
        rows.append(_kitti_row(f"whole in {sequence.name}", fused, positions, of_sequence))
    figures = ("median %", "90 %", "NEES", "inside")
    headings = ("boxes", "located", f"range {figures[0]}", *figures[1:])
    headings += (f"position {figures[0]}", *figures[1:], "no place")
    return Table("KITTI, people and cyclists before a moving car", headings, [*groups, *rows])


def _kitti_row(
    name: str, places: Sequence[Place | None], positions: Array, selected: NDArray[np.bool_]
) -> list[str]:
    ranges, errors, missing = position_errors(places, positions, selected)
    return [name, *ranges.cells(100.0, 1), *errors.cells(100.0, 1)[1:], str(missing)]


def _columns(rows: list[dict[str, str]], *names: str) -> Array:
    return np.array([[float(row[name]) for name in names] for row in rows])
