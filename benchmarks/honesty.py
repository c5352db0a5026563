r"""False tracking: does a preset report "tracking" without the target?

The footage is made of sequences:

1. the illumination changes in the middle;
2. a cut to another scene without the target;
3. the target leaves for five seconds, over moving backgrounds, alone and next to a distractor;
4. the target is hidden, erased, copied or distorted for 100 frames, in a situation made from the
   sequence's own pixels, between 50 and 75 frames as they were.

    python benchmarks/honesty.py SEQUENCE_DIR... --preset default --seeds 1

Of the color sequences every third one is a scene to cut to, at most 8; at most 12 of the others are
targets. Situations are made of all sequences with the target in 60 frames in a row, played back and
forth where they are short. It writes honesty.md and honesty.csv (a line for each run).
"""

from __future__ import annotations

import csv
import math
import multiprocessing
import sys
from collections.abc import Callable, Collection, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import arguments as options_of
import cv2
import numpy as np
from honesty_footage import (
    Clip,
    GainOverTime,
    Image,
    beside_its_like,
    cut,
    departure,
    flicker,
    ramp,
    relight,
    same_place,
    step,
)
from honesty_situations import SITUATIONS
from numpy.typing import NDArray
from tables import Table

from pf_tracker_ros import Tracker
from pf_tracker_ros.evaluation import (
    EvaluationError,
    find_sequences,
    has_target,
    overlap,
    read_sequences,
)

LIGHTS: dict[str, GainOverTime] = {
    "as it is": step(1.0),
    "half from one frame on": step(0.5),
    "1.7 times from one frame on": step(1.7),
    "down to half in 2 s": ramp(0.5, 2.0),
    "up to 1.7 times in 2 s": ramp(1.7, 2.0),
    "10 Hz, 30 % up and down": flicker(0.3, 10.0),
}
TARGETS, SCENES, BACKGROUNDS = 12, 8, 2
BEFORE_CUT, AFTER_CUT = 50, 100
# Frames of a background, played back and forth.
MOST_BACKGROUND = 100
# Seconds in view, gone, and in view again; seconds between frames.
DEPARTURE, INTERVAL = (3.0, 5.0, 4.0), 0.04
DEPARTURES = {"alone": departure, "from beside its like": beside_its_like}
SURE_ABOVE = 0.5
# Tolerated frames on another object, and seconds within which the target must be found again.
MOST_WRONG, BACK_WITHIN = 10, 2.0
RIGHT_ABOVE = 0.5
# Frames before a situation, in it, and after it; least frames of a sequence.
BEFORE, DURING, AFTER, LEAST_FRAMES = 50, 100, 75, 60
# Overlap with the target below which a box is on something else.
WRONG_BELOW = 0.1
PARTS = ("light", "cut", "gone")


@dataclass(frozen=True)
class TrackerTrace:
    """A tracker's output for F frames, without the first."""

    boxes: NDArray[np.float64]  # (F, 4), pixels
    is_tracking: NDArray[np.bool_]  # (F,) whether the state was tracking
    confidence: NDArray[np.float64]  # (F,) 0 to 1

    @property
    def is_sure(self) -> NDArray[np.bool_]:
        """(F,) whether it reported tracking with some confidence."""
        return self.is_tracking & (self.confidence > SURE_ABOVE)


@dataclass(frozen=True)
class Run:
    """One figure of one run."""

    kind: str  # kind of footage
    name: str  # name of the footage
    seed: int  # seed of the tracker
    # overlap after the light changed, frames in which it was sure after the cut, while the target
    # was gone, or of something else in a situation
    figure: float
    # time until the target was tracked again; NaN if not measured, infinite for never
    seconds: float = math.nan
    is_apart: bool = False  # whether the other scene is the place of the target itself
    # share of the frames of a situation that are called tracking on something else
    share: float = math.nan


