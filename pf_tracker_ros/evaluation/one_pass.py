"""One-pass evaluation: a tracker gets the first true box and has to follow it to the end."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.evaluation.ground_truth import count_mismatch, usable_ground_truth
from pf_tracker_ros.evaluation.results import EvaluationError, FrameDetails, SequenceResult
from pf_tracker_ros.footage import Footage
from pf_tracker_ros.opencv import one_opencv_thread
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.progress import OnProgress
from pf_tracker_ros.stamps import NANOSECONDS

Image = NDArray[Any]


class BoxEstimate(Protocol):
    """What a tracker says of one frame; an `Estimate` is one."""

    @property
    def box(self) -> Box:
        """(x, y, width, height) in pixels; not looked at while the target is lost."""
        ...

    @property
    def state(self) -> str:
        """The word "lost" while the tracker knows that it has no box, any other otherwise."""
        ...


class BoxTracker(Protocol):
    """Whatever can be evaluated: `Tracker`, or an adapter of a few lines around another one."""

    def start(self, image: Image, box: Box, /) -> object:
        """Start on the first frame; the returned value is not looked at."""
        ...

    def update(self, image: Image, dt: float | None, /) -> BoxEstimate:
        """Track into the next frame, `dt` seconds after the last; the image is read-only."""
        ...


TrackerFactory = Callable[[int], BoxTracker]
"""Makes a tracker from a seed, which one without randomness may ignore."""


def evaluate_sequence(
    footage: Footage,
    make_tracker: TrackerFactory,
    seeds: Sequence[int],
    on_progress: OnProgress | None = None,
) -> SequenceResult:
    """Run one tracker for each seed over a sequence, side by side.

    The frames are read once and are not kept, whatever the number of seeds. There are no restarts:
    a tracker that calls the target lost keeps its last box until it finds the target again.

    Times are CPU time of this process during `update`, with OpenCV held to one thread, so a tracker
    that starts threads of its own pays for them.

    Args:
        footage: A sequence with ground truth, its first true box known.
        make_tracker: Called once for each seed.
        seeds: One run each.
        on_progress: Called after each frame.

    Returns:
        The boxes and times of all runs.

    Raises:
        EvaluationError: No seeds; no usable ground truth; another number of frames than of true
            boxes; a tracker that refuses the first box or a frame, or answers with a box that is
            not finite.
        FootageError: A frame cannot be read.
    """
    true_boxes = usable_ground_truth(footage)
    frames = len(true_boxes)
    if not seeds:
        raise EvaluationError("no seeds; allowed: at least one")
    trackers = [make_tracker(seed) for seed in seeds]
    boxes = np.empty((len(seeds), frames, 4))
    lost = np.zeros((len(seeds), frames), dtype=bool)
    cpu_seconds = np.empty((len(seeds), frames - 1))
    told: list[_Told] = []
    done, last_stamp = 0, 0
    with one_opencv_thread():
        for index, frame in enumerate(footage.frames()):
            if index >= frames:
                raise count_mismatch(footage.name, f"more than {counted(frames, 'frame')}", frames)
            # The trackers share the image: one that drew into it would change what the next sees.
            image = frame.image.view()
            image.flags.writeable = False
            _wait_for_other_threads()
            for run, tracker in enumerate(trackers):
                with _naming(footage.name, index):
                    if index == 0:
                        begun = tracker.start(image, as_box(true_boxes[0]))
                        boxes[run, 0] = true_boxes[0]
                        told += [_told(begun)] if run == 0 else []
                        continue
                    dt = (frame.stamp - last_stamp) / NANOSECONDS
                    before = time.process_time()
                    answer = tracker.update(image, dt)
                    cpu_seconds[run, index - 1] = time.process_time() - before
                    told += [_told(answer)] if run == 0 else []
                    lost[run, index] = answer.state == "lost"
                    boxes[run, index] = (
                        boxes[run, index - 1] if lost[run, index] else _finite(answer.box)
                    )
            last_stamp = frame.stamp
            done = index + 1
            if on_progress is not None:
                on_progress(footage.name, 1)
    if done != frames:
        raise count_mismatch(footage.name, counted(done, "frame"), frames)
    details = FrameDetails.of(told)
    return SequenceResult(footage.name, tuple(seeds), true_boxes, boxes, lost, cpu_seconds, details)


class _Told(NamedTuple):
    """What a tracker told of one frame besides its box, as far as it knows such."""

    state: str
    confidence: float
    effective_sample_size: float
    cue_weights: Mapping[str, float]


def _told(answer: object) -> _Told:
    # Of the answer itself no more is kept than this: it may hold all particles.
    return _Told(
        str(getattr(answer, "state", "")),
        float(getattr(answer, "confidence", math.nan)),
        float(getattr(answer, "effective_sample_size", math.nan)),
        dict(getattr(answer, "cue_weights", {})),
    )


def _finite(box: Sequence[float]) -> NDArray[np.float64]:
    array = np.asarray(box, dtype=np.float64)
    if array.shape != (4,) or not np.isfinite(array).all():
        raise ValueError(f"the tracker answered with the box {box}; allowed: 4 finite numbers")
    return array


@contextmanager
def _naming(sequence: str, index: int) -> Iterator[None]:
    """Say in which sequence and frame a tracker refused what it was given."""
    try:
        yield
    except ValueError as error:
        raise EvaluationError(f"{sequence}, frame {index + 1}: {error}") from error


def _wait_for_other_threads() -> None:
    """Wait until this process' other threads rest, for at most 50 ms.

    A video decoder reads ahead in threads of its own; their CPU time would count as the tracker's.
    Only Linux tells which threads are at work; elsewhere this returns at once.
    """
    deadline = time.monotonic() + 0.05
    while _others_work() and time.monotonic() < deadline:
        time.sleep(2e-4)


def _others_work() -> bool:
    own = str(threading.get_native_id())
    for status in Path("/proc/self/task").glob("*/stat"):
        if status.parent.name == own:
            continue
        # A thread may have ended since it was listed.
        with suppress(OSError):
            # "number (name) state ...", R for running or waiting for a processor.
            if status.read_text().rpartition(")")[2].split()[0] == "R":
                return True
    return False
