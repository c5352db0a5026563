"""Running a node as a process: start, spin, and end cleanly whatever happens."""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import ok, try_shutdown


def run(create: Callable[[], Node], arguments: list[str] | None = None) -> None:
    """Create a node and spin it until SIGINT, SIGTERM or a shutdown of its context.

    An exception that leaves a callback is logged with its traceback, and the node goes on.

    Args:
        create: Makes the node; called once rclpy is initialized.
        arguments: The command line with the program's name, by default that of the process.

    Raises:
        SystemExit: The ROS arguments cannot be parsed.
    """
    watch_signals = _collect_signals()
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        sys.exit(str(error))
    watch_signals()
    try:
        _spin(create())
    except Exception:
        # Whatever is half made when the context goes away may raise anything.
        if ok():
            raise
    finally:
        try_shutdown()


def _collect_signals() -> Callable[[], None]:
    """Keep SIGINT and SIGTERM from interrupting anything.

    rclpy's own handlers wake the executor before they shut its context down, so now and then it
    waits again and misses the end; Python's raise an exception wherever the process happens to be.

    Returns:
        To be called once rclpy is initialized: from then on a signal, also one that has come
        before, shuts the context down, which ends what spins.
    """
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)

    def shut_down() -> None:
        os.read(reader, 1)
        try_shutdown()

    return threading.Thread(target=shut_down, name="signals", daemon=True).start


def _spin(node: Node) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while ok():
            try:
                executor.spin()
            except ExternalShutdownException:
                return
            except Exception:
                if ok():
                    node.get_logger().error(
                        f"unexpected error, going on: {traceback.format_exc()}",
                        throttle_duration_sec=5.0,
                    )
    finally:
        executor.shutdown()
        node.destroy_node()
