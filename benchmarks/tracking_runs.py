"""Runs of the package's tracker of which every estimate is kept, and spans of their frames."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pf_tracker_ros import Estimate, Tracker
from pf_tracker_ros.footage import Footage
from pf_tracker_ros.progress import progress_bar
from pf_tracker_ros.stamps import NANOSECONDS


def followed(sequences: Sequence[Footage]) -> Iterator[Footage]:
    """The sequences, with a bar of those that are done."""
    with progress_bar(len(sequences), "sequences") as on_progress:
        for footage in sequences:
            yield footage
            on_progress(footage.name, 1)


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


def spans(flags: Sequence[bool] | NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end (exclusive) of each run of true values."""
    padded = np.concatenate([[False], np.asarray(flags, bool), [False]])
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
