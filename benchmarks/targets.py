"""Several targets and a slow detector: `MultiTracker` compared with trackers by detections alone.

The detector runs on every k-th frame; boxes are required in all. A sequence folder has `gt.txt` and
`det.txt` of the MOT challenge, and `seqinfo.ini` (frameRate); its frames are a video or a folder of
images elsewhere. Figures: HOTA, IDF1, MOTA and identity switches of `trackeval` over all frames,
the share of boxes that overlap another one by more than .5, and the CPU time of a frame on one
thread. Each interval is averaged over several first frames.

    python benchmarks/targets.py --sequence MOT_DIR FRAMES

It writes targets.png. Without the package `trackers`, its trackers are omitted.
"""

from __future__ import annotations

import configparser
import functools
import importlib
import importlib.util
import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import arguments as options_of
import cv2
import numpy as np
from matplotlib.figure import Figure
from moving_camera import MovingCamera
from numpy.typing import NDArray
from tables import Table, bold
from target_trackers import TRACKERS, FrameTracks, TargetTracker

from pf_tracker_ros.boxes import pairwise_iou
from pf_tracker_ros.footage import FootageError, open_footage

OURS = "pf_tracker_ros"
PHASES = {1: (0,), 5: (0, 1, 3), 12: (0, 4, 8)}
"""Interval of the detector to its first frames."""
FIGURES = ("HOTA", "IDF1", "MOTA", "switches", "overlap %", "CPU ms")


@dataclass(frozen=True)
class AnnotatedSequence:
    """A sequence with the ground truth of all targets, and detections."""

    name: str  # name of its folder
    frames: Path  # video or folder of its images
    interval: float  # seconds between frames
    truth: tuple[FrameTracks, ...]  # ids and boxes of the scored targets in each frame
    detections: tuple[NDArray[np.float64], ...]  # (M, 5) boxes and scores in each frame
    # moving camera that sees a part of the images; None for whole images
    camera: MovingCamera | None = None

    def carried(self) -> AnnotatedSequence:
        """The sequence as seen by a moving camera."""
        height, width = next(iter(open_footage(self.frames).frames())).image.shape[:2]
        camera = MovingCamera.carried(len(self.truth), self.interval, (width, height))
        truth, detections = [], []
        for number, (tracks, found) in enumerate(zip(self.truth, self.detections, strict=True)):
            boxes, in_view = camera.place(number, tracks.boxes)
            truth.append(FrameTracks(tracks.ids[in_view], boxes[in_view]))
            rows, in_view = camera.place(number, found)
            detections.append(rows[in_view])
        name = f"{self.name}, moving camera"
        return AnnotatedSequence(
            name, self.frames, self.interval, tuple(truth), tuple(detections), camera
        )


def read_sequence(folder: Path, frames: Path) -> AnnotatedSequence:
    """Read the files of the MOT challenge, whose x and y count from 1, beside a video or images."""
    info = configparser.ConfigParser()
    with (folder / "seqinfo.ini").open(encoding="utf-8") as file:
        info.read_file(file)
    truth = np.loadtxt(folder / "gt.txt", delimiter=",", ndmin=2)
    found = np.loadtxt(folder / "det.txt", delimiter=",", ndmin=2)
    for rows in (truth, found):
        rows[:, 2:4] -= 1.0
    # The challenge does not score all of them.
    truth = truth[truth[:, 6] != 0]
    count = int(max(truth[:, 0].max(), found[:, 0].max()))
    return AnnotatedSequence(
        folder.name,
        frames,
        1.0 / info.getfloat("Sequence", "frameRate"),
        tuple(
            FrameTracks(rows[:, 1].astype(np.intp), rows[:, 2:6])
            for rows in (truth[truth[:, 0] == number] for number in range(1, count + 1))
        ),
        tuple(found[found[:, 0] == number][:, 2:7] for number in range(1, count + 1)),
    )


class Run(NamedTuple):
    """A tracker's run on a sequence."""

    tracks: list[FrameTracks]  # tracks of each frame
    seconds: float  # total CPU time


def run(tracker: TargetTracker, sequence: AnnotatedSequence, every: int, first: int) -> Run:
    """Track all targets, with a detector on every `every`-th frame from `first` on."""
    tracks, seconds = [], 0.0
    frames = open_footage(sequence.frames).frames()
    for number, frame in enumerate(itertools.islice(frames, len(sequence.truth))):
        seen = sequence.detections[number] if number % every == first else None
        image = sequence.camera.see(number, frame.image) if sequence.camera else frame.image
        start = time.process_time()
        tracks.append(tracker.update(image, sequence.interval, seen))
        seconds += time.process_time() - start
    if len(tracks) < len(sequence.truth):
        needed = f"{sequence.name} needs {len(sequence.truth)}"
        raise FootageError(f"{sequence.frames} has {len(tracks)} frames; {needed}")
    return Run(tracks, seconds)


def score(truth: Sequence[FrameTracks], done: Run) -> dict[str, float]:
    """The figures of one run."""
    metrics = importlib.import_module("trackeval.metrics")
    silent = {"PRINT_CONFIG": False, "THRESHOLD": 0.5}
    data = _numbered(truth, done.tracks)
    hota = metrics.HOTA().eval_sequence(data)
    identity = metrics.Identity(silent).eval_sequence(data)
    clear = metrics.CLEAR(silent).eval_sequence(data)
    boxes = sum(len(one.ids) for one in done.tracks)
    overlapping = sum(int(_are_overlapping(one).sum()) for one in done.tracks)
    return {
        "HOTA": 100.0 * float(np.mean(hota["HOTA"])),
        "IDF1": 100.0 * float(identity["IDF1"]),
        "MOTA": 100.0 * float(clear["MOTA"]),
        "switches": float(clear["IDSW"]),
        "overlap %": 100.0 * overlapping / max(boxes, 1),
        "CPU ms": 1e3 * done.seconds / len(done.tracks),
    }


