r"""False tracking: is "tracking" reported without the target?

The footage is made of sequences:

1. the illumination changes in the middle;
2. a cut to another scene without the target;
3. the target is hidden, erased, copied or distorted for 100 frames, in a situation made from the
   sequence's own pixels, between 50 and 75 frames as they were.

    python benchmarks/honesty.py SEQUENCE_DIR... --seeds 1

Of the color sequences every third one is a scene to cut to, at most 8; at most 12 of the others are
targets. Situations are made of all sequences with the target in 60 frames in a row, played back and
forth where they are short.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import arguments as options_of
import numpy as np
from honesty_footage import Clip, GainOverTime, Image, cut, ramp, relight, same_place, step
from honesty_situations import SITUATIONS
from numpy.typing import NDArray
from tables import Table
from tracking_runs import estimates_of

from pf_tracker_ros import Estimate
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
}
TARGETS, SCENES = 12, 8
BEFORE_CUT, AFTER_CUT = 50, 100
SURE_ABOVE = 0.5
# Tolerated frames on another object, and seconds within which the target must be found again.
MOST_WRONG, BACK_WITHIN = 10, 2.0
RIGHT_ABOVE = 0.5
# Frames before a situation, in it, and after it; least frames of a sequence.
BEFORE, DURING, AFTER, LEAST_FRAMES = 50, 100, 75, 60
# Overlap with the target below which a box is on something else.
WRONG_BELOW = 0.1
PARTS = ("light", "cut")


@dataclass(frozen=True)
class Run:
    """One figure of one run."""

    kind: str  # of footage
    name: str  # of the footage
    seed: int
    # overlap after the light changed, or frames in which it was sure, after the cut or of something
    # else in a situation
    figure: float
    seconds: float = math.nan  # until the target was tracked again; infinite for never
    share: float = math.nan  # of a situation's frames called tracking on something else


def tracked(seed: int, images: Iterable[Image], clip: Clip) -> list[Estimate]:
    """Estimates of `default` for the images after the first, which has the clip's first box."""
    timed = ((image, clip.interval) for image in images)
    return estimates_of("default", seed, timed, clip.boxes[0])


def is_sure(estimates: Sequence[Estimate]) -> NDArray[np.bool_]:
    """(frames,) whether the state was tracking with some confidence."""
    return np.array([one.state == "tracking" and one.confidence > SURE_ABOVE for one in estimates])


