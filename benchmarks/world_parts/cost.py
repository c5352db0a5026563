"""CPU time of a position."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping

import numpy as np
from tables import Table

from pf_tracker_ros.progress import OnProgress
from pf_tracker_ros.world import CameraModel, Localizer


def cost_table(on_progress: OnProgress) -> Table:
    """CPU time of one position, the least of some rounds."""
    generator = np.random.default_rng(0)
    depth = np.full((480, 640), 4000, np.uint16)
    depth[150:400, 280:360] = 3000
    depth[generator.random(depth.shape) < 0.3] = 0
    image = generator.integers(0, 255, (480, 640, 3), np.uint8)
    # No two calls have the same box, of which something could be kept.
    boxes = itertools.cycle([(270.0, 140.0, 100.0, 270.0), (271.0, 140.0, 100.0, 270.0)])
    cases: Mapping[str, Mapping[str, object]] = {
        "box alone": {},
        "with depth": {"depth": depth},
        "with depth and a map of the target": {
            "depth": depth,
            "target_probability": np.full((32, 16), 0.5),
        },
        "with depth and image": {"depth": depth, "image": image},
    }
    rows = []
    for name, given in cases.items():
        cells = [name]
        for distortion in ((), (-0.3, 0.1, 0.001, 0.001, 0.0)):
            localizer = Localizer(CameraModel(525.0, 525.0, 319.5, 239.5, 640, 480, distortion))
            ms = least_cpu_ms(lambda: localizer.locate(next(boxes), **given))  # noqa: B023
            cells.append(f"{ms:.3f}")
            on_progress("cost", 1)
        rows.append(cells)
    headings = ("640 x 480", "rectified, ms", "plumb_bob, ms")
    return Table("CPU time of a position", headings, rows)


def least_cpu_ms(run: Callable[[], object], rounds: int = 15, count: int = 100) -> float:
    """CPU time in ms of a call, in the fastest of some rounds."""
    best = np.inf
    run()
    for _ in range(rounds):
        start = time.process_time()
        for _ in range(count):
            run()
        best = min(best, (time.process_time() - start) / count)
    return 1000.0 * best
