"""The ratios of the library's costs that have limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from limits import Limit

from kernel_stages.li2007 import measure_li2007
from kernel_stages.setting import SIDES, Setting, street
from kernel_stages.stages import update
from kernel_stages.timing import by_turns, each_call
from pf_tracker_ros import Tracker

# Updates whose slowest hundredth is told.
_UPDATES = 600
_WARM_UP = 60
_STEPS = 30


def measure_limits(turns: int) -> list[Limit]:
    """Measure all of them."""
    many, few, most = (
        measure_li2007(particles, 40, "8 px", turns, against_loop=particles <= 1000)
        for particles in (1000, 60, 10_000)
    )
    assert many.ratio
    assert few.ratio
    deep, shallow = _updates("zhang2015", [Setting(kind="16 bit"), Setting(kind="gray")], turns)
    large, small = _updates(
        "default", [Setting(size=(1920, 1080)), Setting(size=(640, 480))], turns
    )
    sides = _updates("default", [Setting(side=side) for side in SIDES], turns)
    times = np.array(each_call(_moving_target(), _UPDATES))
    tail = float(np.percentile(times, 99) / np.median(times))
    return [
        Limit("li2007, N = 1000: loop over particles / update", many.ratio, 15.0, is_least=True),
        Limit("li2007, N = 60: loop over particles / update", few.ratio, 6.0, is_least=True),
        Limit("li2007: N = 10,000 / N = 1000", most.update / many.update, 8.0),
        Limit("zhang2015: 16 bit / 8 bit", deep / shallow, 1.3),
        Limit("default: 99th percentile / median", tail, 2.0),
        Limit("default, the same box: 1920x1080 / 640x480", large / small, 1.2),
        Limit("default: dearest / cheapest box of 20 to 200 px", max(sides) / min(sides), 1.5),
    ]


def _updates(preset: str, settings: Sequence[Setting], turns: int) -> list[float]:
    """Milliseconds of an update in each setting, with the preset's number of particles."""
    return by_turns([update(preset, setting) for setting in settings], turns)


def _moving_target() -> object:
    """What follows a target that goes left and right one frame further."""
    setting = replace(Setting(), side=40)
    target = street(40, 40, seed=2) // 2 + 128
    x, y = setting.box[:2].astype(int)
    images = []
    for step in [*range(_STEPS), *range(_STEPS - 2, 0, -1)]:
        image = setting.image.copy()
        image[y : y + 40, x + 3 * step : x + 3 * step + 40] = target
        images.append(image)
    tracker = Tracker.from_preset("default", seed=0)
    tracker.start(images[0], setting.box)
    number = 0

    def follow() -> None:
        nonlocal number
        number += 1
        tracker.update(images[number % len(images)])

    for _ in range(_WARM_UP):
        follow()
    return follow
