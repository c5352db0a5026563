"""Who does the tasks of an archive: processes of this machine, or the workers of a Ray cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from pf_tracker_ros.evaluation.parallel import Result, Task, WorkerEnded, run_parallel

if TYPE_CHECKING:
    from pf_tracker_ros.recordings.archives.ray_cluster import RayCluster

Executor: TypeAlias = "ProcessPool | RayCluster"
"""Does tasks in parallel."""


@dataclass(frozen=True)
class ProcessPool:
    """ProcessPool of this machine.

    Attributes:
        count: How many.
    """

    count: int

    @property
    def workers(self) -> int:
        """How many tasks are done at once, each on a core of its own."""
        return min(self.count, os.cpu_count() or self.count)

    def run(
        self, work: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Generator[tuple[int, Result | WorkerEnded], None, None]:
        """Do tasks; see `run_parallel`."""
        return run_parallel(work, tasks, self.count)


def make_executor(
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
        return nullcontext(ProcessPool(jobs or 1))
    from pf_tracker_ros.recordings.archives.ray_cluster import RayCluster

    return closing(RayCluster(ray_address, jobs, memory_of))
