"""Who does the tasks of an archive: processes of this machine, or the workers of a Ray cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from pf_tracker_ros.evaluation.processes import ProcessEnded, spread

Task = TypeVar("Task")
Answer = TypeVar("Answer")


@dataclass(frozen=True)
class WorkerEnded:
    """Stands for the answer of a worker that ended at its work.

    Attributes:
        how: As a clause of a sentence.
    """

    how: str


class Executor(Protocol):
    """Does tasks in parallel."""

    @property
    def workers(self) -> int:
        """How many tasks are done at once, each on a core of its own.

        Raises:
            RecordingError: There is nobody to do them.
        """
        ...

    def run(
        self, work: Callable[[Task], Answer], tasks: Sequence[Task]
    ) -> Generator[tuple[int, Answer | WorkerEnded], None, None]:
        """Do tasks; what is under way ends when the generator is closed.

        Args:
            work: Does one task; must be picklable, as tasks and answers must.
            tasks: What there is to do.

        Yields:
            Number of a task and its answer, in the order in which they are done.

        Raises:
            RecordingError: There is nobody to do them.
        """
        ...


@dataclass(frozen=True)
class Processes:
    """Processes of this machine.

    Attributes:
        count: How many.
    """

    count: int

    @property
    def workers(self) -> int:
        """How many tasks are done at once, each on a core of its own; see `Executor.workers`."""
        return min(self.count, os.cpu_count() or self.count)

    def run(
        self, work: Callable[[Task], Answer], tasks: Sequence[Task]
    ) -> Generator[tuple[int, Answer | WorkerEnded], None, None]:
        """Do tasks, each process one at a time; see `Executor.run`."""
        with closing(spread(work, tasks, self.count)) as answers:
            for number, answer in answers:
                if isinstance(answer, ProcessEnded):
                    how = f"its process ended with code {answer.exit_code}"
                    yield number, WorkerEnded(how)
                else:
                    yield number, answer


def choose_executor(
    ray_address: str | None, jobs: int | None, memory_of: Callable[[Any], int]
) -> AbstractContextManager[Executor]:
    """Who does the tasks.

    Args:
        ray_address: Of a Ray cluster, `local` for one on this machine; None for processes.
        jobs: How many tasks at once; None for one process, or as many as the cluster has room for.
        memory_of: Bytes that a task needs.

    Raises:
        RecordingError: Ray is not installed.
    """
    if ray_address is None:
        return nullcontext(Processes(jobs or 1))
    from pf_tracker_ros.recordings.archives.ray_cluster import RayCluster

    return RayCluster(ray_address, jobs, memory_of)
