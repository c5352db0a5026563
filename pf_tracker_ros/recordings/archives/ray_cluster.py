"""A Ray cluster as an executor: a Ray task for each recording, placed by cores and memory."""

from __future__ import annotations

import logging
import os
import signal
import socket
from collections.abc import Callable, Generator, Sequence
from itertools import islice
from types import ModuleType
from typing import Any

from pf_tracker_ros.command_lines import missing_package
from pf_tracker_ros.evaluation.parallel import Result, Task, WorkerEnded
from pf_tracker_ros.recordings.errors import FAILED, REFUSED, RecordingError
from pf_tracker_ros.signals import handled_signals

LOCAL = "local"
_CONNECT_TIMEOUT = 10.0
# Submitted tasks let an autoscaling cluster decide how many machines to start.
_MAX_SUBMITTED = 1000
# The smallest size of Ray's object store, bytes. Tasks and results are small and bypass it.
_OBJECT_STORE = 80 * 2**20


class RayCluster:
    """Runs tasks on a Ray cluster: a running one, or one that it starts on this machine.

    Ray's usage reports are off. A started cluster listens on the loopback interface only, without
    the dashboard.

    Args:
        address: `auto` or HOST:PORT of a running cluster; `local` starts one.
        jobs: Number of parallel tasks; None for one per core.
        memory_of: Bytes that a task needs.

    Raises:
        RecordingError: Ray is not installed.
    """

    def __init__(self, address: str, jobs: int | None, memory_of: Callable[[Any], int]) -> None:
        self._address = address
        self._jobs = jobs
        self._memory_of = memory_of
        self._is_connected = False
        self._ray = _import_ray(is_local=address == LOCAL)

    @property
    def workers(self) -> int:
        """Number of parallel tasks, each on its own core.

        Raises:
            RecordingError: There is no cluster at the address.
        """
        if self._address == LOCAL:
            cores = os.cpu_count() or 1
            return min(self._jobs or cores, cores)
        cores = int(self._connected().cluster_resources().get("CPU", 0))
        return min(self._jobs or cores, cores) or 1

    def run(
        self, work: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Generator[tuple[int, Result | WorkerEnded], None, None]:
        """Run tasks; see `run_parallel`.

        Raises:
            RecordingError: There is no cluster at the address, or it has ended.
        """
        if not tasks:
            return
        ray = self._connected()
        # The caller repeats tasks.
        remote = ray.remote(num_cpus=1, max_retries=0)(work)
        waiting = iter(enumerate(tasks))
        submitted: dict[Any, int] = {}
        limit = self._jobs or _MAX_SUBMITTED
        try:
            while True:
                for number, task in islice(waiting, limit - len(submitted)):
                    with_memory = remote.options(memory=self._memory_for(task))
                    submitted[with_memory.remote(task)] = number
                if not submitted:
                    return
                for reference in ray.wait(list(submitted))[0]:
                    number = submitted.pop(reference)
                    yield number, self._result(reference)
        finally:
            if submitted:
                # Their workers end with the connection. Canceling a task at the moment of its
                # completion would make Ray abort this process.
                self.close()

    def _result(self, reference: Any) -> Any:
        ray = self._connected()
        try:
            return ray.get(reference)
        except ray.exceptions.LocalRayletDiedError as error:
            raise RecordingError(
                "Ray has ended on this machine; restart it and run the same command again, which "
                "skips the finished recordings",
                FAILED,
            ) from error
        except ray.exceptions.RayError as error:
            return WorkerEnded(_reason(ray, error))

    def _memory_for(self, task: Any) -> int:
        """Bytes to reserve; at most what a machine has, as Ray would wait for more forever."""
        machines = [node["Resources"] for node in self._connected().nodes() if node["Alive"]]
        memory = [int(each.get("memory", 0)) for each in machines if each.get("CPU", 0) >= 1]
        needed = self._memory_of(task)
        return min(needed, max(memory)) if memory else needed

    def _connected(self) -> ModuleType:
        """The module of Ray, with a connection."""
        if not self._is_connected:
            _connect(self._ray, self._address, self._jobs)
            self._is_connected = True
        return self._ray

    def close(self) -> None:
        """Close the connection, end a started cluster, and stop the running tasks."""
        if self._is_connected:
            self._is_connected = False
            self._ray.shutdown()


def _reason(ray: ModuleType, error: Exception) -> str:
    if isinstance(error, ray.exceptions.OutOfMemoryError):
        return "its worker ran out of memory"
    if isinstance(error, ray.exceptions.NodeDiedError):
        return "its machine was lost"
    if isinstance(error, ray.exceptions.WorkerCrashedError):
        return "its worker ended unexpectedly"
    cause = getattr(error, "cause", None) or error
    lines = str(cause).strip().splitlines()
    return f"its worker failed ({type(cause).__name__}: {lines[0] if lines else 'no reason'})"


def _host(address: str) -> str:
    """The host of HOST:PORT, or empty."""
    host, colon, port = address.rpartition(":")
    return host if colon and port.isdecimal() else ""


def _import_ray(*, is_local: bool) -> ModuleType:
    # Ray reads these on import.
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    if is_local:
        # Despite its name, 0 restricts Ray to this machine and the loopback interface.
        os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
        os.environ.setdefault("RAY_AUTH_MODE", "token")
    if missing := missing_package("ray", "ray"):
        raise RecordingError(missing)
    import ray

    return ray


def _connect(ray: ModuleType, address: str, jobs: int | None) -> None:
    options: dict[str, Any] = {}
    if address == LOCAL:
        options = {
            "num_cpus": jobs,
            "include_dashboard": False,
            "object_store_memory": _OBJECT_STORE,
            "_node_ip_address": "127.0.0.1",
        }
    try:
        if host := _host(address):
            # Ray itself would retry for minutes.
            port = int(address.rpartition(":")[2])
            socket.create_connection((host, port), _CONNECT_TIMEOUT).close()
        # Ray would replace the signal handlers.
        own = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        with handled_signals(own):
            ray.init(
                address=address, log_to_driver=False, logging_level=logging.CRITICAL, **options
            )
    # Ray has no specific exception for this.
    except Exception as error:
        lines = str(error).strip().splitlines() or [type(error).__name__]
        raise RecordingError(
            f"there is no Ray cluster at {address} ({lines[0].rstrip('.')}); start one with ray "
            "start --head, or use --ray local to start one on this machine",
            REFUSED,
        ) from error
