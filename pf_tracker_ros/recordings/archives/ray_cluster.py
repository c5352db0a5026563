"""A Ray cluster as an executor: a task for each recording, placed by cores and memory."""

from __future__ import annotations

import logging
import os
import signal
import socket
from collections.abc import Callable, Generator, Sequence
from itertools import islice
from types import ModuleType
from typing import Any

from pf_tracker_ros.evaluation.parallel import Result, Task, WorkerEnded
from pf_tracker_ros.recordings.errors import FAILED, REFUSED, RecordingError
from pf_tracker_ros.signals import handled_signals

LOCAL = "local"
_LOOPBACK = ("localhost", "127.0.0.1", "[::1]", "::1")
_SECONDS_TO_ANSWER = 10.0
# What waits tells a cluster that grows by itself how many machines are wanted.
_SUBMITTED_AT_ONCE = 1000
# Tasks and answers are small, and go past Ray's store of objects. Its least size, bytes.
_OBJECT_STORE = 80 * 2**20


class RayCluster:
    """Does tasks on a Ray cluster, one that is running or one of its own on this machine.

    Nothing is told to Ray's makers, and a cluster of its own listens on the loopback interface
    alone, without the dashboard.

    Args:
        address: `auto` or HOST:PORT of a cluster that is running; `local` starts one.
        jobs: How many tasks at once; None for as many as there are cores for.
        memory_of: Bytes that a task needs.

    Raises:
        RecordingError: Ray is not installed.
    """

    def __init__(self, address: str, jobs: int | None, memory_of: Callable[[Any], int]) -> None:
        self._address = address
        self._jobs = jobs
        self._memory_of = memory_of
        self._is_connected = False
        self._ray = _import_ray(stays_here=address == LOCAL or _host(address) in _LOOPBACK)

    @property
    def workers(self) -> int:
        """How many tasks are done at once, each on a core of its own.

        Raises:
            RecordingError: There is no such cluster.
        """
        if self._address == LOCAL:
            cores = os.cpu_count() or 1
            return min(self._jobs or cores, cores)
        cores = int(self._connected().cluster_resources().get("CPU", 0))
        return min(self._jobs or cores, cores) or 1

    def run(
        self, work: Callable[[Task], Result], tasks: Sequence[Task]
    ) -> Generator[tuple[int, Result | WorkerEnded], None, None]:
        """Do tasks as `spread` does.

        Raises:
            RecordingError: There is no such cluster, or not any more.
        """
        if not tasks:
            return
        ray = self._connected()
        # Whether a task is done again is for the caller to say.
        remote = ray.remote(num_cpus=1, max_retries=0)(work)
        waiting = iter(enumerate(tasks))
        under_way: dict[Any, int] = {}
        most = self._jobs or _SUBMITTED_AT_ONCE
        try:
            while True:
                for number, task in islice(waiting, most - len(under_way)):
                    placed = remote.options(memory=self._memory_for(task))
                    under_way[placed.remote(task)] = number
                if not under_way:
                    return
                for answered in ray.wait(list(under_way))[0]:
                    number = under_way.pop(answered)
                    yield number, self._answer(answered)
        finally:
            if under_way:
                # Their workers end with the connection. To cancel a task that answers at the same
                # moment makes Ray end this process.
                self.close()

    def _answer(self, answered: Any) -> Any:
        ray = self._connected()
        try:
            return ray.get(answered)
        except ray.exceptions.LocalRayletDiedError as error:
            raise RecordingError(
                "Ray has ended on this machine; start it again, and call this again, which goes on "
                "with what is not done",
                FAILED,
            ) from error
        except ray.exceptions.RayError as error:
            return WorkerEnded(_how(ray, error))

    def _memory_for(self, task: Any) -> int:
        """Bytes to reserve: what no machine has would be waited for without an end."""
        machines = [node["Resources"] for node in self._connected().nodes() if node["Alive"]]
        rooms = [int(each.get("memory", 0)) for each in machines if each.get("CPU", 0) >= 1]
        needed = self._memory_of(task)
        return min(needed, max(rooms)) if rooms else needed

    def _connected(self) -> ModuleType:
        if not self._is_connected:
            _connect(self._ray, self._address, self._jobs)
            self._is_connected = True
        return self._ray

    def close(self) -> None:
        """End the connection, and a cluster of its own, with all tasks that are under way."""
        if self._is_connected:
            self._is_connected = False
            self._ray.shutdown()


def _how(ray: ModuleType, error: Exception) -> str:
    if isinstance(error, ray.exceptions.OutOfMemoryError):
        return "its worker was ended for want of memory"
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


def _import_ray(*, stays_here: bool) -> ModuleType:
    # All of these are read when Ray is imported.
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    if stays_here:
        # The name is of other systems; what it says is that there are no other machines, with which
        # all that Ray listens on is bound to the loopback interface.
        os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
        os.environ.setdefault("RAY_AUTH_MODE", "token")
    try:
        import ray
    except ImportError as error:
        raise RecordingError(
            "ray is not installed: pip install ray, or '.[ray]' in the sources"
        ) from error
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
            # Ray would try for minutes.
            port = int(address.rpartition(":")[2])
            socket.create_connection((host, port), _SECONDS_TO_ANSWER).close()
        # Ray would leave its own in place of what this program does on signals.
        own = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        with handled_signals(own):
            ray.init(
                address=address, log_to_driver=False, logging_level=logging.CRITICAL, **options
            )
    # Ray has no error of its own for it.
    except Exception as error:
        lines = str(error).strip().splitlines() or [type(error).__name__]
        raise RecordingError(
            f"there is no Ray cluster to be had at {address} ({lines[0].rstrip('.')}); start one "
            "with ray start --head, or let --ray local start one on this machine",
            REFUSED,
        ) from error
