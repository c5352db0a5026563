"""Work spread over processes that never outlive the one that wants it."""

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
from typing import Generic, TypeVar

Task = TypeVar("Task")
Answer = TypeVar("Answer")


@dataclass(frozen=True)
class ProcessEnded:
    """Stands for the answer of a process that ended at its work.

    Attributes:
        exit_code: As `multiprocessing.Process.exitcode`: below 0 the number of a signal.
    """

    exit_code: int | None


def spread(
    work: Callable[[Task], Answer], tasks: Sequence[Task], processes: int
) -> Generator[tuple[int, Answer | ProcessEnded], None, None]:
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
    waiting = list(reversed(list(enumerate(tasks))))
    workers: dict[Connection, _Worker[Task, Answer]] = {}

    def start() -> None:
        worker = _Worker(work)
        workers[worker.connection] = worker
        worker.give(*waiting.pop())

    try:
        for _ in range(min(processes, len(tasks))):
            start()
        while workers:
            for ready in wait(list(workers)):
                assert isinstance(ready, Connection)
                worker = workers[ready]
                number, answer = worker.take()
                if waiting and not isinstance(answer, ProcessEnded):
                    worker.give(*waiting.pop())
                else:
                    worker.end()
                    del workers[ready]
                if waiting and isinstance(answer, ProcessEnded):
                    start()
                yield number, answer
    finally:
        for worker in workers.values():
            worker.end()


class _Worker(Generic[Task, Answer]):
    """A process and the connection to it."""

    def __init__(self, work: Callable[[Task], Answer]) -> None:
        # Forked processes would inherit OpenCV's and NumPy's threads in an undefined state.
        context = get_context("spawn")
        self.connection, other_end = context.Pipe()
        self._process: SpawnProcess = context.Process(target=_serve, args=(other_end, work))
        self._number = -1
        try:
            with _signals_held_back():
                self._process.start()
        except BaseException:
            self.end()
            raise
        finally:
            # Once the process has ended, nobody holds this end, which is how that is noticed.
            other_end.close()

    def give(self, number: int, task: Task) -> None:
        """Have it do a task."""
        self._number = number
        # One that has ended is noticed when its answer is taken.
        with suppress(BrokenPipeError, ConnectionResetError):
            self.connection.send(task)

    def take(self) -> tuple[int, Answer | ProcessEnded]:
        """The number of the task that was given last, and the answer; waits for it."""
        try:
            return self._number, self.connection.recv()
        except (EOFError, ConnectionResetError):
            self._process.join()
            return self._number, ProcessEnded(self._process.exitcode)

    def end(self) -> None:
        """End the process now; it holds nothing that could get lost."""
        self.connection.close()
        if self._process.pid is not None:
            self._process.kill()
            self._process.join()


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


def _serve(connection: Connection, work: Callable[[Task], Answer]) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            connection.send(work(connection.recv()))


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)