def trace(
    preset: str, seed: int, images: Iterable[Image], box: NDArray[np.float64], interval: float
) -> TrackerTrace:
    """A preset's output for the images after the first."""
    cv2.setNumThreads(1)
    tracker = Tracker.from_preset(preset, seed)
    estimates = []
    for image in images:
        if tracker.started:
            estimates.append(tracker.update(image, interval))
        else:
            tracker.start(image, box)
    return TrackerTrace(
        np.array([one.box for one in estimates]),
        np.array([one.state == "tracking" for one in estimates]),
        np.array([one.confidence for one in estimates]),
    )


def in_light(preset: str, seed: int, folder: Path, kind: str) -> Run:
    """Mean overlap in the second half of a sequence, with changed illumination."""
    clip = read(folder)
    answer = trace(preset, seed, relight(clip, LIGHTS[kind]), clip.boxes[0], clip.interval)
    middle = len(clip.images) // 2
    boxes, true_boxes = answer.boxes[middle - 1 :], clip.boxes[middle:]
    known = has_target(true_boxes)
    return Run(kind, clip.name, seed, float(overlap(boxes[known], true_boxes[known]).mean()))


def after_cut(preset: str, seed: int, folder: Path, scene_folder: Path) -> Run:
    """Number of frames of another scene with the target reported as tracked."""
    clip, scene = read(folder, BEFORE_CUT), read(scene_folder, AFTER_CUT)
    images = cut(clip, scene, AFTER_CUT)
    answer = trace(preset, seed, images, clip.boxes[0], clip.interval)
    count = int(answer.is_sure[-AFTER_CUT:].sum())
    name = f"{clip.name} to {scene.name}"
    return Run("cut", name, seed, count, is_apart=same_place(clip, scene))


def away(preset: str, seed: int, folder: Path, background_folder: Path, kind: str) -> Run:
    """Frames with an absent target reported as tracked, and time until it is found again."""
    clip, background = read(folder, 1), read(background_folder, MOST_BACKGROUND)
    shown = DEPARTURES[kind](clip, background, DEPARTURE, INTERVAL)
    answer = trace(preset, seed, shown.images, shown.boxes[0], INTERVAL)
    true_boxes = shown.boxes[1:]
    is_there = has_target(true_boxes)
    gone = np.flatnonzero(~is_there)
    later = np.arange(gone[-1] + 1, len(true_boxes))
    in_full = later[true_boxes[later, 0] >= 0.0][0]
    is_right = overlap(answer.boxes[later], true_boxes[later]) > RIGHT_ABOVE
    back = later[is_right & answer.is_tracking[later]]
    seconds = max(float(back[0] - in_full) * INTERVAL, 0.0) if len(back) else math.inf
    return Run(kind, shown.name, seed, int(answer.is_sure[gone].sum()), seconds)


def in_situation(preset: str, seed: int, folder: Path, kind: str) -> Run | None:
    """What is called tracking in a situation, and the time until the target is found after it.

    None where the sequence is too short, or the situation not possible in it.
    """
    clip = read_with_target(folder)
    shown = clip and SITUATIONS[kind](clip, BEFORE, BEFORE + DURING)
    if shown is None:
        return None
    answer = trace(preset, seed, shown.images, shown.boxes[0], shown.interval)
    overlaps = np.zeros(len(answer.boxes))
    known = has_target(shown.boxes[1:])
    overlaps[known] = overlap(answer.boxes[known], shown.boxes[1:][known])
    is_wrong = overlaps < WRONG_BELOW
    during, after = np.s_[BEFORE - 1 : -AFTER], np.s_[-AFTER:]
    back = np.flatnonzero(answer.is_tracking[after] & (overlaps[after] > RIGHT_ABOVE))
    return Run(
        kind,
        shown.name,
        seed,
        int((answer.is_sure & is_wrong)[during].sum()),
        float(back[0] * shown.interval) if len(back) else math.inf,
        share=float((answer.is_tracking & is_wrong)[during].mean()),
    )


