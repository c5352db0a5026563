"""Running a node as a process: start, spin, and end cleanly whatever happens."""

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

_HOW_TO_GIVE = (
    "give names as -r FROM:=TO, parameters as -p NAME:=VALUE, a list of numbers in quotation marks "
    'and all of one kind ("[62, 31, 53, 70]" or "[62.0, 31.5, 53.0, 70.0]"), and a parameter '
    "file with the node's name and ros__parameters above the parameters"
)

_OF_ARGUMENTS = "Couldn't parse"

# Seconds from one collection of garbage to the next.
_COLLECT_EVERY = 1.0


def run(create: Callable[[], Node], arguments: list[str] | None = None) -> None:
    """Create a node and spin it until SIGINT, SIGTERM or a shutdown of its context.

    An exception that leaves a callback is logged with its traceback, and the node goes on. Garbage
    is collected between callbacks, never within one. Afterwards signals are ignored: the process is
    to end.

    Args:
        create: Makes the node; called once rclpy is initialized.
        arguments: The command line with the program's name, by default that of the process.

    Raises:
        SystemExit: The ROS arguments cannot be parsed, or ROS does not let the node start.
    """
    reader = hold_signals()
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.UnknownROSArgsError as error:
        sys.exit(f"not understood after --ros-args: {str(error).strip('[]')}; {_HOW_TO_GIVE}")
    except RuntimeError as error:
        # It has one kind of error for all that keeps it from starting.
        if _OF_ARGUMENTS in str(error):
            sys.exit(f"the ROS arguments cannot be read: {error}; {_HOW_TO_GIVE}")
        sys.exit(f"ROS cannot start: {error}")
    _live(create, sys.argv if arguments is None else arguments, reader)
    _collect_all()
    ignore_signals()


@contextmanager
def spinning(create: Callable[[Context], Node], domain: int) -> Iterator[Any]:
    """A node that spins in a thread and a ROS context of its own until the block ends.

    Args:
        create: Makes the node in the context.
        domain: ROS domain of the context.
    """
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
    """Spin a node until its context is shut down, also by another thread."""
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    try:
        executor.spin()
    except ExternalShutdownException:
        pass
    except RuntimeError:
        # A shutdown between two waits takes the context from under the executor.
        if node.context.ok():
            raise
    finally:
        executor.shutdown()


@contextmanager
def _ended_by_signal(reader: int) -> Iterator[None]:
    """Shut the context down, which ends what spins, once a signal has come."""
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
        # A thread that is still in rclpy when the interpreter ends may take the process with it.
        os.close(finish)
        thread.join()
        os.close(done)


def _live(create: Callable[[], Node], command_line: list[str], reader: int) -> None:
    """Make the node and spin it; afterwards nothing refers to it but itself."""
    # While nothing can take the context away: one that is half made complains as it goes.
    executor = SingleThreadedExecutor()
    with _ended_by_signal(reader):
        try:
            try:
                node = create()
            except rclpy_implementation.RCLError as error:
                # Such as for want of what SROS 2 asks for.
                if not ok():
                    raise
                sys.exit(f"the node cannot start: {error}")
            for problem in unmatched_file_warnings(node.get_fully_qualified_name(), command_line):
                node.get_logger().warning(problem)
            _spin(executor, node)
        except Exception:
            # Whatever is half made when the context goes away may raise anything.
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
            except Exception:
                if ok():
                    node.get_logger().error(
                        f"unexpected error, going on: {traceback.format_exc()}",
                        throttle_duration_sec=5.0,
                    )
    finally:
        executor.shutdown()
        node.destroy_node()


def _collect_between_callbacks(node: Node) -> None:
    """Let no callback be held up by the collection of garbage.

    What there is by now, such as all modules, stays for good: looking through it takes as long as a
    frame does. What the callbacks leave behind is little, and collected by a timer.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    node.create_timer(_COLLECT_EVERY, gc.collect, clock=clock)


def _collect_all() -> None:
    """Collect the node, and with it what DDS has for it.

    What DDS has when the process ends is freed while its threads are still at work with it.
    """
    gc.unfreeze()
    gc.enable()
    gc.collect()
