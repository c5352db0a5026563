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

import argparse
import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from functools import partial
from typing import Any

# One thread for linear algebra; read when NumPy is imported.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import arguments as options_of
import cv2
import numpy as np
from numpy.typing import NDArray
from scenes import UmbrellaScene
from scenes.umbrellas import FRAME_INTERVAL
from umbrella_runs import PAPER_FRAMES, SETTINGS, Run, Setting
from umbrellas_report import print_table, write_frames, write_table

from pf_tracker_ros.evaluation.metrics import center_errors, overlap
from pf_tracker_ros.evaluation.parallel import WorkerEnded, run_parallel
from pf_tracker_ros.progress import progress_bar

SECOND = 25
"""Frames in one second."""


def outcome(
    boxes: NDArray[np.float64], target: NDArray[np.float64], other: NDArray[np.float64]
) -> str:
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
    meeting = int(np.argmin(center_errors(target, other)))
    wrong = (center_errors(boxes, other) < center_errors(boxes, target)) & apart
    wrong &= overlap(boxes, other) > 0.0
    wrong[:meeting] = False
    if _longest_stretch(wrong) >= SECOND // 2:
        return "switched"
    held = np.median(center_errors(boxes, target)[-SECOND:]) <= target[0, 2] / 2
    return "held" if held else "lost"


def jitter(boxes: NDArray[np.float64], target: NDArray[np.float64]) -> float:
    """Jitter of the estimate around the target, in px.

    The root mean square, over the frames, of the length of the change from one frame to the next
    of the vector from the target's true center to the estimate's.

    Args:
        boxes: (frames, 4) estimates.
        target: (frames, 4) the target's true boxes.
    """
    offsets = (boxes[:, :2] + boxes[:, 2:] / 2) - (target[:, :2] + target[:, 2:] / 2)
    return float(np.sqrt(np.mean(np.sum(np.diff(offsets, axis=0) ** 2, axis=1))))


def run_scene(
    seed: int,
    overrides: Mapping[str, Any] | None = None,
    settings: Sequence[Setting] = SETTINGS,
) -> list[Run]:
    """Run the settings in parallel on the scene of a seed.

    Args:
        seed: Seed of the scene and of the trackers.
        overrides: Parameters that override those of preset and setting.
        settings: Settings to run.
    """
    cv2.setNumThreads(1)
    scene = UmbrellaScene(seed)
    trackers = [setting.tracker(seed, overrides or {}) for setting in settings]
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
    errors = center_errors(boxes, scene.target_boxes)
    touch = int(np.argmax(overlap(scene.target_boxes, scene.other_boxes) > 0.0))
    return [
        Run(
            setting=setting.name,
            seed=seed,
            outcome=outcome(boxes[run], scene.target_boxes, scene.other_boxes),
            errors=errors[run],
            error_before=float(np.median(errors[run, touch - SECOND : touch])),
            jitter=jitter(boxes[run], scene.target_boxes),
            milliseconds=1000.0 * float(np.median(seconds[run])),
            snapshots=tuple(snapshots[run]),
        )
        for run, setting in enumerate(settings)
    ]


def run_all(seeds: Sequence[int], overrides: Mapping[str, Any], jobs: int) -> list[Run]:
    """Run all settings on the scenes of all seeds, with a progress bar.

    Args:
        seeds: Seeds of the scenes and trackers.
        overrides: Parameters that override those of preset and setting.
        jobs: Number of processes.

    Returns:
        The runs in the order of the seeds, then of the settings.
    """
    runs: list[Run] = []
    with progress_bar(len(seeds), "scenes") as on_progress:
        for scene_runs in _scenes(seeds, overrides, jobs):
            runs += scene_runs
            on_progress("", 1)
    names = [setting.name for setting in SETTINGS]
    return sorted(runs, key=lambda run: (run.seed, names.index(run.setting)))


def _scenes(seeds: Sequence[int], overrides: Mapping[str, Any], jobs: int) -> Iterator[list[Run]]:
    if jobs == 1:
        yield from (run_scene(seed, overrides) for seed in seeds)
        return
    with closing(run_parallel(partial(run_scene, overrides=overrides), seeds, jobs)) as results:
        for number, result in results:
            if isinstance(result, WorkerEnded):
                sys.exit(f"umbrellas.py: error: scene {seeds[number]}: {result.reason}")
            yield result


def _longest_stretch(flags: NDArray[np.bool_]) -> int:
    """Length of the longest run of true values."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return int(np.max(ends[1::2] - ends[::2], initial=0))


def _parameter(text: str) -> tuple[str, Any]:
    name, separator, value = text.partition("=")
    if not separator:
        raise argparse.ArgumentTypeError(f"'{text}'; allowed: NAME=VALUE")
    for convert in (int, float):
        try:
            return name, convert(value)
        except ValueError:
            continue
    return name, value


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the experiment, print the table and write the files."""
    parser = options_of.parser(__doc__)
    options_of.add_seeds(parser, 30, "number of scenes")
    at_least = options_of.at_least
    parser.add_argument("--first-seed", type=at_least(0), default=0, help="of the first scene [0]")
    parser.add_argument("--jobs", type=at_least(1), default=1, help="number of processes [1]")
    options_of.add_folder(parser)
    parser.add_argument(
        "--parameter",
        type=_parameter,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="override a parameter of preset and setting; may be repeated",
    )
    options = parser.parse_args(arguments)
    overrides = dict(options.parameter)
    try:
        for setting in SETTINGS:
            setting.tracker(0, overrides)
        options.output.mkdir(parents=True, exist_ok=True)
    except (ValueError, OSError) as error:
        parser.error(str(error))
    started = time.monotonic()
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    runs = run_all(seeds, overrides, options.jobs)
    print_table(runs)
    write_table(options.output / "umbrellas.md", runs, overrides)
    write_frames(options.output / "umbrellas_frames.png", runs)
    print(f"{time.monotonic() - started:.0f} s; files in {options.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
