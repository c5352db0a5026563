"""SIGINT and SIGTERM, from the first moment of a process on; imports nothing that takes time."""

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
    """Keep SIGINT and SIGTERM from interrupting anything, from now on.

    rclpy's own handlers wake the executor before they shut its context down, so now and then it
    waits again and misses the end; Python's raise an exception wherever the process happens to be.

    Returns:
        A file descriptor that can be read once a signal has come, also one from before the reading.
    """
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)
    return reader


@contextmanager
def handled_signals(handlers: Mapping[signal.Signals, Any]) -> Iterator[None]:
    """Handle signals otherwise for the length of a block, where this is the main thread.

    Only that may say what happens on a signal; in another one all stays as it is.

    Args:
        handlers: Signal to what `signal.signal` takes for it.
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
    """Let neither SIGINT nor SIGTERM end a process that is ending, by another exit code.

    As Python ends, it gives signals their default action back, but for those that are ignored. A
    Ctrl-C in a terminal comes twice to what `ros2 launch` has started.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
