"""Runs of the package's tracker of which every estimate is kept."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import cv2
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros import Estimate, Tracker
from pf_tracker_ros.footage import Footage
from pf_tracker_ros.stamps import NANOSECONDS


def timed_images(footage: Footage) -> Iterator[tuple[NDArray[Any], float]]:
    """The images of a sequence, each with the seconds since the last one."""
    last = 0
    for frame in footage.frames():
        yield frame.image, (frame.stamp - last) / NANOSECONDS
        last = frame.stamp


def estimates_of(
    preset: str,
    seed: int,
    images: Iterable[tuple[NDArray[Any], float]],
    box: ArrayLike,
    parameters: Mapping[str, Any] | None = None,
) -> list[Estimate]:
    """The estimates of a preset in the images after the first, which has the given box."""
    cv2.setNumThreads(1)
    tracker = Tracker.from_preset(preset, seed, parameters)
    estimates = []
    for image, interval in images:
        if tracker.started:
            estimates.append(tracker.update(image, interval))
        else:
            tracker.start(image, box)
    return estimates
