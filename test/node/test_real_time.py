"""The real-time priority of Fast DDS' threads in the processes of the tracker and the console."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pf_tracker_ros.node import real_time
from pf_tracker_ros.node.real_time import RealTimePriority

PROFILE = Path(__file__).resolve().parents[2] / "config" / "fastdds_large_images.xml"
ROUND_ROBIN = os.SCHED_RR | os.SCHED_RESET_ON_FORK
USUAL = os.SCHED_OTHER | os.SCHED_RESET_ON_FORK


class Kernel:
    """Takes note of what is set.

    Attributes:
        scheduled: Thread to (policy, priority).
        refusal: Raised for real-time priorities, if they are not permitted.
        ended: Threads that there are no more.
    """

    def __init__(self):
        self.scheduled = {}
        self.refusal = None
        self.ended = set()

    def set(self, thread, policy, parameters):
        if thread in self.ended:
            raise ProcessLookupError
        if parameters.sched_priority and self.refusal:
            raise self.refusal
        self.scheduled[thread] = (policy, parameters.sched_priority)

    def get(self, thread):
        if thread == 14:
            raise ProcessLookupError
        return self.scheduled.get(thread, (os.SCHED_OTHER, 0))[0]


@pytest.fixture
def kernel(monkeypatch, tmp_path):
    """What stands in for the system: threads 11 and 12 of DDS, 13 of somebody else."""
    kernel = Kernel()
    for thread, name in {11: "dds.shm.7411", 12: "dds.ev.0", 13: "python"}.items():
        (tmp_path / str(thread)).mkdir()
        (tmp_path / str(thread) / "comm").write_text(f"{name}\n")
    # One that has just ended.
    (tmp_path / "14").mkdir()
    (tmp_path / "14" / "comm").write_text("dds.udp.7400\n")
    monkeypatch.setattr(real_time, "_THREADS", tmp_path)
    monkeypatch.setattr(real_time.os, "sched_setscheduler", kernel.set)
    monkeypatch.setattr(real_time.os, "sched_getscheduler", kernel.get)
    return kernel


def test_the_threads_of_dds_have_it_and_no_others(kernel):
    priority = RealTimePriority(pytest.fail)
    priority.request_priority(7)
    assert kernel.scheduled == {11: (ROUND_ROBIN, 7), 12: (ROUND_ROBIN, 7)}
    assert priority.granted == 7
    priority.request_priority(0)
    assert kernel.scheduled == {11: (USUAL, 0), 12: (USUAL, 0)}
    assert priority.granted == 0


def test_a_thread_that_has_ended_keeps_no_other_from_it(kernel):
    priority = RealTimePriority(pytest.fail)
    kernel.ended = {11}
    priority.request_priority(1)
    assert kernel.scheduled == {12: (ROUND_ROBIN, 1)}
    assert priority.granted == 1


@pytest.mark.parametrize("refusal", [PermissionError(), OSError(errno.EINVAL, "not known")])
def test_what_is_not_permitted_is_told_once_for_each_time_that_it_is_asked_for(kernel, refusal):
    kernel.refusal = refusal
    told = []
    priority = RealTimePriority(told.append)
    for count in (1, 2):
        priority.request_priority(4)
        assert priority.granted == 0
        assert len(told) == count
        assert "real-time priority 4 is not permitted" in told[-1]
        assert "limits.conf" in told[-1]
    assert kernel.scheduled == {}


def test_a_thread_that_has_a_policy_already_keeps_it(kernel):
    given = (os.SCHED_RR, 50)
    kernel.scheduled = {11: given}
    priority = RealTimePriority(pytest.fail)
    priority.request_priority(1)
    assert kernel.scheduled == {11: given, 12: (ROUND_ROBIN, 1)}
    priority.request_priority(0)
    assert kernel.scheduled == {11: given, 12: (USUAL, 0)}


def is_permitted():
    """Whether a process here may have such a priority."""
    code = "import os; os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(5))"
    command = [sys.executable, "-c", code]
    return subprocess.run(command, stderr=subprocess.DEVNULL, check=False).returncode == 0


def policies(process):
    """Policy and priority of the threads of a process: of the first one, and of those of DDS."""
    own, of_dds = set(), set()
    for thread in Path(f"/proc/{process.pid}/task").iterdir():
        id = int(thread.name)
        policy = os.sched_getscheduler(id) & ~os.SCHED_RESET_ON_FORK
        found = (policy, os.sched_getparam(id).sched_priority)
        if id == process.pid:
            own.add(found)
        elif (thread / "comm").read_text().startswith("dds."):
            of_dds.add(found)
    return own, of_dds


def test_the_tracker_has_it_where_the_system_permits_it(graph, client):
    process = graph.process("-p", "realtime_priority:=5")
    told = client.wait_for(lambda: client.health, "diagnostics")[-1].values
    usual, raised = {(os.SCHED_OTHER, 0)}, {(os.SCHED_RR, 5)}
    if not is_permitted():
        assert told["realtime_priority"] == "0"
        assert "real-time priority 5 is not permitted" in told["last_error"]
        assert policies(process) == (usual, usual)
        return
    assert told["realtime_priority"] == "5"
    assert policies(process) == (usual, raised)
    client.set_parameters(realtime_priority=0)
    assert policies(process) == (usual, usual)


@pytest.mark.parametrize("profile", ["", str(PROFILE)])
def test_the_console_has_it_for_dds_where_a_camera_waits_and_it_is_permitted(
    graph, monkeypatch, profile
):
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", profile)
    pytest.importorskip("aiohttp", reason="the console needs the extra 'console'")
    process = graph.process(
        *("-p", "port:=0", "-p", "realtime_priority:=4"),
        module="pf_tracker_ros.node.console.console_node",
    )
    said = ""
    for line in process.stdout:
        said += line
        if "is at http" in line:
            break
    usual, raised = {(os.SCHED_OTHER, 0)}, {(os.SCHED_RR, 4)}
    asked = not profile
    assert policies(process) == (usual, raised if asked and is_permitted() else usual)
    assert ("priority 4 is not permitted" in said) == (asked and not is_permitted())


def test_a_tracker_has_none_unasked(graph, client):
    process = graph.process()
    told = client.wait_for(lambda: client.health, "diagnostics")[-1].values
    usual = {(os.SCHED_OTHER, 0)}
    assert (told["realtime_priority"], policies(process)) == ("0", (usual, usual))


def test_a_node_in_the_process_of_another_leaves_it_as_it_is(graph, client):
    before = os.sched_getscheduler(0)
    graph.tracker(client)
    assert os.sched_getscheduler(0) == before
