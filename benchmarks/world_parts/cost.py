"""CPU time of a position."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from statistics import fmean

import numpy as np
from frame_cost import each_call
from tables import Table

from pf_tracker_ros.progress import OnProgress
from pf_tracker_ros.world import CameraModel, Localizer

_ROUNDS = 15


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
        "with depth and image": {"depth": depth, "image": image},
    }
    rows = []
    for name, given in cases.items():
        cells = [name]
        for distortion in ((), (-0.3, 0.1, 0.001, 0.001, 0.0)):
            localizer = Localizer(CameraModel(525.0, 525.0, 319.5, 239.5, 640, 480, distortion))
            run = lambda: localizer.locate(next(boxes), **given)  # noqa: B023, E731
            cells.append(f"{min(fmean(each_call(run, 100)) for _ in range(_ROUNDS)):.3f}")
            on_progress("cost", 1)
        rows.append(cells)
    headings = ("640 x 480", "rectified, ms", "plumb_bob, ms")
    return Table("CPU time of a position", headings, rows)
