"""CPU time of an update of one target.

One thread, medians of calls that alternate in one process, so that other load slows all of them.
Quote the ratios.

    python benchmarks/frame_cost.py

Every preset by number of particles, side of the box, size and kind of the image; and the 99th
percentile of `default` over its median, on a target that moves.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import median

import arguments as options_of
import cv2
import numpy as np
from numpy.typing import NDArray
from rich.progress import track
from tables import Table

from pf_tracker_ros import Tracker
from pf_tracker_ros.tracking.presets import PRESETS

PARTICLES = (30, 100, 300, 1000, 3000, 10_000)
SIDES = (20, 40, 80, 120, 200)
# The first frames build tables and learn the target.
_WARM_UP, _CALLS, _STEPS = 30, 6, 30


@dataclass(frozen=True)
class Setting:
    """An image that stands still, with a target in the middle."""

    size: tuple[int, int] = (768, 576)  # (width, height) of the image, pixels
    side: int = 40  # of the target, pixels
    particles: int = 200  # their number
    kind: str = "color"  # of the image: color, gray or 16 bit

    @property
    def image(self) -> NDArray[np.generic]:
        """(H, W, 3) or (H, W)."""
        image = street(*self.size)
        if self.kind == "color":
            return image
        gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return gray if self.kind == "gray" else gray.astype(np.uint16) * 16 + 5000

    @property
    def box(self) -> tuple[int, int, int, int]:
        """The target's, whole pixels."""
        width, height = self.size
        return (width - self.side) // 2, (height - self.side) // 2, self.side, self.side


def street(width: int, height: int, seed: int = 1) -> NDArray[np.uint8]:
    """A textured color image, with details of the same sizes in pixels however large it is."""
    generator = np.random.default_rng(seed)
    image = np.zeros((height, width, 3), np.float32)
    for pixels in (128, 32, 8):
        cells = -(-height // pixels), -(-width // pixels), 3
        noise = generator.uniform(0, 255 / 3, cells).astype(np.float32)
        image += cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.clip(image + generator.normal(0, 3, image.shape), 0, 255).astype(np.uint8)


def started(preset: str, setting: Setting) -> Tracker:
    """A tracker past its first frames."""
    # As probable as any: a still image would else draw the particles together.
    values = {"track.wrong_box_cost": 0.0, "particles": setting.particles}
    tracker = Tracker.from_preset(preset, seed=0, parameters=values)
    image = setting.image
    tracker.start(image, setting.box)
    for _ in range(_WARM_UP):
        tracker.update(image)
    return tracker


def by_turns(calls: Sequence[Callable[[], object]], turns: int) -> list[float]:
    """Median milliseconds of CPU time of each call.

    The first call of a turn finds the caches full of the others' data and is not counted.
    """
    found: list[list[float]] = [[] for _ in calls]
    for _ in range(turns):
        for call, times in zip(calls, found, strict=True):
            times.extend(each_call(call, _CALLS)[1:])
    return [median(times) for times in found]


def each_call(call: Callable[[], object], count: int) -> list[float]:
    """Milliseconds of CPU time of each of some calls."""
    times = []
    for _ in range(count):
        began = time.process_time()
        call()
        times.append(1e3 * (time.process_time() - began))
    return times


def update_tables(turns: int) -> list[Table]:
    """The presets' updates by particles, box and image."""
    usual = Setting()
    axes = {
        "particles": {str(count): replace(usual, particles=count) for count in PARTICLES},
        "box, px": {str(side): replace(usual, side=side) for side in SIDES},
        "image": {
            "320x240": replace(usual, size=(320, 240)),
            "768x576": usual,
            "1920x1080": replace(usual, size=(1920, 1080)),
            "gray, 768x576": replace(usual, kind="gray"),
            "16 bit, 768x576": replace(usual, kind="16 bit"),
        },
    }
    tables = []
    for axis, settings in axes.items():
        rows = []
        for preset in track(PRESETS, f"by {axis}", transient=True):
            calls = []
            for setting in settings.values():
                tracker, image = started(preset, setting), setting.image
                calls.append(lambda tracker=tracker, image=image: tracker.update(image))
            rows.append([preset, *(f"{cost:.1f}" for cost in by_turns(calls, turns))])
        tables.append(Table(f"CPU ms of an update by {axis}", [axis, *settings], rows))
    return tables


def tail_table(turns: int) -> Table:
    """The slowest updates of `default` on a target that goes left and right."""
    setting = Setting()
    x, y, side, _ = setting.box
    target = street(side, side, seed=2) // 2 + 128
    images = []
    for step in [*range(_STEPS), *range(_STEPS - 2, 0, -1)]:
        image = setting.image.copy()
        image[y : y + side, x + 3 * step : x + 3 * step + side] = target
        images.append(image)
    tracker = Tracker.from_preset("default", seed=0)
    tracker.start(images[0], setting.box)
    times = []
    for number in range(1, 60 * (turns + 1)):
        times += each_call(lambda: tracker.update(images[number % len(images)]), 1)  # noqa: B023
    usual, slowest = np.percentile(times[59:], [50, 99])
    row = [f"{usual:.1f}", f"{slowest:.1f}", f"{slowest / usual:.1f}"]
    return Table("default, a moving target, CPU ms", ["median", "99 %", "ratio"], [row], 0)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print the tables."""
    parser = options_of.parser(__doc__)
    parser.add_argument(
        "--turns", type=options_of.at_least(1), default=10, help="of each comparison [10]"
    )
    turns = parser.parse_args(arguments).turns
    cv2.setNumThreads(1)
    for table in (*update_tables(turns), tail_table(turns)):
        table.show()


if __name__ == "__main__":
    main()