@lru_cache(maxsize=1)
def read_with_target(folder: Path) -> Clip | None:
    """Part of the sequence in a folder with the target in each frame; None if too short."""
    footage = read_sequences([folder])[0]
    return Clip.with_target(footage, BEFORE + DURING + AFTER, LEAST_FRAMES)


@lru_cache(maxsize=2)
def read(folder: Path, frames: int | None = None) -> Clip:
    """The sequence in a folder, or its first frames."""
    return Clip.of(read_sequences([folder])[0], frames)


def measured(
    preset: str, seeds: int, folders: Sequence[Path], processes: int, parts: Collection[str]
) -> list[Run]:
    """All runs of some parts.

    Args:
        preset: Preset of the tracker.
        seeds: Number of seeds.
        folders: Folders of sequences.
        processes: Number of processes.
        parts: Of `PARTS`, on color sequences, and names of situations, on all.

    Raises:
        EvaluationError: There are not two color sequences.
    """
    situations = [kind for kind in SITUATIONS if kind in parts]
    jobs: list[tuple[Callable[..., Run | None], Iterable[tuple[Any, ...]]]] = [
        (in_situation, product(folders, situations))
    ]
    if not set(PARTS).isdisjoint(parts):
        jobs += jobs_in_color(folders, parts)
    # A process forked while OpenCV has threads would wait for them forever.
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
        results = [
            pool.submit(job, preset, seed, *of)
            for job, each in jobs
            for of in each
            for seed in range(seeds)
        ]
        runs = [result.result() for result in results]
    return [run for run in runs if run is not None]


def jobs_in_color(
    folders: Sequence[Path], parts: Collection[str]
) -> list[tuple[Callable[..., Run], Iterable[tuple[Any, ...]]]]:
    """The functions for the parts in `PARTS`, and the arguments for each of their runs.

    Raises:
        EvaluationError: There are not two color sequences.
    """
    starts = {folder: read(folder, MOST_BACKGROUND) for folder in folders}
    colored = [folder for folder, start in starts.items() if start.is_colored]
    scenes = colored[::3][:SCENES]
    targets = [folder for folder in colored if folder not in scenes][:TARGETS]
    if not targets:
        raise EvaluationError("fewer than two sequences with colors: a target and another scene")
    backgrounds = sorted(scenes, key=lambda folder: -starts[folder].motion)[:BACKGROUNDS]
    jobs: dict[str, tuple[Callable[..., Run], Iterable[tuple[Any, ...]]]] = {
        "light": (in_light, product(colored, LIGHTS)),
        "cut": (after_cut, product(targets, scenes)),
        "gone": (away, product(targets, backgrounds, DEPARTURES)),
    }
    return [jobs[part] for part in PARTS if part in parts]


def light_table(runs: Sequence[Run]) -> Table:
    """Mean overlap with changed illumination, compared with unchanged."""
    by_kind = {
        kind: {(run.name, run.seed): run.figure for run in runs if run.kind == kind}
        for kind in LIGHTS
    }
    plain = by_kind["as it is"]
    rows = []
    for kind, figures in by_kind.items():
        changes = {one: figures[one] - plain[one] for one in figures}
        worst = min(changes, key=lambda one: changes[one])
        rows.append(
            [
                kind,
                worst[0],
                f"{np.mean(list(figures.values())):.3f}",
                f"{np.mean(list(changes.values())):+.3f}",
                f"{changes[worst]:+.3f}",
            ]
        )
    headings = ("light", "worst sequence", "mean overlap after", "change", "of the worst")
    return Table("GainOverTime that changes", headings, [rows], names=2)


