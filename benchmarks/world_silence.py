r"""How often a pose is told while the box is on somebody else.

    python benchmarks/world_silence.py SEQUENCE_DIR... --people gt.txt --calibration View_001.xml

Each sequence is tracked from its first box with the preset `default`, and located as by the node
`localizer`. The box is on somebody else where it overlaps another person of `--people` (MOT's
format) more than the target, and by more than 0.1 (IoU). `meta.json` of the sequence has the number
of its first frame among those of `--people`, and its frames are 1/7 s apart, as those of PETS 2009.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

# One thread for linear algebra; read when NumPy is imported.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import arguments as options_of
import cv2
import numpy as np
from numpy.typing import NDArray
from tables import Table
from world_parts.pets import FixedCamera, read_tsai

from pf_tracker_ros import Tracker
from pf_tracker_ros.boxes import pairwise_iou
from pf_tracker_ros.evaluation import EvaluationError, find_sequences
from pf_tracker_ros.footage import Footage, FootageError, read_sequence
from pf_tracker_ros.localization.camera_pose import CameraPose
from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.localization.rigid_pose import RigidPose
from pf_tracker_ros.localization.tracker_frame import ReportedTarget, TrackerFrame
from pf_tracker_ros.localization.world_tracks import Sensed, WorldTracks
from pf_tracker_ros.progress import progress_bar
from pf_tracker_ros.stamps import NANOSECONDS
from pf_tracker_ros.world import GroundPlane

INTERVAL = 1.0 / 7.0
# Least IoU with another person, and with the target's own box among the people.
OVERLAPS, IS_SAME = 0.1, 0.9


@dataclass
class Counts:
    """Frames of a sequence.

    Attributes:
        tracking: With the state `tracking`, on the target and on somebody else.
        told: Those of them with a pose, likewise.
    """

    tracking: NDArray[np.int64]
    told: NDArray[np.int64]

    @classmethod
    def none(cls) -> Counts:
        """No frame yet."""
        return cls(np.zeros(2, np.int64), np.zeros(2, np.int64))

    def cells(self) -> list[str]:
        """Cells of a row of the table."""
        right, wrong = self.tracking.tolist()
        shares = self.told / np.maximum(self.tracking, 1)
        return [str(right + wrong), str(wrong), *(f"{share:.2f}" for share in shares[::-1])]


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
    footage: Footage, seed: int, camera: FixedCamera, people: NDArray[np.float64], first: int
) -> Counts:
    """Track and locate the target of a sequence.

    Args:
        footage: With a true box for each frame.
        seed: Of the tracker.
        camera: Its calibration.
        people: Rows of MOT's gt.txt.
        first: Number of the first frame among those of the people.
    """
    counts, parameters, tracks = Counts.none(), LocalizerParameters(), WorldTracks()
    plane = GroundPlane.from_pose(camera.rotation, camera.translation)
    pose = CameraPose(RigidPose(camera.rotation, camera.translation), plane, "parameters", "still")
    tracker = Tracker.from_preset("default", seed=seed)
    truth = np.asarray(footage.ground_truth)
    for index, frame in enumerate(footage.frames()):
        if index == 0:
            tracker.start(frame.image, truth[0])
            continue
        estimate = tracker.update(frame.image, dt=INTERVAL)
        target = ReportedTarget(
            1, "", estimate.state, estimate.confidence, estimate.box, estimate.box_covariance
        )
        stamp = round((1.0 + index * INTERVAL) * NANOSECONDS)
        reported = TrackerFrame(stamp, "camera", False, estimate.state, 1, None, (target,))
        (located,) = tracks.advance(reported, Sensed(camera.model, pose), parameters)
        if estimate.state != "tracking":
            continue
        boxes = people[people[:, 0] == first + index][:, 2:6]
        wrong = int(is_wrong(np.array(estimate.box), truth[index], boxes))
        counts.tracking[wrong] += 1
        counts.told[wrong] += not located.silence
    return counts


def rows(options: argparse.Namespace) -> Iterator[list[str]]:
    """A row for each sequence."""
    camera = read_tsai(options.calibration)
    people = np.loadtxt(options.people, delimiter=",", ndmin=2)
    sequences = find_sequences(options.sequences)
    with progress_bar(len(sequences) * options.seeds, "runs") as on_progress:
        for folder in sequences:
            counts = Counts.none()
            for seed in range(options.seeds):
                footage = read_sequence(folder)
                first = json.loads((folder / "meta.json").read_text())["first_frame"] + 1
                one = run(footage, seed, camera, people, first)
                counts.tracking += one.tracking
                counts.told += one.told
                on_progress(footage.name, 1)
            yield [footage.name, *counts.cells()]


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
    headings = ["sequence", "tracking", "on somebody else", "told of these", "told of the others"]
    try:
        table = Table(
            "Frames with the state tracking, and shares with a pose", headings, [[*rows(options)]]
        )
        table.show()
        options.output.mkdir(parents=True, exist_ok=True)
        text = "\n".join(table.markdown())
        (options.output / "world_silence.md").write_text(f"{text}\n", encoding="utf-8")
    except (OSError, KeyError, ValueError, EvaluationError, FootageError) as error:
        parser.error(" ".join(str(error).split()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
