"""Nodes as processes and threads: garbage collection, signals, errors, end."""

import subprocess
import sys

import pytest
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.node import Node
from rclpy.waitable import NumberOfEntities, Waitable

from pf_tracker_ros.node.running import spin_until_shutdown

SCRIPT = """
import gc
import weakref

import rclpy
from rclpy.node import Node

from pf_tracker_ros.node import running

running._COLLECTION_PERIOD = 0.1


class Circle:
    def __init__(self):
        self.itself = self


class Probe(Node):
    def __init__(self):
        super().__init__("probe")
        self.inside, self.within = False, 0
        self.first = None
        gc.callbacks.append(self.count)
        self.create_timer(0.01, self.work)

    def count(self, phase, info):
        self.within += self.inside

    def work(self):
        self.inside = True
        circles = [Circle() for _ in range(5_000)]
        if self.first is None:
            self.first = weakref.ref(circles[0])
        del circles
        self.inside = False
        if self.first() is None:
            print("collected within callbacks:", self.within)
            rclpy.try_shutdown()


running.run(Probe, [])
"""


ENDED_AT_ONCE = """
import builtins
import os
import threading

import rclpy
from rclpy.node import Node

from pf_tracker_ros.node.running import run


class Probe(Node):
    def destroy_node(self):
        super().destroy_node()
        print("destroyed", flush=True)


class Last:
    def __del__(self, kill=os.kill, own=os.getpid(), write=os.write, numbers=(2, 15)):
        for number in numbers:
            kill(own, number)
        write(1, b"still there")


def create():
    node = Probe("probe")
    rclpy.try_shutdown()
    return node


# Builtins are destroyed last.
builtins.last = Last()
run(create, [])
print("threads:", threading.active_count(), flush=True)
"""


ENDED_AFTER_SPINNING = """
from pathlib import Path

import rclpy
from rclpy.lifecycle import LifecycleNode

from pf_tracker_ros.node.running import run


def threads():
    return {path.read_text().strip() for path in Path("/proc/self/task").glob("*/comm")}


class Probe(LifecycleNode):
    def __init__(self):
        super().__init__("probe")
        self.create_timer(0.01, self.end)

    def end(self):
        print("of DDS:", any(name.startswith("dds.ev") for name in threads()))
        rclpy.try_shutdown()


run(Probe, [])
# The watchdog of DDS stays; it belongs to no node.
print("of DDS:", {name for name in threads() if name.startswith("dds.")} - {"dds.shm.wdog"})
"""


REFUSED = """
from rclpy.impl.implementation_singleton import rclpy_implementation

from pf_tracker_ros.node.running import run


def create():
    raise rclpy_implementation.RCLError("without security libraries")


run(create, [])
"""


STARTED = "import sys; from pf_tracker_ros.node.running import run; run(None, sys.argv)"


def run(script, *arguments):
    """The ended process of a script."""
    command = [sys.executable, "-c", script, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def output_of(script):
    result = run(script)
    assert result.returncode == 0, result.stderr
    # Fast DDS also reports there what killed processes left in shared memory.
    lines = result.stdout.splitlines(keepends=True)
    return "".join(line for line in lines if "RTPS_TRANSPORT" not in line)


def test_garbage_is_collected_between_callbacks(ros_domain):
    assert output_of(SCRIPT) == "collected within callbacks: 0\n"


def test_a_node_that_never_spins_leaves_nothing_behind_and_late_signals_change_no_exit_code(
    ros_domain,
):
    assert output_of(ENDED_AT_ONCE) == "destroyed\nthreads: 1\nstill there"


def test_the_threads_of_dds_end_with_the_node(ros_domain):
    assert output_of(ENDED_AFTER_SPINNING) == "of DDS: True\nof DDS: set()\n"


def test_an_error_of_ros_at_start_up_ends_the_process_with_the_reason(ros_domain):
    result = run(REFUSED)
    assert result.returncode == 1
    assert result.stderr == "the node cannot start: without security libraries\n"


class Hook(Waitable):
    """Calls a function while the executor builds its wait set."""

    def __init__(self, call):
        super().__init__(ReentrantCallbackGroup())
        self._call = call

    def get_num_entities(self):
        self._call()
        return NumberOfEntities()

    def add_to_wait_set(self, wait_set):
        pass


@pytest.fixture
def hooked_node(ros_domain):
    """A function that makes a node with its own context, and with a call during each spin."""
    nodes = []

    def make(call):
        context = Context()
        rclpy.init(context=context, domain_id=ros_domain)
        nodes.append(Node("hooked", context=context, start_parameter_services=False))
        nodes[0].add_waitable(Hook(lambda: call(context)))
        return nodes[0]

    yield make
    for node in nodes:
        node.context.try_shutdown()
        node.destroy_node()


def test_a_shutdown_at_any_moment_ends_the_spinning(hooked_node):
    spin_until_shutdown(hooked_node(Context.try_shutdown))


def test_an_error_while_spinning_is_raised(hooked_node):
    def fail(context):
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"):
        spin_until_shutdown(hooked_node(fail))


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--loop"], "not understood after --ros-args: '--loop'; give names as -r FROM:=TO"),
        (["-p", "box:=[1, 2.5]"], "the ROS arguments cannot be read: "),
    ],
)
def test_invalid_ros_arguments_end_the_process_with_their_syntax(arguments, reason):
    done = run(STARTED, "--ros-args", *arguments)
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith(reason)
    assert "-p NAME:=VALUE" in last


def test_another_error_of_ros_is_not_one_of_the_arguments(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "abc")
    done = run(STARTED)
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith("ROS cannot start: ")
    assert "ROS_DOMAIN_ID is not an integral number" in last


def test_a_tracker_reports_once_a_second(graph):
    # Tests of the tracker receive several reports, at a shorter period.
    assert graph.tracker()._diagnostics._topic._timer.timer_period_ns == 10**9
