"""The umbrella experiment of Li, Zhang, Li 2007 (sequence 2), over many generated scenes.

Two umbrellas of similar color and different texture pass each other behind trees. The paper's three
settings of `li2007` run on the same scenes: color alone with 60 particles, color and texture
(alpha = 0.6) with 30 and with 60. The paper's finding: color alone ends on the wrong umbrella;
color and texture stay on the target, with jitter for 30 particles and steadily for 60.

    python benchmarks/umbrellas.py --seeds 30
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import arguments as options_of
import numpy as np
from numpy.typing import NDArray
from scenes import UmbrellaScene
from scenes.scene import FRAME_INTERVAL
from tables import Table
from tracking_runs import estimates_of, spans

from pf_tracker_ros.evaluation.metrics import center_errors, overlap
from pf_tracker_ros.progress import progress_bar

SECOND = 25
"""Frames in one second."""

Boxes = NDArray[np.float64]


def _setting(alpha: float, particles: int) -> Mapping[str, Any]:
    return {
        "particles": particles,
        "color_histogram.weight": alpha,
        "gradient_orientation.weight": 1.0 - alpha,
    }


SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "color alone, N = 60": _setting(1.0, 60),
    "color + texture, N = 30": _setting(0.6, 30),
    "color + texture, N = 60": _setting(0.6, 60),
}
"""Name of an experiment of the paper to its parameters."""


@dataclass(frozen=True)
class Run:
    """Run of a setting on a scene."""

    setting: str  # its name
    outcome: str  # as in `outcome`
    jitter: float  # as in `jitter`, px


def outcome(boxes: Boxes, target: Boxes, other: Boxes) -> str:
    """Outcome of a run after the umbrellas have passed each other, by (frames, 4) boxes.

    "switched": for at least half a second without a break the estimate overlapped the other
    umbrella's box and its center was nearer to the other's center than to the target's; a run that
    comes back later still counts as switched. "held": not switched, and in the last second the
    median center error is at most half a box. "lost": neither.
    """
    apart = center_errors(target, other) > target[:, 2]
    wrong = (center_errors(boxes, other) < center_errors(boxes, target)) & apart
    wrong &= overlap(boxes, other) > 0.0
    wrong[: int(np.argmin(center_errors(target, other)))] = False
    if any(end - begin >= SECOND // 2 for begin, end in spans(wrong)):
        return "switched"
    held = np.median(center_errors(boxes, target)[-SECOND:]) <= target[0, 2] / 2
    return "held" if held else "lost"


def jitter(boxes: Boxes, target: Boxes) -> float:
    """Root mean square of the change of the error vector from frame to frame, px."""
    offsets = (boxes[:, :2] + boxes[:, 2:] / 2) - (target[:, :2] + target[:, 2:] / 2)
    return float(np.sqrt(np.mean(np.sum(np.diff(offsets, axis=0) ** 2, axis=1))))


def run_scene(seed: int) -> list[Run]:
    """Run all settings on the scene of a seed, which is that of the trackers, too."""
    scene = UmbrellaScene(seed)
    target, images = scene.ground_truth, [(image, FRAME_INTERVAL) for image in scene.images]
    runs = []
    for setting, parameters in SETTINGS.items():
        estimates = estimates_of("li2007", seed, images, target[0], parameters)
        boxes = np.array([target[0], *(one.box for one in estimates)])
        judged = outcome(boxes, target, scene.other_boxes)
        runs.append(Run(setting, judged, jitter(boxes, target)))
    return runs


def table(runs: Sequence[Run]) -> Table:
    """A row for each setting; the jitter is the mean over the scenes in which it held."""
    rows = []
    for setting in SETTINGS:
        mine = [run for run in runs if run.setting == setting]
        shaken = [run.jitter for run in mine if run.outcome == "held"]
        counts = [sum(run.outcome == kind for run in mine) for kind in ("switched", "lost", "held")]
        rows.append([setting, *map(str, counts), f"{np.mean(shaken):.2f}" if shaken else "-"])
    headings = ("setting", "switched", "lost", "held", "jitter of held ones px")
    return Table(f"Umbrellas, number of scenes: {len(runs) // len(SETTINGS)}", headings, rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the experiment and print the table."""
    parser = options_of.parser(__doc__)
    options_of.add_seeds(parser, 30, "number of scenes")
    options = parser.parse_args(arguments)
    runs: list[Run] = []
    with progress_bar(options.seeds, "scenes") as on_progress:
        for seed in range(options.seeds):
            runs += run_scene(seed)
            on_progress("", 1)
    table(runs).show()


if __name__ == "__main__":
    main()
