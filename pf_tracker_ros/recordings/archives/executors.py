"""Executors run the tasks of an archive: processes on this machine, or a Ray cluster."""

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
"""Runs tasks in parallel."""


@dataclass(frozen=True)
class ProcessPool:
    """Processes on this machine.

    Attributes:
        count: Number of processes.
    """

    count: int

    @property
    def workers(self) -> int:
        """Number of parallel tasks, each on its own core."""
        return min(self.count, os.cpu_count() or self.count)

    def run(
        self, work: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Generator[tuple[int, Result | WorkerEnded], None, None]:
        """Run tasks; see `run_parallel`."""
        return run_parallel(work, tasks, self.count)


def make_executor(
    ray_address: str | None, jobs: int | None, memory_of: Callable[[Any], int]
) -> AbstractContextManager[Executor]:
    """Make an executor.

    Args:
        ray_address: Of a Ray cluster, `local` to start one on this machine; None for processes.
        jobs: Number of parallel tasks; None for one process, or one task per core of the cluster.
        memory_of: Bytes that a task needs.

    Raises:
        RecordingError: Ray is not installed.
    """
    if ray_address is None:
        return nullcontext(ProcessPool(jobs or 1))
    from pf_tracker_ros.recordings.archives.ray_cluster import RayCluster

    return closing(RayCluster(ray_address, jobs, memory_of))