def cut_table(runs: Sequence[Run]) -> Table:
    """How often something in another scene is reported as the target."""
    rows = []
    for name, is_apart in (("other places", False), ("the same place at another time", True)):
        pairs = [run for run in runs if run.kind == "cut" and run.is_apart == is_apart]
        if not pairs:
            continue
        counts = np.array([run.figure for run in pairs])
        longest = sorted(pairs, key=lambda run: -run.figure)[:3]
        named = ", ".join(f"{run.name} {run.figure:.0f}" for run in longest if run.figure)
        share = counts.sum() / (AFTER_CUT * len(pairs))
        rows.append([name, named or "-", str(len(pairs)), f"{share:.1%}"])
    title = f"Cut to another scene, {AFTER_CUT} frames: tracking above {SURE_ABOVE}"
    return Table(title, ("scenes", "most frames", "runs", "share of the frames"), [rows], names=2)


def away_table(runs: Sequence[Run]) -> Table:
    """Whether an absent target is reported as lost, and found again."""
    rows = []
    for kind in DEPARTURES:
        gone = [run for run in runs if run.kind == kind]
        wrong = [run.name for run in gone if run.figure > MOST_WRONG]
        back = [run.name for run in gone if run.seconds <= BACK_WITHIN]
        rows.append([kind, *(str(len(each)) for each in (gone, wrong, back))])
    headings = (
        "gone",
        "runs",
        f"something else tracked for more than {MOST_WRONG} frames",
        f"back within {BACK_WITHIN:g} s",
    )
    return Table(f"A target that is gone for {DEPARTURE[1]:g} s", headings, [rows])


def situation_table(runs: Sequence[Run]) -> Table:
    """What is called tracking in each situation."""
    rows = []
    for kind in SITUATIONS:
        of_kind = [run for run in runs if run.kind == kind]
        if of_kind:
            bold = sum(run.figure > MOST_WRONG for run in of_kind)
            back = sum(run.seconds <= BACK_WITHIN for run in of_kind)
            share = np.mean([run.share for run in of_kind])
            rows.append([kind, str(len(of_kind)), f"{share:.1%}", str(bold), str(back)])
    headings = (
        "situation",
        "runs",
        "something else called tracking",
        f"for more than {MOST_WRONG} frames above {SURE_ABOVE}",
        f"back within {BACK_WITHIN:g} s",
    )
    return Table("Situations made from the sequences' own pixels", headings, [rows])


def tables_of(runs: Sequence[Run]) -> list[Table]:
    """A table for each part that was measured."""
    kinds = {run.kind for run in runs}
    parts = (
        (LIGHTS, light_table),
        (("cut",), cut_table),
        (DEPARTURES, away_table),
        (SITUATIONS, situation_table),
    )
    return [make_table(runs) for of_part, make_table in parts if not kinds.isdisjoint(of_part)]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables and write the files."""
    parser = options_of.sequence_parser(__doc__, seeds=1)
    options_of.add_preset(parser)
    parser.add_argument(
        "--processes", type=options_of.at_least(1), default=1, metavar="N", help="in parallel [1]"
    )
    parser.add_argument(
        "--only",
        action="append",
        choices=(*PARTS, *SITUATIONS),
        metavar="PART",
        help=f"{', '.join(PARTS)} or the name of a situation in the table; may be repeated [all]",
    )
    options = parser.parse_args(arguments)
    with options_of.told_errors(parser):
        Tracker.from_preset(options.preset)
        folders = find_sequences(options.sequences)
        options.output.mkdir(parents=True, exist_ok=True)
        parts = options.only or (*PARTS, *SITUATIONS)
        runs = measured(options.preset, options.seeds, folders, options.processes, parts)
        tables = tables_of(runs)
        lines = [f"# Honesty of preset {options.preset}", ""]
        for table in tables:
            table.show()
            lines += [f"## {table.title}", "", *table.markdown(), ""]
        (options.output / "honesty.md").write_text("\n".join(lines), encoding="utf-8")
        with (options.output / "honesty.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["kind", "footage", "seed", "figure", "seconds", "share"])
            writer.writerows(
                [run.kind, run.name, run.seed, run.figure, run.seconds, run.share] for run in runs
            )
    print(f"files in {options.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
