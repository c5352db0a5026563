r"""How often a pose is told while the box is on somebody else, and how good the others are.

    python benchmarks/world_silence.py SEQUENCE_DIR... --people gt.txt --calibration View_001.xml

Each sequence is tracked from its first box with the preset `default`, and located as by the node
`localizer`. The box is on somebody else where it overlaps another person of `--people` (MOT's
format, with x and y on the ground in columns 8 and 9) more than the target, and by more than 0.1
(IoU). `meta.json` of the sequence has the number of its first frame among those of `--people`, and
its frames are 1/7 s apart, as those of PETS 2009.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

# One thread for linear algebra; read when NumPy is imported.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import arguments as options_of
import cv2
import numpy as np
from numpy.typing import NDArray
from tables import Table
from world_parts.pets import FixedCamera, read_tsai
from world_parts.tracked import LocatedTracker, TrackedErrors, central_velocities

from pf_tracker_ros.boxes import pairwise_iou
from pf_tracker_ros.evaluation import EvaluationError, find_sequences
from pf_tracker_ros.footage import Footage, FootageError, read_sequence
from pf_tracker_ros.localization.camera_pose import CameraPose
from pf_tracker_ros.localization.rigid_pose import RigidPose
from pf_tracker_ros.localization.world_tracks import Sensed
from pf_tracker_ros.progress import progress_bar
from pf_tracker_ros.world import GroundPlane

INTERVAL = 1.0 / 7.0
# Least IoU with another person, with the target's own box among the people, and of a box whose
# position is compared.
OVERLAPS, IS_SAME, ON_TARGET = 0.1, 0.9, 0.3


@dataclass
class Counts:
    """Frames of a sequence, each as those on the target and those on somebody else.

    Attributes:
        tracking: With the state `tracking`.
        posed: Those of them with a pose.
    """

    tracking: NDArray[np.int64] = field(default_factory=lambda: np.zeros(2, np.int64))
    posed: NDArray[np.int64] = field(default_factory=lambda: np.zeros(2, np.int64))

    def __add__(self, other: Counts) -> Counts:
        return Counts(self.tracking + other.tracking, self.posed + other.posed)

    def cells(self) -> list[str]:
        """Number of frames, of those on somebody else, and their share, of both kinds."""
        cells = []
        for right, wrong in (self.tracking.tolist(), self.posed.tolist()):
            total = right + wrong
            cells += [str(total), str(wrong), f"{wrong / total:.3f}" if total else "-"]
        return cells


def is_wrong(
    box: NDArray[np.float64], true_box: NDArray[np.float64], people: NDArray[np.float64]
) -> bool:
    """Whether a box is on another one of (N, 4) people than that of the true box."""
    if not len(people):
        return False
    own = np.nan_to_num(pairwise_iou(box[None], true_box[None])[0, 0])
    is_other = ~(pairwise_iou(true_box[None], people)[0] > IS_SAME)
    other = pairwise_iou(box[None], people)[0][is_other].max(initial=0.0)
    return bool(other > max(own, OVERLAPS))


def run(
    footage: Footage,
    seed: int,
    camera: FixedCamera,
    people: NDArray[np.float64],
    errors: TrackedErrors,
) -> Counts:
    """Track and locate the target of a sequence.

    Args:
        footage: With a true box for each frame.
        seed: Of the tracker.
        camera: Its calibration.
        people: Rows of MOT's gt.txt from the sequence's first frame, which is number 0.
        errors: Gets those of the frames that are on the target.
    """
    counts, frames = Counts(), iter(footage.frames())
    plane = GroundPlane.from_pose(camera.rotation, camera.translation)
    pose = RigidPose(camera.rotation, camera.translation)
    sensed = Sensed(camera.model, CameraPose(pose, plane, "parameters", "still"))
    truth = np.asarray(footage.ground_truth)
    positions = np.array([position_of(box, people, number) for number, box in enumerate(truth)])
    velocities = central_velocities(positions, INTERVAL)
    tracker = LocatedTracker(next(frames).image, truth[0], INTERVAL, seed)
    for index, frame in enumerate(frames, start=1):
        estimate, located = tracker.update(frame.image, sensed)
        if estimate.state != "tracking":
            continue
        box, boxes = np.array(estimate.box), people[people[:, 0] == index][:, 2:6]
        wrong = is_wrong(box, truth[index], boxes)
        counts.tracking[int(wrong)] += 1
        counts.posed[int(wrong)] += not located.silence
        own = pairwise_iou(box[None], truth[index][None])[0, 0]
        if not wrong and own >= ON_TARGET and np.isfinite(positions[index]).all():
            errors.add(located, sensed, positions[index], velocities[index])
    return counts


def position_of(
    box: NDArray[np.float64], people: NDArray[np.float64], frame: int
) -> NDArray[np.float64]:
    """(2,) position on the ground of the person with a box, meters; NaN without."""
    rows = people[people[:, 0] == frame]
    is_same = pairwise_iou(box[None], rows[:, 2:6])[0] > IS_SAME
    return rows[is_same.argmax(), 7:9] if is_same.any() else np.full(2, np.nan)


def measured(options: argparse.Namespace) -> list[Table]:
    """The tables of poses and of positions."""
    camera = read_tsai(options.calibration)
    people = np.loadtxt(options.people, delimiter=",", ndmin=2)
    sequences = find_sequences(options.sequences)
    groups, errors = [], TrackedErrors()
    with progress_bar(len(sequences) * options.seeds, "runs") as on_progress:
        for folder in sequences:
            total, rows = Counts(), []
            for seed in range(options.seeds):
                footage = read_sequence(folder)
                first = json.loads((folder / "meta.json").read_text())["first_frame"] + 1
                since = people - (first, *[0.0] * (people.shape[1] - 1))
                counts = run(footage, seed, camera, since, errors)
                total += counts
                rows.append([footage.name, str(seed), *counts.cells()])
                on_progress(footage.name, 1)
            groups.append([*rows, [footage.name, "all", *total.cells()]])
    headings = ("tracking", "on somebody else", "share", "with a pose", "on somebody else", "share")
    return [
        Table("Frames by state and by pose", ("sequence", "seed", *headings), groups, names=2),
        Table(
            "Positions while the box is on the target",
            ("default", "frames", "median", "90 %", "NEES", "inside"),
            [errors.rows()],
        ),
    ]


def arguments() -> argparse.ArgumentParser:
    """The command line."""
    made = options_of.sequence_parser(__doc__, seeds=2)
    made.add_argument("--people", type=Path, required=True, metavar="FILE", help="MOT's gt.txt")
    made.add_argument("--calibration", type=Path, required=True, metavar="FILE", help="Tsai's")
    return made


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print, and write `world_silence.md`."""
    cv2.setNumThreads(1)
    parser = arguments()
    options = parser.parse_args(argv)
    try:
        lines = []
        for table in measured(options):
            table.show()
            lines += [f"## {table.title}", "", *table.markdown(), ""]
        options.output.mkdir(parents=True, exist_ok=True)
        (options.output / "world_silence.md").write_text("\n".join(lines), encoding="utf-8")
    except (OSError, KeyError, ValueError, EvaluationError, FootageError) as error:
        parser.error(" ".join(str(error).split()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
