"""The real-time priority of the tracker's process."""

import os
import subprocess
import sys
import threading

import pytest

from pf_tracker_ros.node.tracker import real_time
from pf_tracker_ros.node.tracker.real_time import RealTimePriority

ROUND_ROBIN = os.SCHED_RR | os.SCHED_RESET_ON_FORK
USUAL = os.SCHED_OTHER | os.SCHED_RESET_ON_FORK


class Kernel:
    """Takes note of what is set.

    Attributes:
        scheduled: Thread to (policy, priority).
        is_permitting: Whether real-time priorities are permitted.
        asked: How often something was set.
    """

    def __init__(self):
        self.scheduled = {}
        self.is_permitting = True
        self.asked = 0
        self.ended = set()

    def set(self, thread, policy, parameters):
        self.asked += 1
        if thread in self.ended:
            raise ProcessLookupError
        if parameters.sched_priority and not self.is_permitting:
            raise PermissionError
        self.scheduled[thread] = (policy, parameters.sched_priority)


@pytest.fixture
def kernel(monkeypatch):
    kernel = Kernel()
    monkeypatch.setattr(real_time.os, "sched_setscheduler", kernel.set)
    return kernel


def test_all_threads_that_there_are_get_it_and_later_ones_do_not(kernel):
    priority = RealTimePriority(pytest.fail)
    there = {thread.native_id for thread in threading.enumerate()}
    done = threading.Event()
    later = threading.Thread(target=done.wait)
    later.start()
    priority.ask(7)
    done.set()
    later.join()
    assert there <= kernel.scheduled.keys()
    assert later.native_id not in kernel.scheduled
    assert set(kernel.scheduled.values()) == {(ROUND_ROBIN, 7)}
    assert priority.in_force == 7


def test_a_thread_that_has_ended_keeps_no_other_from_it(kernel):
    priority = RealTimePriority(pytest.fail)
    kernel.ended = {threading.main_thread().native_id}
    priority.ask(1)
    assert priority.in_force == 1


def test_it_is_given_up_while_there_is_no_time_left(kernel):
    priority = RealTimePriority(pytest.fail)
    priority.ask(3)
    priority.look(is_overloaded=True)
    assert set(kernel.scheduled.values()) == {(USUAL, 0)}
    assert priority.in_force == 0
    priority.look(is_overloaded=False)
    assert set(kernel.scheduled.values()) == {(ROUND_ROBIN, 3)}
    asked = kernel.asked
    priority.look(is_overloaded=False)
    assert kernel.asked == asked


def test_none_is_taken_where_none_is_asked_for(kernel):
    priority = RealTimePriority(pytest.fail)
    priority.ask(0)
    priority.look(is_overloaded=True)
    priority.look(is_overloaded=False)
    assert kernel.asked == 0


def test_what_is_not_permitted_is_told_once_for_each_time_that_it_is_asked_for(kernel):
    kernel.is_permitting = False
    told = []
    priority = RealTimePriority(told.append)
    for count in (1, 2):
        priority.ask(4)
        priority.look(is_overloaded=False)
        assert priority.in_force == 0
        assert len(told) == count
        assert "real-time priority 4 is not permitted" in told[-1]
        assert "limits.conf" in told[-1]


def is_permitted():
    """Whether a process here may have such a priority."""
    code = "import os; os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(5))"
    command = [sys.executable, "-c", code]
    return subprocess.run(command, stderr=subprocess.DEVNULL, check=False).returncode == 0


def policy_of(process):
    return os.sched_getscheduler(process.pid) & ~os.SCHED_RESET_ON_FORK


def test_the_process_has_it_where_the_system_permits_it(graph, client):
    process = graph.process("-p", "realtime_priority:=5")

    told = client.wait_for(lambda: client.health, "diagnostics")[-1].values
    if not is_permitted():
        assert told["realtime_priority"] == "0"
        assert "real-time priority 5 is not permitted" in told["last_error"]
        assert policy_of(process) == os.SCHED_OTHER
        return
    assert told["realtime_priority"] == "5"
    assert policy_of(process) == os.SCHED_RR
    assert os.sched_getparam(process.pid).sched_priority == 5
    client.set_parameters(realtime_priority=0)
    assert policy_of(process) == os.SCHED_OTHER


def test_a_node_in_the_process_of_another_leaves_it_as_it_is(graph, client):
    before = os.sched_getscheduler(0)
    graph.tracker(client)
    assert os.sched_getscheduler(0) == before
