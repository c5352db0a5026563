"""One `update` of `li2007` against the same measurement made particle by particle.

The opponent is what tutorials do: for every particle `cv2.calcHist` and `cv2.compareHist` on its
patch, and a gradient orientation vector of the patch by OpenCV and one `np.bincount`. Both run in
the same process on one thread, some calls of the one and some of the other in turn, so that a busy
machine slows both; the figure to quote is the ratio.

    python benchmarks/kernels.py --output benchmarks/results/kernels.md
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

# One thread also for the linear algebra, which reads this when NumPy is imported.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from pf_tracker_ros import Tracker

WIDTH, HEIGHT = 768, 576
RANGES = [0, 256] * 3
CELLS, DIRECTIONS = 4, 8
# The first call of a turn finds the caches full of the other's data and is not counted.
CALLS_IN_A_TURN = 6


@dataclass(frozen=True)
class Row:
    """Median milliseconds of one setting."""

    particles: int
    side: int
    cloud: str
    update: float
    loop: float | None


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
        cell = np.arange(side) * CELLS // side
        self._first_bin = (cell[:, None] * CELLS + cell) * DIRECTIONS
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
        histogram = cv2.calcHist([patch], [0, 1, 2], None, [16, 16, 16], RANGES)
        return histogram / patch[..., 0].size

    def _texture(self, patch: NDArray[np.uint8]) -> NDArray[np.float64]:
        right = cv2.Sobel(patch, cv2.CV_32F, 1, 0, ksize=1)
        down = cv2.Sobel(patch, cv2.CV_32F, 0, 1, ksize=1)
        magnitude, angle = cv2.cartToPolar(right, down)
        direction = (angle * (DIRECTIONS / (2 * np.pi))).astype(np.intp) % DIRECTIONS
        vector = np.bincount(
            (self._first_bin + direction).ravel(),
            (magnitude * self._gaussian).ravel(),
            CELLS**2 * DIRECTIONS,
        )
        return vector / max(float(np.linalg.norm(vector)), 1e-9)


def milliseconds(call: Callable[[], object]) -> float:
    """CPU time of one call."""
    start = time.process_time()
    call()
    return 1000 * (time.process_time() - start)


def street(seed: int) -> NDArray[np.uint8]:
    """A textured color image of the paper's size."""
    generator = np.random.default_rng(seed)
    image = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    for cells in (6, 24, 96):
        noise = generator.uniform(0, 255 / 3, (cells * 3 // 4, cells, 3)).astype(np.float32)
        image += cv2.resize(noise, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    return np.clip(image + generator.normal(0, 3, image.shape), 0, 255).astype(np.uint8)


def measure(particles: int, side: int, scattered: bool, repeats: int, against_loop: bool) -> Row:
    """Time one setting; the target stands still, and so does the cloud around it."""
    image = street(seed=1)
    x, y = (WIDTH - side) // 2, (HEIGHT - side) // 2
    # Noise of this size spreads the particles over the whole image.
    noise = {"motion.position_noise": 50.0} if scattered else {}
    parameters = {"particles": particles, "track.occluded_below": 0.0} | noise
    tracker = Tracker.from_preset("li2007", seed=0, parameters=parameters)
    tracker.start(image, (x, y, side, side))
    loop = ParticleLoop(image, (x, y, side, side))
    updates, loops = [], []
    for _ in range(repeats):
        turn = [milliseconds(lambda: tracker.update(image)) for _ in range(CALLS_IN_A_TURN)]
        updates += turn[1:]
        if against_loop:
            estimate = tracker.estimate
            assert estimate is not None
            corners = np.rint(estimate.particle_boxes[:, :2]).astype(np.intp)
            corners = np.clip(corners, 0, (WIDTH - side, HEIGHT - side))
            turn = [
                milliseconds(lambda at=corners: loop.weights(image, at))
                for _ in range(CALLS_IN_A_TURN)
            ]
            loops += turn[1:]
    return Row(
        particles,
        side,
        "whole image" if scattered else "on the target",
        statistics.median(updates),
        statistics.median(loops) if loops else None,
    )


def table(rows: list[Row]) -> Table:
    """All settings; cost per particle is what N = 1000 costs more than N = 60, by 940."""
    result = Table(title=f"One update of li2007 at {WIDTH} x {HEIGHT}, CPU ms, one thread, median")
    for heading in ("N", "box", "particles", "update", "loop", "ratio", "us per further particle"):
        result.add_column(heading, justify="right")
    base = {(row.side, row.cloud): row.update for row in rows if row.particles == 60}
    for row in rows:
        further = ""
        if row.particles > 60:
            more = row.update - base[row.side, row.cloud]
            further = f"{1000 * more / (row.particles - 60):.1f}"
        result.add_row(
            str(row.particles),
            f"{row.side} px",
            row.cloud,
            f"{row.update:.2f}",
            f"{row.loop:.1f}" if row.loop else "",
            f"{row.loop / row.update:.1f}" if row.loop else "",
            further,
        )
    return result


def main() -> int:
    """Measure, print the table and, if asked to, save it."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--repeats", type=int, default=10, help="turns timed for each setting")
    parser.add_argument("--output", type=Path, help="text file for the table")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    rows = [
        measure(particles, side, scattered, arguments.repeats, side == 40)
        for side in (20, 40, 80, 160)
        for scattered in (False, True)
        for particles in (60, 1000)
    ]
    Console().print(table(rows))
    if arguments.output:
        arguments.output.parent.mkdir(parents=True, exist_ok=True)
        with arguments.output.open("w") as file:
            Console(file=file, width=100).print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
