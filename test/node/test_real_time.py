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
DEFAULT = os.SCHED_OTHER | os.SCHED_RESET_ON_FORK


class Kernel:
    """Records the scheduling of threads.

    Attributes:
        scheduled: Thread to (policy, priority).
        refusal: Error raised for real-time priorities, None to permit them.
        ended: Threads that have ended.
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
    """A stand-in for the system: threads 11 and 12 of DDS, 13 of Python."""
    kernel = Kernel()
    for thread, name in {11: "dds.shm.7411", 12: "dds.ev.0", 13: "python"}.items():
        (tmp_path / str(thread)).mkdir()
        (tmp_path / str(thread) / "comm").write_text(f"{name}\n")
    # A thread that has just ended.
    (tmp_path / "14").mkdir()
    (tmp_path / "14" / "comm").write_text("dds.udp.7400\n")
    monkeypatch.setattr(real_time, "_THREADS", tmp_path)
    monkeypatch.setattr(real_time.os, "sched_setscheduler", kernel.set)
    monkeypatch.setattr(real_time.os, "sched_getscheduler", kernel.get)
    return kernel


def test_only_the_threads_of_dds_have_the_priority(kernel):
    priority = RealTimePriority(pytest.fail)
    priority.request_priority(7)
    assert kernel.scheduled == {11: (ROUND_ROBIN, 7), 12: (ROUND_ROBIN, 7)}
    assert priority.granted == 7
    priority.request_priority(0)
    assert kernel.scheduled == {11: (DEFAULT, 0), 12: (DEFAULT, 0)}
    assert priority.granted == 0


def test_an_ended_thread_is_skipped(kernel):
    priority = RealTimePriority(pytest.fail)
    kernel.ended = {11}
    priority.request_priority(1)
    assert kernel.scheduled == {12: (ROUND_ROBIN, 1)}
    assert priority.granted == 1


@pytest.mark.parametrize("refusal", [PermissionError(), OSError(errno.EINVAL, "not known")])
def test_each_refused_request_is_reported_once(kernel, refusal):
    kernel.refusal = refusal
    reports = []
    priority = RealTimePriority(reports.append)
    for count in (1, 2):
        priority.request_priority(4)
        assert priority.granted == 0
        assert len(reports) == count
        assert "real-time priority 4 is not permitted" in reports[-1]
        assert "limits.conf" in reports[-1]
    assert kernel.scheduled == {}


def test_a_thread_with_another_policy_keeps_it(kernel):
    given = (os.SCHED_RR, 50)
    kernel.scheduled = {11: given}
    priority = RealTimePriority(pytest.fail)
    priority.request_priority(1)
    assert kernel.scheduled == {11: given, 12: (ROUND_ROBIN, 1)}
    priority.request_priority(0)
    assert kernel.scheduled == {11: given, 12: (DEFAULT, 0)}


def is_permitted():
    """Whether this system permits a real-time priority."""
    code = "import os; os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(5))"
    command = [sys.executable, "-c", code]
    return subprocess.run(command, stderr=subprocess.DEVNULL, check=False).returncode == 0


def policies(process):
    """Policies and priorities of a process: of its main thread, and of the threads of DDS."""
    own, dds = set(), set()
    for thread in Path(f"/proc/{process.pid}/task").iterdir():
        id = int(thread.name)
        policy = os.sched_getscheduler(id) & ~os.SCHED_RESET_ON_FORK
        found = (policy, os.sched_getparam(id).sched_priority)
        if id == process.pid:
            own.add(found)
        elif (thread / "comm").read_text().startswith("dds."):
            dds.add(found)
    return own, dds


@pytest.mark.slow
def test_the_tracker_has_the_priority_if_the_system_permits_it(graph, client):
    process = graph.process("-p", "realtime_priority:=5")
    values = client.wait_for(lambda: client.health, "diagnostics")[-1].values
    normal, raised = {(os.SCHED_OTHER, 0)}, {(os.SCHED_RR, 5)}
    if not is_permitted():
        assert values["realtime_priority"] == "0"
        assert "real-time priority 5 is not permitted" in values["last_error"]
        assert policies(process) == (normal, normal)
        return
    assert values["realtime_priority"] == "5"
    assert policies(process) == (normal, raised)
    client.set_parameters(realtime_priority=0)
    assert policies(process) == (normal, normal)


@pytest.mark.slow
@pytest.mark.parametrize("profile", ["", str(PROFILE)])
def test_the_console_has_the_priority_without_the_profile_if_permitted_and_is_nice(
    graph, monkeypatch, profile
):
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", profile)
    pytest.importorskip("aiohttp", reason="the console needs the extra 'console'")
    from pf_tracker_ros.node.console import console_node

    process = graph.process(
        *("-p", "port:=0", "-p", "realtime_priority:=4"),
        module="pf_tracker_ros.node.console.console_node",
    )
    log = ""
    for line in process.stdout:
        log += line
        if "is at http" in line:
            break
    # Only the threads that a camera waits for keep their niceness.
    own, of_dds = os.getpriority(os.PRIO_PROCESS, 0), set()
    for task in Path(f"/proc/{process.pid}/task").iterdir():
        if (task / "comm").read_text().startswith("dds."):
            of_dds.add(os.getpriority(os.PRIO_PROCESS, int(task.name)))
    nice = min(19, own + console_node.NICENESS)
    assert os.getpriority(os.PRIO_PROCESS, process.pid) == nice
    assert of_dds == {nice if profile else own}
    normal, raised = {(os.SCHED_OTHER, 0)}, {(os.SCHED_RR, 4)}
    requested = not profile
    assert policies(process) == (normal, raised if requested and is_permitted() else normal)
    assert ("priority 4 is not permitted" in log) == (requested and not is_permitted())


def test_a_node_without_its_own_process_sets_no_priority(graph, client):
    before = os.sched_getscheduler(0)
    graph.tracker(client)
    assert os.sched_getscheduler(0) == before
