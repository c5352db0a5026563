"""CPU time of an update of one target, and its ratio to a loop over particles.

One thread, medians of calls that alternate in one process, so that other load slows all of them.
Quote the ratios.

    python benchmarks/frame_cost.py --output benchmarks/results/frame_cost.md

`--only` selects a part:

- update: every preset by number of particles, side of the box, size and kind of the image.
- loop: `li2007` against a loop over particles as in tutorials, with `cv2.calcHist`,
  `cv2.compareHist` and a gradient orientation vector.
- tail: the 99th percentile of `default` over its median, on a target that moves.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import median

import arguments as options_of
import cv2
import numpy as np
from arguments import at_least
from numpy.typing import NDArray
from rich.progress import track
from tables import Table, publish

from pf_tracker_ros import Tracker
from pf_tracker_ros.tracking.presets import PRESETS

PARTICLES = (30, 100, 300, 1000, 3000, 10_000)
SIDES = (20, 40, 80, 120, 200)
LOOP_PARTICLES = (60, 1000)
# The first frames build tables and learn the target.
_WARM_UP, _CALLS, _STEPS = 30, 6, 30

# Of the loop: levels of colors, cells on a side and directions.
_RANGES = [0, 256] * 3
_CELLS, _DIRECTIONS = 4, 8


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


def started(preset: str, setting: Setting, **parameters: object) -> Tracker:
    """A tracker past its first frames."""
    # As probable as any: a still image would else draw the particles together.
    values = {"track.wrong_box_cost": 0.0, "particles": setting.particles, **parameters}
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
        tables.append(Table(f"CPU ms of an update by {axis}", [axis, *settings], [rows]))
    return tables


class ParticleLoop:
    """The measurement of Li et al. 2007 for one particle after the other.

    Args:
        image: (H, W, 3) uint8 BGR to take the template from.
        box: (x, y, side, side) of the target in whole pixels.
    """

    def __init__(self, image: NDArray[np.uint8], box: tuple[int, int, int, int]) -> None:
        x, y, side, _ = box
        grid = (np.arange(side) + 0.5) / side - 0.5
        gaussian = np.exp(-0.5 * np.square(grid / 0.5))
        self._gaussian = (gaussian[:, None] * gaussian).astype(np.float32)
        cell = np.arange(side) * _CELLS // side
        self._first_bin = (cell[:, None] * _CELLS + cell) * _DIRECTIONS
        self._side = side
        patch = image[y : y + side, x : x + side]
        self._histogram = self._color(patch)
        self._vector = self._texture(cv2.cvtColor(patch, cv2.COLOR_BGR2GRAY))

    def weights(self, image: NDArray[np.uint8], corners: NDArray[np.intp]) -> NDArray[np.float64]:
        """(N,) normalized weights of boxes with these (N, 2) top-left corners."""
        gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        log_likelihood = np.empty(len(corners))
        side = self._side
        for index, (x, y) in enumerate(corners):
            patch = image[y : y + side, x : x + side]
            distance = cv2.compareHist(
                self._color(patch), self._histogram, cv2.HISTCMP_BHATTACHARYYA
            )
            offset = self._texture(gray[y : y + side, x : x + side]) - self._vector
            log_likelihood[index] = -0.6 * 30.0 * distance**2 - 0.4 * 10.0 * (offset @ offset)
        weights = np.exp(log_likelihood - log_likelihood.max())
        return weights / weights.sum()

    def _color(self, patch: NDArray[np.uint8]) -> NDArray[np.float32]:
        histogram = cv2.calcHist([patch], [0, 1, 2], None, [16, 16, 16], _RANGES)
        return histogram / patch[..., 0].size

    def _texture(self, patch: NDArray[np.uint8]) -> NDArray[np.float64]:
        right = cv2.Sobel(patch, cv2.CV_32F, 1, 0, ksize=1)
        down = cv2.Sobel(patch, cv2.CV_32F, 0, 1, ksize=1)
        magnitude, angle = cv2.cartToPolar(right, down)
        direction = (angle * (_DIRECTIONS / (2 * np.pi))).astype(np.intp) % _DIRECTIONS
        vector = np.bincount(
            (self._first_bin + direction).ravel(),
            (magnitude * self._gaussian).ravel(),
            _CELLS**2 * _DIRECTIONS,
        )
        return vector / max(float(np.linalg.norm(vector)), 1e-9)


def loop_tables(turns: int) -> list[Table]:
    """`li2007` and the same measurement, particle by particle."""
    rows = []
    for particles in LOOP_PARTICLES:
        setting = Setting(particles=particles)
        image, side = setting.image, setting.side
        tracker = started("li2007", setting, **{"motion.position_noise": 1.0})
        loop = ParticleLoop(image, setting.box)

        def weigh(tracker=tracker, loop=loop, image=image, side=side) -> object:
            corners = np.rint(tracker.estimate.particle_boxes[:, :2]).astype(np.intp)
            height, width = image.shape[:2]
            return loop.weights(image, corners.clip(0, (width - side, height - side)))

        update, slow = by_turns([lambda t=tracker, i=image: t.update(i), weigh], turns)
        rows.append([str(particles), f"{update:.2f}", f"{slow:.1f}", f"{slow / update:.1f}"])
    headings = ["particles", "update", "loop", "ratio"]
    return [Table("li2007 at 768x576, 40 px, CPU ms", headings, [rows])]


def tail_tables(turns: int) -> list[Table]:
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
    return [Table("default, a moving target, CPU ms", ["median", "99 %", "ratio"], [[row]], 0)]


PARTS = {"update": update_tables, "loop": loop_tables, "tail": tail_tables}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables and optionally save them.

    Args:
        arguments: Command line without program name; None for the process'.
    """
    parser = options_of.parts_parser(__doc__, PARTS)
    parser.add_argument("--turns", type=at_least(1), default=10, help="of each comparison [10]")
    given = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    tables = [table for part in given.only or PARTS for table in PARTS[part](given.turns)]
    publish(given.output, tables)
    return 0


if __name__ == "__main__":
    sys.exit(main())
