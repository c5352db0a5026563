"""Runs a node as a process: start, spin, and a clean end in any case."""

from __future__ import annotations

import gc
import os
import select
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import ok, try_shutdown

from pf_tracker_ros.node.override_sources import unmatched_file_warnings
from pf_tracker_ros.signals import hold_signals, ignore_signals

_SYNTAX = (
    "give names as -r FROM:=TO, parameters as -p NAME:=VALUE, a list of numbers in quotation marks "
    'and all of one kind ("[62, 31, 53, 70]" or "[62.0, 31.5, 53.0, 70.0]"), and a parameter '
    "file with the node's name and ros__parameters above the parameters"
)

_PARSE_ERROR = "Couldn't parse"

_LONGEST_TRACEBACK = 5000

# Seconds between garbage collections.
_COLLECTION_PERIOD = 1.0


def run(create: Callable[[], Node], arguments: list[str] | None = None) -> None:
    """Create a node and spin it until SIGINT, SIGTERM or a shutdown of its context.

    An exception in a callback is logged with its traceback, and the node continues. Garbage is
    collected between callbacks only. After the return signals are ignored, for the process to end.

    Args:
        create: Creates the node; called once rclpy is initialized.
        arguments: The command line with the program's name, by default that of the process.

    Raises:
        SystemExit: The ROS arguments are invalid, or ROS does not start the node.
    """
    reader = hold_signals()
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.UnknownROSArgsError as error:
        sys.exit(f"not understood after --ros-args: {str(error).strip('[]')}; {_SYNTAX}")
    except RuntimeError as error:
        # rclpy has one exception for all causes.
        if _PARSE_ERROR in str(error):
            sys.exit(f"the ROS arguments cannot be read: {error}; {_SYNTAX}")
        sys.exit(f"ROS cannot start: {error}")
    _create_and_spin(create, sys.argv if arguments is None else arguments, reader)
    _collect_all()
    ignore_signals()


@contextmanager
def spinning(create: Callable[[Context], Node], domain: int) -> Iterator[Any]:
    """A node that spins in its own thread and ROS context until the block ends."""
    context = Context()
    rclpy.init(context=context, args=[], domain_id=domain)
    try:
        node = create(context)
        thread = threading.Thread(
            target=spin_until_shutdown, args=(node,), name=node.get_name(), daemon=True
        )
        thread.start()
        try:
            yield node
        finally:
            context.try_shutdown()
            thread.join()
            node.destroy_node()
    finally:
        context.try_shutdown()


def spin_until_shutdown(node: Node) -> None:
    """Spin a node until its context is shut down, possibly by another thread."""
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    try:
        executor.spin()
    except ExternalShutdownException:
        pass
    except RuntimeError:
        # A shutdown between two waits invalidates the context of the executor.
        if node.context.ok():
            raise
    finally:
        executor.shutdown()


@contextmanager
def _shutdown_on_signal(reader: int) -> Iterator[None]:
    """Shut the context down, and so end the spinning, on a signal."""
    done, finish = os.pipe()

    def wait() -> None:
        readable, _, _ = select.select([reader, done], [], [])
        if reader in readable:
            os.read(reader, 1)
            try_shutdown()

    thread = threading.Thread(target=wait, name="signals", daemon=True)
    thread.start()
    try:
        yield
    finally:
        # A thread in rclpy at the end of the interpreter may crash the process.
        os.close(finish)
        thread.join()
        os.close(done)


def _create_and_spin(create: Callable[[], Node], command_line: list[str], reader: int) -> None:
    """Create the node and spin it; no reference to it is left afterwards."""
    # Before the signal handling: a shutdown during its construction logs errors.
    executor = SingleThreadedExecutor()
    with _shutdown_on_signal(reader):
        try:
            try:
                node = create()
            except rclpy_implementation.RCLError as error:
                # Such as missing files of SROS 2.
                if not ok():
                    raise
                sys.exit(f"the node cannot start: {error}")
            for warning in unmatched_file_warnings(node.get_fully_qualified_name(), command_line):
                node.get_logger().warning(warning)
            _spin(executor, node)
        except Exception:
            # A shutdown during a construction raises any exception.
            if ok():
                raise
        finally:
            try_shutdown()


def _spin(executor: SingleThreadedExecutor, node: Node) -> None:
    try:
        executor.add_node(node)
        _collect_between_callbacks(node)
        while ok():
            try:
                executor.spin()
            except ExternalShutdownException:
                return
            except BaseException:
                # A part of another package may raise what would end the process.
                if ok():
                    details = traceback.format_exc()[-_LONGEST_TRACEBACK:]
                    node.get_logger().error(
                        f"unexpected error, continuing: {details}",
                        throttle_duration_sec=5.0,
                    )
    finally:
        executor.shutdown()
        node.destroy_node()


def _collect_between_callbacks(node: Node) -> None:
    """Keep garbage collection out of callbacks.

    The present objects, such as all modules, are permanent: scanning them takes as long as a frame.
    The little garbage of the callbacks is collected by a timer.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    node.create_timer(_COLLECTION_PERIOD, gc.collect, clock=clock)


def _collect_all() -> None:
    """Collect the node and its DDS entities.

    At the end of the process they would be freed while the threads of DDS still use them.
    """
    gc.unfreeze()
    gc.enable()
    gc.collect()
