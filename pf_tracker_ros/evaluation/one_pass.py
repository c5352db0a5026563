"""One-pass evaluation: a tracker starts on the first true box and tracks to the end.

There are no restarts. While the tracker reports the target as lost, its last box counts.

Source: Wu, Lim and Yang 2013, "Online Object Tracking: A Benchmark" (OTB).
"""

from __future__ import annotations

import functools
import math
import threading
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from pf_tracker_ros.boxes import Box, as_box
from pf_tracker_ros.evaluation.parallel import WorkerEnded, run_parallel
from pf_tracker_ros.evaluation.results import (
    EvaluationError,
    FrameDetails,
    SequenceFailure,
    SequenceResult,
)
from pf_tracker_ros.evaluation.sequences import count_mismatch, usable_ground_truth
from pf_tracker_ros.footage import Footage, FootageError
from pf_tracker_ros.opencv import one_opencv_thread
from pf_tracker_ros.plurals import counted
from pf_tracker_ros.progress import OnProgress
from pf_tracker_ros.stamps import NANOSECONDS

Image = NDArray[Any]


class BoxEstimate(Protocol):
    """A tracker's output for one frame, such as `Estimate`."""

    @property
    def box(self) -> Box:
        """(x, y, width, height) in pixels; ignored while lost."""
        ...

    @property
    def state(self) -> str:
        """The word "lost" while the target is lost, otherwise any other."""
        ...


class BoxTracker(Protocol):
    """A tracker to evaluate: `Tracker`, or an adapter of another one."""

    def start(self, image: Image, box: Box, /) -> object:
        """Start on the first frame."""
        ...

    def update(self, image: Image, dt: float | None, /) -> BoxEstimate:
        """Track in the next frame, `dt` seconds after the last; the image is read-only."""
        ...


TrackerFactory = Callable[[int], BoxTracker]
"""Makes a tracker from a seed."""


def evaluate_sequence(
    footage: Footage,
    make_tracker: TrackerFactory,
    seeds: Sequence[int],
    on_progress: OnProgress | None = None,
) -> SequenceResult:
    """Run one tracker for each seed over a sequence, in parallel frame by frame.

    Each frame is read once and not kept. Times are CPU times of this process during `update`, with
    OpenCV limited to one thread; they include the tracker's own threads.

    Args:
        footage: A sequence with ground truth and a target in its first frame.
        make_tracker: Called once for each seed.
        seeds: Seeds, one run each.
        on_progress: Called after each frame.

    Returns:
        The boxes and times of all runs.

    Raises:
        EvaluationError: No seeds; no usable ground truth; not as many frames as true boxes; the
            tracker refuses the first box or a frame, or returns a box that is not finite.
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
    outputs: list[_TrackerOutput] = []
    done, last_stamp = 0, 0
    with one_opencv_thread():
        for index, frame in enumerate(footage.frames()):
            if index >= frames:
                raise count_mismatch(footage.name, f"more than {counted(frames, 'frame')}", frames)
            # Read-only, because the trackers share the image.
            image = frame.image.view()
            image.flags.writeable = False
            _wait_for_other_threads()
            for run, tracker in enumerate(trackers):
                with _errors_name_frame(footage.name, index):
                    if index == 0:
                        first = tracker.start(image, as_box(true_boxes[0]))
                        boxes[run, 0] = true_boxes[0]
                        outputs += [_tracker_output(first)] if run == 0 else []
                        continue
                    dt = (frame.stamp - last_stamp) / NANOSECONDS
                    before = time.process_time()
                    estimate = tracker.update(image, dt)
                    cpu_seconds[run, index - 1] = time.process_time() - before
                    outputs += [_tracker_output(estimate)] if run == 0 else []
                    lost[run, index] = estimate.state == "lost"
                    boxes[run, index] = (
                        boxes[run, index - 1] if lost[run, index] else _finite(estimate.box)
                    )
            last_stamp = frame.stamp
            done = index + 1
            if on_progress is not None:
                on_progress(footage.name, 1)
    if done != frames:
        raise count_mismatch(footage.name, counted(done, "frame"), frames)
    details = FrameDetails.of(outputs)
    return SequenceResult(footage.name, tuple(seeds), true_boxes, boxes, lost, cpu_seconds, details)


class _TrackerOutput(NamedTuple):
    """A tracker's output for one frame besides the box."""

    state: str
    confidence: float
    effective_sample_size: float
    cue_weights: Mapping[str, float]


def _tracker_output(estimate: object) -> _TrackerOutput:
    # Keeping the estimate itself would keep all its particles.
    return _TrackerOutput(
        str(getattr(estimate, "state", "")),
        float(getattr(estimate, "confidence", math.nan)),
        float(getattr(estimate, "effective_sample_size", math.nan)),
        dict(getattr(estimate, "cue_weights", {})),
    )


