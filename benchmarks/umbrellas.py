"""The umbrella experiment of Li, Zhang, Li 2007 (sequence 2), over many generated scenes.

Two umbrellas of similar color and different texture pass each other behind trees. The paper's three
settings of `li2007` run on the same scenes: color alone with 60 particles, color and texture
(alpha = 0.6) with 30 and with 60. The paper's finding: color alone ends on the wrong umbrella;
color and texture stay on the target, with jitter for 30 particles and steadily for 60.

    python benchmarks/umbrellas.py --seeds 30

It writes `umbrellas.md` (the table) and `umbrellas_frames.png` (a scene with estimates and
particles, as in the paper's Fig. 3).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import arguments as options_of
import cv2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scenes import UmbrellaScene
from scenes.umbrellas import FRAME_INTERVAL
from tables import Table, save_tables

from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation.metrics import center_errors, overlap
from pf_tracker_ros.progress import progress_bar

PAPER_FRAMES = (20, 96, 122, 159)
"""The frames of the paper's Fig. 3, counted from 1."""
SECOND = 25
"""Frames in one second."""

Boxes = NDArray[np.float64]


@dataclass(frozen=True)
class Setting:
    """One of the paper's experiments."""

    name: str  # name in the tables
    alpha: float  # weight of the color cue; that of the texture cue is 1 - alpha
    particles: int  # number of particles

    def tracker(self, seed: int) -> Tracker:
        """The preset's tracker in this setting."""
        parameters = {
            "particles": self.particles,
            "color_histogram.weight": self.alpha,
            "gradient_orientation.weight": 1.0 - self.alpha,
        }
        return Tracker.from_preset("li2007", seed=seed, parameters=parameters)


SETTINGS = (
    Setting("color alone, N = 60", 1.0, 60),
    Setting("color + texture, N = 30", 0.6, 30),
    Setting("color + texture, N = 60", 0.6, 60),
)


@dataclass(frozen=True)
class Run:
    """Run of a setting on a scene."""

    setting: str  # name of the setting
    seed: int  # seed of the scene and of the tracker
    outcome: str  # as in `outcome`
    errors: NDArray[np.float64]  # (frames,) distance of the estimate's center from the target's, px
    jitter: float  # as in `jitter`, px
    milliseconds: float  # median CPU time of one update
    # per frame of `PAPER_FRAMES`: estimated box (4,), particles' boxes (N, 4) and weights (N,)
    snapshots: tuple[tuple[NDArray[np.float64], ...], ...]


def outcome(boxes: Boxes, target: Boxes, other: Boxes) -> str:
    """Outcome of a run after the umbrellas have passed each other.

    "switched": for at least half a second without a break the estimate overlapped the other
    umbrella's box and its center was nearer to the other's center than to the target's; a run that
    comes back later still counts as switched. "held": not switched, and in the last second the
    median center error is at most half a box. "lost": neither.

    Args:
        boxes: (frames, 4) estimates.
        target: (frames, 4) the target's true boxes.
        other: (frames, 4) the other umbrella's true boxes.
    """
    apart = center_errors(target, other) > target[:, 2]
    wrong = (center_errors(boxes, other) < center_errors(boxes, target)) & apart
    wrong &= overlap(boxes, other) > 0.0
    wrong[: int(np.argmin(center_errors(target, other)))] = False
    ends = np.flatnonzero(np.diff(np.concatenate([[False], wrong, [False]]).astype(int)))
    if int(np.max(ends[1::2] - ends[::2], initial=0)) >= SECOND // 2:
        return "switched"
    held = np.median(center_errors(boxes, target)[-SECOND:]) <= target[0, 2] / 2
    return "held" if held else "lost"


def jitter(boxes: Boxes, target: Boxes) -> float:
    """Root mean square of the change of the error vector from frame to frame, px.

    Args:
        boxes: (frames, 4) estimates.
        target: (frames, 4) the target's true boxes.
    """
    offsets = (boxes[:, :2] + boxes[:, 2:] / 2) - (target[:, :2] + target[:, 2:] / 2)
    return float(np.sqrt(np.mean(np.sum(np.diff(offsets, axis=0) ** 2, axis=1))))