def _numbered(truth: Sequence[FrameTracks], tracks: Sequence[FrameTracks]) -> dict[str, Any]:
    """Input of `trackeval` for a sequence: ids counted from 0, and overlaps."""
    true_ids = np.unique(np.concatenate([one.ids for one in truth]))
    track_ids = np.unique(np.concatenate([one.ids for one in tracks]))
    return {
        "num_timesteps": len(truth),
        "num_gt_ids": len(true_ids),
        "num_tracker_ids": len(track_ids),
        "num_gt_dets": sum(len(one.ids) for one in truth),
        "num_tracker_dets": sum(len(one.ids) for one in tracks),
        "gt_ids": [np.searchsorted(true_ids, one.ids) for one in truth],
        "tracker_ids": [np.searchsorted(track_ids, one.ids) for one in tracks],
        "similarity_scores": [
            pairwise_iou(one.boxes, other.boxes) for one, other in zip(truth, tracks, strict=True)
        ],
    }


def _are_overlapping(tracks: FrameTracks) -> NDArray[np.bool_]:
    """(K,) which boxes overlap another one by more than a half."""
    shared = pairwise_iou(tracks.boxes, tracks.boxes)
    np.fill_diagonal(shared, 0.0)
    are: NDArray[np.bool_] = shared.max(axis=1, initial=0.0) > 0.5
    return are


@dataclass(frozen=True)
class Outcome:
    """The figures of a tracker, sequence and interval: means over the detector's first frames."""

    tracker: str
    sequence: str
    every: int
    figures: dict[str, float]


def compare(
    sequences: Iterable[AnnotatedSequence], trackers: dict[str, Callable[..., TargetTracker]]
) -> Iterator[Outcome]:
    """Run all trackers on all sequences at all intervals."""
    for sequence in sequences:
        for every, firsts in PHASES.items():
            for name, make in trackers.items():
                scores = [
                    score(sequence.truth, run(make(every=every), sequence, every, first))
                    for first in firsts
                ]
                figures = {key: float(np.mean([one[key] for one in scores])) for key in scores[0]}
                yield Outcome(name, sequence.name, every, figures)


def table(outcomes: Sequence[Outcome]) -> Table:
    """All figures, ours in bold."""
    rows = []
    for one in outcomes:
        cells = [one.sequence, str(one.every), one.tracker]
        cells += [f"{one.figures[name]:.1f}" for name in FIGURES]
        rows.append([bold(cell, one.tracker == OURS) for cell in cells])
    return Table("Several targets", ("sequence", "every", "tracker", *FIGURES), rows, names=3)


def plot(path: Path, outcomes: Sequence[Outcome]) -> None:
    """Plot HOTA over the detector's interval: a panel per sequence, a line per tracker."""
    sequences = list(dict.fromkeys(one.sequence for one in outcomes))
    figure = Figure(figsize=(5.2 * len(sequences), 4.2), layout="constrained")
    panels = figure.subplots(1, len(sequences), sharey=True, squeeze=False)[0]
    for axes, sequence in zip(panels, sequences, strict=True):
        for name, marker in zip(TRACKERS, "os^vDP", strict=True):
            of_one = [one for one in outcomes if (one.sequence, one.tracker) == (sequence, name)]
            if of_one:
                every, hota = zip(
                    *((one.every, one.figures["HOTA"]) for one in of_one), strict=True
                )
                line, width = ("-", 2.8) if name == OURS else ("--", 1.4)
                axes.plot(every, hota, line, marker=marker, linewidth=width, label=name)
        axes.set(title=sequence, xlabel="a detector sees every k-th frame", xticks=list(PHASES))
        axes.grid(alpha=0.3)
    # After all of them: it ends the scaling of the shared axis.
    panels[0].set_ylim(bottom=0.0)
    panels[0].set_ylabel("HOTA, %")
    panels[-1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, dpi=120)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the comparison, print the table and write the plot."""
    parser = options_of.parser(__doc__)
    parser.add_argument(
        "--sequence",
        nargs=2,
        type=Path,
        action="append",
        required=True,
        metavar=("MOT_DIR", "FRAMES"),
        help="folder with gt.txt, det.txt and seqinfo.ini, and video or folder of images",
    )
    parser.add_argument("--seed", type=int, default=0, help="of MultiTracker and Tracker [0]")
    parser.add_argument(
        "--moving-camera",
        action="store_true",
        help="crop the images as a camera on a walking robot would see them",
    )
    options_of.add_folder(parser)
    options = parser.parse_args(arguments)
    if importlib.util.find_spec("trackeval") is None:
        parser.error("trackeval is not installed: pip install --no-deps trackeval")
    trackers = {}
    for name, kind in TRACKERS.items():
        if missing := kind.missing():
            print(f"{name} is left out: {missing}.")
        else:
            trackers[name] = functools.partial(kind, seed=options.seed)
    cv2.setNumThreads(1)
    with options_of.told_errors(parser):
        sequences = [read_sequence(*paths) for paths in options.sequence]
        if options.moving_camera:
            sequences = [sequence.carried() for sequence in sequences]
        outcomes = []
        for outcome in compare(sequences, trackers):
            print(f"{outcome.sequence} every {outcome.every}: {outcome.tracker}", flush=True)
            outcomes.append(outcome)
        table(outcomes).show()
        options.output.mkdir(parents=True, exist_ok=True)
        plot(options.output / "targets.png", outcomes)


if __name__ == "__main__":
    main()
