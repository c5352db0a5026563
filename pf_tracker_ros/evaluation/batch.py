"""Evaluation on several sequences, sequentially or in parallel processes."""

from __future__ import annotations

import functools
from collections.abc import Generator, Sequence
from contextlib import closing

import cv2

from pf_tracker_ros.evaluation.one_pass import TrackerFactory, evaluate_sequence
from pf_tracker_ros.evaluation.parallel import WorkerEnded, run_parallel
from pf_tracker_ros.evaluation.results import EvaluationError, SequenceFailure, SequenceResult
from pf_tracker_ros.footage import Footage, FootageError
from pf_tracker_ros.progress import OnProgress


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