def _finite(box: Sequence[float]) -> NDArray[np.float64]:
    array = np.asarray(box, dtype=np.float64)
    if array.shape != (4,) or not np.isfinite(array).all():
        raise ValueError(f"the tracker returned the box {box}; allowed: 4 finite numbers")
    return array


@contextmanager
def _errors_name_frame(sequence: str, index: int) -> Iterator[None]:
    """Prefix a tracker's errors with sequence and frame."""
    try:
        yield
    except ValueError as error:
        raise EvaluationError(f"{sequence}, frame {index + 1}: {error}") from error


def _wait_for_other_threads() -> None:
    """Wait until this process' other threads are idle, for at most 50 ms.

    The CPU time of a video decoder's threads, which read ahead, would count as the tracker's.
    Thread states are available only on Linux; elsewhere this returns at once.
    """
    deadline = time.monotonic() + 0.05
    while _others_run() and time.monotonic() < deadline:
        time.sleep(2e-4)


def _others_run() -> bool:
    own = str(threading.get_native_id())
    for status in Path("/proc/self/task").glob("*/stat"):
        if status.parent.name == own:
            continue
        # The thread may have ended since.
        with suppress(OSError):
            # "number (name) state ...", R for running or runnable.
            if status.read_text().rpartition(")")[2].split()[0] == "R":
                return True
    return False


def evaluate_each(
    sequences: Sequence[Footage],
    make_tracker: TrackerFactory,
    seeds: Sequence[int],
    jobs: int = 1,
    on_progress: OnProgress | None = None,
) -> Generator[tuple[int, SequenceResult | SequenceFailure], None, None]:
    """Evaluate a tracker on several sequences; failures do not stop the others.

    Closing the generator ends its processes at once.

    Args:
        sequences: The sequences, as from `read_sequences`.
        make_tracker: Called once for each sequence and seed; must be picklable for `jobs` > 1.
        seeds: Seeds, one run each.
        jobs: Number of processes. They share caches and memory bandwidth: compare times only
            between runs with one.
        on_progress: Called after each frame, or for `jobs` > 1 after each sequence that did not
            fail.

    Yields:
        Index and result of a sequence, in order of completion.
    """
    if jobs == 1:
        for number, footage in enumerate(sequences):
            yield number, _attempt(footage, make_tracker, seeds, on_progress)
        return
    work = functools.partial(_attempt, make_tracker=make_tracker, seeds=seeds)
    with closing(run_parallel(work, sequences, jobs)) as results:
        for number, result in results:
            if isinstance(result, WorkerEnded):
                name = sequences[number].name
                reason = f"{name}: one of {jobs} processes ended unexpectedly ({result.reason})"
                error = EvaluationError(f"{reason}; if memory is short, use fewer jobs")
                yield number, SequenceFailure(name, error)
                continue
            if on_progress is not None and isinstance(result, SequenceResult):
                on_progress(result.name, len(result.true_boxes))
            yield number, result


def evaluate_sequences(
    sequences: Sequence[Footage],
    make_tracker: TrackerFactory,
    seeds: Sequence[int],
    jobs: int = 1,
    on_progress: OnProgress | None = None,
) -> list[SequenceResult]:
    """Evaluate a tracker on several sequences; the first failure is raised.

    Args:
        sequences: As for `evaluate_each`.
        make_tracker: As for `evaluate_each`.
        seeds: As for `evaluate_each`.
        jobs: As for `evaluate_each`.
        on_progress: As for `evaluate_each`.

    Returns:
        The results, in order of the sequences.

    Raises:
        EvaluationError: As for `evaluate_sequence`, or a process ended unexpectedly.
        FootageError: A frame cannot be read.
    """
    results: dict[int, SequenceResult] = {}
    with closing(evaluate_each(sequences, make_tracker, seeds, jobs, on_progress)) as done:
        for number, result in done:
            if isinstance(result, SequenceFailure):
                raise result.error
            results[number] = result
    return [results[number] for number in sorted(results)]


def _attempt(
    footage: Footage,
    make_tracker: TrackerFactory,
    seeds: Sequence[int],
    on_progress: OnProgress | None = None,
) -> SequenceResult | SequenceFailure:
    try:
        return evaluate_sequence(footage, make_tracker, seeds, on_progress)
    except (EvaluationError, FootageError) as error:
        return SequenceFailure(footage.name, error)
    except (ValueError, OSError, MemoryError, cv2.error) as error:
        reason = str(error) or type(error).__name__
        return SequenceFailure(footage.name, EvaluationError(f"{footage.name}: {reason}"))
