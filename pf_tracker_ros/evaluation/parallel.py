"""Parallel tasks in worker processes.

Unlike a pool of `concurrent.futures`, this reports the task at which a worker ended, continues with
the others, and kills the workers when the consumer stops. Workers never outlive their parent.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True)
class WorkerEnded:
    """Result of a task whose worker process ended.

    Attributes:
        reason: A clause for an error message.
    """

    reason: str


def run_parallel(
    work: Callable[[Task], Result], tasks: Sequence[Task], processes: int
) -> Generator[tuple[int, Result | WorkerEnded], None, None]:
    """Run tasks in several processes.

    The workers are killed when the generator is closed, also by an exception such as Ctrl-C, and
    when this process ends in any way. SIGINT and SIGTERM reach only this process.

    Args:
        work: Function of a task; must be picklable, like tasks and results.
        tasks: The tasks.
        processes: Number of processes, from 1.

    Yields:
        Index and result of a task, in order of completion.
    """
    pending = list(enumerate(tasks))[::-1]
    # Process and index of its task, by connection.
    workers: dict[Connection, tuple[SpawnProcess, int]] = {}

    def send_task(connection: Connection, process: SpawnProcess) -> None:
        number, task = pending.pop()
        workers[connection] = process, number
        # `_receive` notices an ended worker.
        with suppress(BrokenPipeError, ConnectionResetError):
            connection.send(task)

    try:
        while pending or workers:
            while pending and len(workers) < processes:
                with _signals_blocked():
                    send_task(*_start_worker(work))
            for ready in wait(list(workers)):
                assert isinstance(ready, Connection)
                process, number = workers[ready]
                result = _receive(ready, process)
                if pending and not isinstance(result, WorkerEnded):
                    send_task(ready, process)
                else:
                    _kill(ready, process)
                    del workers[ready]
                yield number, result
    finally:
        for connection, (process, _) in workers.items():
            _kill(connection, process)


def _start_worker(work: Callable[[Task], Result]) -> tuple[Connection, SpawnProcess]:
    # Forked processes would inherit OpenCV's and NumPy's threads in an undefined state.
    context = get_context("spawn")
    connection, other_end = context.Pipe()
    # Closed here, so that the connection reports EOF when the worker ends.
    with other_end:
        process = context.Process(target=_serve, args=(other_end, work))
        process.start()
    return connection, process


def _receive(connection: Connection, process: SpawnProcess) -> Any:
    """Wait for the result of a worker."""
    try:
        return connection.recv()
    except (EOFError, ConnectionResetError):
        process.join()
        code = process.exitcode or 0
        ended = f"was ended by signal {-code}" if code < 0 else f"ended with code {code}"
        return WorkerEnded(f"its process {ended}")


def _kill(connection: Connection, process: SpawnProcess) -> None:
    """Kill a worker."""
    connection.close()
    process.kill()
    process.join()


@contextmanager
def _signals_blocked() -> Iterator[None]:
    """Block SIGINT and SIGTERM for a process started within the block."""
    if sys.platform == "win32":
        yield
        return
    # Otherwise spawning starts the resource tracker, which unblocks both signals.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(connection: Connection, work: Callable[[Task], Result]) -> None:
    threading.Thread(target=_exit_with_parent, daemon=True).start()
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            connection.send(work(connection.recv()))


def _exit_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)
