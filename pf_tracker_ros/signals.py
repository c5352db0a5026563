"""SIGINT and SIGTERM, from the first moment of a process on; imports nothing that takes time."""

from __future__ import annotations

import functools
import os
import signal


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


def ignore_signals() -> None:
    """Let neither SIGINT nor SIGTERM end a process that is ending, by another exit code.

    As Python ends, it gives signals their default action back, but for those that are ignored. A
    Ctrl-C in a terminal comes twice to what `ros2 launch` has started.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
