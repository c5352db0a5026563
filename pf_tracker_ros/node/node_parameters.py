"""The parameters of the tracker node that are not tunables of the tracker."""

from __future__ import annotations

from dataclasses import dataclass

from pf_tracker_ros.parameters import declared
from pf_tracker_ros.tracking.presets import PRESETS


@dataclass(frozen=True)
class NodeParameters:
    """Which tracker the node runs, on what, and how it takes its images."""

    preset: str = declared(
        "default",
        "Preset that gives the tracker's tunables their defaults.",
        choices=tuple(PRESETS),
        read_only=True,
    )
    seed: int = declared(
        0,
        "Seeds all randomness: the same frames, target and seed give the same boxes. A change "
        "takes effect with the next target.",
        minimum=0,
        maximum=2**31 - 1,
    )
    target_box: tuple[float, ...] = declared(
        (),
        "Box (x, y, width, height) to track from the next frame on; empty waits for a target on "
        "the topic ~/target.",
        unit="px",
        minimum=-100_000.0,
        maximum=100_000.0,
        lengths=(0, 4),
    )
    image_reliability: str = declared(
        "best_effort",
        "Reliability asked of the image publisher: best_effort takes the newest frame and may "
        "lose others; reliable takes every frame, but gets none from a best-effort publisher.",
        choices=("best_effort", "reliable"),
    )
