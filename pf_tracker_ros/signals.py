"""Handling of SIGINT and SIGTERM from the start of a process; imports only light modules."""

from __future__ import annotations

import functools
import os
import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any


@functools.cache
def hold_signals() -> int:
    """Turn SIGINT and SIGTERM into bytes on a pipe.

    rclpy's handlers wake the executor before they shut down its context, so it sometimes waits
    again and misses the shutdown. Python's handlers raise an exception at an arbitrary line.

    Returns:
        A file descriptor that becomes readable with the first signal.
    """
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)
    return reader


@contextmanager
def handled_signals(handlers: Mapping[signal.Signals, Any]) -> Iterator[None]:
    """Replace signal handlers within a block.

    Only the main thread may do so; in another thread nothing changes.

    Args:
        handlers: Signal to handler, as for `signal.signal`.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def ignore_signals() -> None:
    """Ignore SIGINT and SIGTERM while the process exits, so that its exit code stays.

    At exit Python restores the default action of signals unless they are ignored. Processes of
    `ros2 launch` receive a Ctrl-C in a terminal twice.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