def run_scene(seed: int, settings: Sequence[Setting] = SETTINGS) -> list[Run]:
    """Run settings on the scene of a seed, which is that of the trackers, too."""
    scene = UmbrellaScene(seed)
    trackers = [setting.tracker(seed) for setting in settings]
    boxes = np.empty((len(settings), len(scene), 4))
    seconds = np.empty((len(settings), len(scene) - 1))
    snapshots: list[list[tuple[NDArray[np.float64], ...]]] = [[] for _ in settings]
    for index, image in enumerate(scene.frames()):
        for run, tracker in enumerate(trackers):
            before = time.process_time()
            if index == 0:
                estimate = tracker.start(image, tuple(scene.target_boxes[0]))
            else:
                estimate = tracker.update(image, FRAME_INTERVAL)
                seconds[run, index - 1] = time.process_time() - before
            boxes[run, index] = estimate.box
            if index + 1 in PAPER_FRAMES:
                shown = (boxes[run, index].copy(), estimate.particle_boxes, estimate.weights)
                snapshots[run].append(shown)
    return [
        Run(
            setting.name,
            seed,
            outcome(boxes[run], scene.target_boxes, scene.other_boxes),
            center_errors(boxes[run], scene.target_boxes),
            jitter(boxes[run], scene.target_boxes),
            1000.0 * float(np.median(seconds[run])),
            tuple(snapshots[run]),
        )
        for run, setting in enumerate(settings)
    ]


def table(runs: Sequence[Run]) -> Table:
    """A row for each setting; the errors are means over the frames and the scenes."""
    rows = []
    for setting in SETTINGS:
        mine = [run for run in runs if run.setting == setting.name]
        held = [run for run in mine if run.outcome == "held"]
        counts = [sum(run.outcome == kind for run in mine) for kind in ("switched", "lost", "held")]
        figures = [
            np.mean([run.errors.mean() for run in mine]),
            np.mean([run.errors.mean() for run in held]) if held else np.nan,
            np.mean([run.jitter for run in held]) if held else np.nan,
            np.median([run.milliseconds for run in mine]),
        ]
        rows.append([setting.name, *map(str, counts), *(f"{one:.2f}" for one in figures)])
    headings = ("setting", "switched", "lost", "held", "center error px", "of held ones")
    headings += ("jitter of held ones px", "CPU ms")
    scenes = len({run.seed for run in runs})
    return Table(f"Umbrellas, number of scenes: {scenes}", headings, [rows])


def write_frames(path: Path, runs: Sequence[Run]) -> None:
    """Draw estimates and particles into the paper's frames of a scene, a row for each setting.

    The scene is the first in which color alone switched and the other settings held; without one,
    the first of all.
    """
    scenes = [runs[start : start + len(SETTINGS)] for start in range(0, len(runs), len(SETTINGS))]
    as_in_paper = [
        one for one in scenes if [run.outcome for run in one] == ["switched", "held", "held"]
    ]
    chosen = (as_in_paper or scenes)[0]
    scene = UmbrellaScene(chosen[0].seed)
    figure = Figure(figsize=(15.0, 5.8), layout="constrained")
    figure.suptitle(f"Scene {chosen[0].seed}: estimate (large) and particles (size by weight)")
    axes = figure.subplots(len(chosen), len(PAPER_FRAMES), squeeze=False)
    for row, run in zip(axes, chosen, strict=True):
        for cell, number, snapshot in zip(row, PAPER_FRAMES, run.snapshots, strict=True):
            image = _with_boxes(scene.render(number - 1), *snapshot)
            cell.imshow(image[210:430, 110:660, ::-1])
            cell.set(xticks=[], yticks=[], title=f"{run.setting}, frame {number}")
            cell.title.set_fontsize(9)
    figure.savefig(path, dpi=120)


def _with_boxes(
    image: NDArray[np.uint8], box: Boxes, particle_boxes: Boxes, weights: NDArray[np.float64]
) -> NDArray[np.uint8]:
    centers = particle_boxes[:, :2] + particle_boxes[:, 2:] / 2
    halves = 1.0 + 4.0 * np.sqrt(weights / weights.max())
    corners = np.stack([centers - halves[:, None], centers + halves[:, None]], axis=1)
    for low, high in np.round(corners).astype(int).tolist():
        cv2.rectangle(image, low, high, (255, 255, 255), 1)
    low, high = np.round([box[:2], box[:2] + box[2:]]).astype(int).tolist()
    cv2.rectangle(image, low, high, (255, 255, 255), 2)
    return image


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the experiment, print the table and write the files."""
    parser = options_of.parser(__doc__)
    options_of.add_seeds(parser, 30, "number of scenes")
    first = options_of.at_least(0)
    parser.add_argument("--first-seed", type=first, default=0, help="of the first scene [0]")
    options_of.add_folder(parser)
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    runs: list[Run] = []
    with progress_bar(options.seeds, "scenes") as on_progress:
        for seed in range(options.first_seed, options.first_seed + options.seeds):
            runs += run_scene(seed)
            on_progress("", 1)
    made = table(runs)
    made.show()
    try:
        save_tables(options.output / "umbrellas.md", [made])
        write_frames(options.output / "umbrellas_frames.png", runs)
    except OSError as error:
        parser.error(str(error))
    print(f"files in {options.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