def overlaps(estimates: Sequence[Estimate], true_boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(frames,) overlap of each box with the true one; 0 without a target."""
    found = np.zeros(len(estimates))
    known = has_target(true_boxes)
    found[known] = overlap(np.array([one.box for one in estimates])[known], true_boxes[known])
    return found


def in_light(seed: int, folder: Path, kind: str) -> Run:
    """Mean overlap in the second half of a sequence, with changed illumination."""
    clip = read(folder)
    middle = len(clip.images) // 2
    after = tracked(seed, relight(clip, LIGHTS[kind]), clip)[middle - 1 :]
    true_boxes = clip.boxes[middle:]
    mean = overlaps(after, true_boxes)[has_target(true_boxes)].mean()
    return Run(kind, clip.name, seed, float(mean))


def after_cut(seed: int, folder: Path, scene_folder: Path) -> Run | None:
    """Number of frames of another scene with the target reported as tracked.

    None where the scene is the place of the target itself.
    """
    clip, scene = read(folder, BEFORE_CUT), read(scene_folder, AFTER_CUT)
    if same_place(clip, scene):
        return None
    estimates = tracked(seed, cut(clip, scene, AFTER_CUT), clip)
    count = int(is_sure(estimates[-AFTER_CUT:]).sum())
    return Run("cut", f"{clip.name} to {scene.name}", seed, count)


def in_situation(seed: int, folder: Path, kind: str) -> Run | None:
    """What is called tracking in a situation, and the time until the target is found after it.

    None where the sequence is too short.
    """
    clip = read_with_target(folder)
    if clip is None:
        return None
    shown = SITUATIONS[kind](clip, BEFORE, BEFORE + DURING)
    estimates = tracked(seed, shown.images, shown)
    shared = overlaps(estimates, shown.boxes[1:])
    is_tracking = np.array([one.state == "tracking" for one in estimates])
    is_wrong = shared < WRONG_BELOW
    during, after = np.s_[BEFORE - 1 : -AFTER], np.s_[-AFTER:]
    back = np.flatnonzero(is_tracking[after] & (shared[after] > RIGHT_ABOVE))
    return Run(
        kind,
        shown.name,
        seed,
        int((is_sure(estimates) & is_wrong)[during].sum()),
        float(back[0] * shown.interval) if len(back) else math.inf,
        share=float((is_tracking & is_wrong)[during].mean()),
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


def measured(seed: int, folders: Sequence[Path], parts: Collection[str]) -> Iterator[Run | None]:
    """All runs of some parts: those of `PARTS` on color sequences, and situations on all.

    Raises:
        EvaluationError: There are not two color sequences.
    """
    for folder in folders:
        for kind in (one for one in SITUATIONS if one in parts):
            yield in_situation(seed, folder, kind)
    if set(PARTS).isdisjoint(parts):
        return
    colored = [folder for folder in folders if read(folder, 1).is_colored]
    scenes = colored[::3][:SCENES]
    targets = [folder for folder in colored if folder not in scenes][:TARGETS]
    if not targets:
        raise EvaluationError("fewer than two sequences with colors: a target and another scene")
    for folder in colored if "light" in parts else ():
        for kind in LIGHTS:
            yield in_light(seed, folder, kind)
    for folder in targets if "cut" in parts else ():
        for scene in scenes:
            yield after_cut(seed, folder, scene)


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
        mean, change = np.mean(list(figures.values())), np.mean(list(changes.values()))
        rows.append([kind, worst[0], f"{mean:.3f}", f"{change:+.3f}", f"{changes[worst]:+.3f}"])
    headings = ("light", "worst sequence", "mean overlap after", "change", "of the worst")
    return Table("Light that changes", headings, rows, names=2)


def cut_table(runs: Sequence[Run]) -> Table:
    """How often something in another scene is reported as the target."""
    pairs = [run for run in runs if run.kind == "cut"]
    longest = sorted(pairs, key=lambda run: -run.figure)[:3]
    named = ", ".join(f"{run.name} {run.figure:.0f}" for run in longest if run.figure)
    share = sum(run.figure for run in pairs) / (AFTER_CUT * len(pairs))
    row = [named or "-", str(len(pairs)), f"{share:.1%}"]
    title = f"Cut to another scene, {AFTER_CUT} frames: tracking above {SURE_ABOVE}"
    return Table(title, ("most frames", "runs", "share of the frames"), [row])


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
    headings = ("situation", "runs", "something else called tracking")
    headings += (f"for more than {MOST_WRONG} frames above {SURE_ABOVE}",)
    headings += (f"back within {BACK_WITHIN:g} s",)
    return Table("Situations made from the sequences' own pixels", headings, rows)


def tables_of(runs: Sequence[Run]) -> list[Table]:
    """A table for each part that was measured."""
    kinds = {run.kind for run in runs}
    parts = ((LIGHTS, light_table), (("cut",), cut_table), (SITUATIONS, situation_table))
    return [make_table(runs) for of_part, make_table in parts if not kinds.isdisjoint(of_part)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print the tables."""
    parser = options_of.sequence_parser(__doc__, seeds=1)
    parser.add_argument(
        "--only",
        action="append",
        choices=(*PARTS, *SITUATIONS),
        metavar="PART",
        help=f"{', '.join(PARTS)} or the name of a situation in the table; may be repeated [all]",
    )
    options = parser.parse_args(arguments)
    with options_of.told_errors(parser):
        folders = find_sequences(options.sequences)
        parts = options.only or (*PARTS, *SITUATIONS)
        runs = [
            run
            for seed in range(options.seeds)
            for run in measured(seed, folders, parts)
            if run is not None
        ]
    for table in tables_of(runs):
        table.show()


if __name__ == "__main__":
    main()
