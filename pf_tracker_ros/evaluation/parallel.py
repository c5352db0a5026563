"""Work spread over processes that never outlive the one that wants it.

Unlike a pool of `concurrent.futures`, this tells at which task a process has ended, goes on with
the others, and does not wait for tasks that nobody wants any more.
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
    """Stands for the answer of a worker that ended at its work.

    Attributes:
        reason: As a clause of a sentence.
    """

    reason: str


def run_parallel(
    work: Callable[[Task], Result], tasks: Sequence[Task], processes: int
) -> Generator[tuple[int, Result | WorkerEnded], None, None]:
    """Do tasks in several processes, each one task at a time.

    The processes end at once when the generator is closed, by an exception such as Ctrl-C too, and
    when this process ends, however it does. Signals that end a program reach this process only:
    it is the one to say so.

    Args:
        work: Does one task; must be picklable, as tasks and answers must.
        tasks: What there is to do.
        processes: How many, from 1.

    Yields:
        Number of a task and its answer, in the order in which they are done.
    """
    waiting = list(enumerate(tasks))[::-1]
    # What answers, to who does the task of which number.
    workers: dict[Connection, tuple[SpawnProcess, int]] = {}

    def give(connection: Connection, process: SpawnProcess) -> None:
        number, task = waiting.pop()
        workers[connection] = process, number
        # One that has ended is noticed when its answer is taken.
        with suppress(BrokenPipeError, ConnectionResetError):
            connection.send(task)

    try:
        while waiting or workers:
            while waiting and len(workers) < processes:
                with _signals_held_back():
                    give(*_started(work))
            for ready in wait(list(workers)):
                assert isinstance(ready, Connection)
                process, number = workers[ready]
                answer = _answer(ready, process)
                if waiting and not isinstance(answer, WorkerEnded):
                    give(ready, process)
                else:
                    _end(ready, process)
                    del workers[ready]
                yield number, answer
    finally:
        for connection, (process, _) in workers.items():
            _end(connection, process)


def _started(work: Callable[[Task], Result]) -> tuple[Connection, SpawnProcess]:
    # Forked processes would inherit OpenCV's and NumPy's threads in an undefined state.
    context = get_context("spawn")
    connection, other_end = context.Pipe()
    # Once the process has ended, nobody holds the other end, which is how that is noticed.
    with other_end:
        process = context.Process(target=_serve, args=(other_end, work))
        process.start()
    return connection, process


def _answer(connection: Connection, process: SpawnProcess) -> Any:
    """What a process answers; waits for it."""
    try:
        return connection.recv()
    except (EOFError, ConnectionResetError):
        process.join()
        code = process.exitcode or 0
        ended = f"was ended by signal {-code}" if code < 0 else f"ended with code {code}"
        return WorkerEnded(f"its process {ended}")


def _end(connection: Connection, process: SpawnProcess) -> None:
    """End a process now; it holds nothing that could get lost."""
    connection.close()
    process.kill()
    process.join()


@contextmanager
def _signals_held_back() -> Iterator[None]:
    """Let a process that is started meanwhile never see a signal that asks it to end."""
    if sys.platform == "win32":
        yield
        return
    # Spawning starts this process first, which ends the holding back of both signals.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(connection: Connection, work: Callable[[Task], Result]) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            connection.send(work(connection.recv()))


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)
