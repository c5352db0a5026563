"""An archive on a Ray cluster: the same results, even if processes are killed."""

import contextlib
import dataclasses
import json
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from archives import assert_whole, boxes_in, kill_worker, options_of, wait_for_results
from common import QUICK
from subprocesses import processes_below

from pf_tracker_ros.evaluation.parallel import WorkerEnded
from pf_tracker_ros.recordings import RecordingError
from pf_tracker_ros.recordings.archives.results_folder import ResultsFolder
from pf_tracker_ros.recordings.archives.tasks import make_tasks, required_memory, run_tasks

needs_ray = pytest.mark.skipif(
    subprocess.run(
        [sys.executable, "-c", "import ray"], capture_output=True, check=False
    ).returncode,
    reason="needs ray",
)


@pytest.fixture
def start_on_ray(start_track, archive, monkeypatch, tmp_path):
    """Starts the archive on two workers of its own cluster."""
    # Ray keeps its authentication token there.
    monkeypatch.setenv("HOME", str(tmp_path))

    def start(output):
        ray = ("--ray", "local", "--jobs", 2)
        return start_track("--archive", archive, "--output", output, *ray, *QUICK)

    return start


@needs_ray
def test_killed_workers_and_a_killed_driver_cost_only_the_recordings_in_progress(
    serial, start_on_ray, tmp_path
):
    output = tmp_path / "out"
    driver = start_on_ray(output)
    for count in (1, 3):
        wait_for_results(output, count)
        kill_worker(driver, "ray::do_task")
    wait_for_results(output, 5)
    assert_whole(output)
    driver.kill()
    driver.communicate()
    assert_whole(output)
    done = boxes_in(output)
    # A damaged recording has boxes as well, and is tried again.
    whole = [
        name for name in done if not json.loads((output / name / "done.json").read_text())["error"]
    ]
    assert driver.returncode == -signal.SIGKILL
    driver = start_on_ray(output)
    said, errors = driver.communicate(timeout=120)
    assert driver.returncode == 1
    tracked, before = re.search(r"(\d+) tracked, (\d+) up to date, 3 failed", said).groups()
    assert int(tracked) + int(before) == 10
    assert int(before) >= len(whole) > 0
    assert len(done) >= 5
    assert boxes_in(output) == boxes_in(serial[0])
    assert done.items() <= boxes_in(output).items()
    assert sorted(line for line in errors.splitlines() if line.startswith("track: ")) == sorted(
        serial[1][2].splitlines()
    )
    names = [entry["name"] for entry in json.loads((serial[0] / "archive.json").read_text())]
    manifest = json.loads((output / "archive.json").read_text())
    assert [entry["name"] for entry in manifest] == names
    assert not list(output.rglob(".archive_*"))


@needs_ray
def test_ctrl_c_ends_the_cluster_which_listens_on_the_loopback_only(start_on_ray, tmp_path):
    output = tmp_path / "out"
    driver = start_on_ray(output)
    wait_for_results(output, 1)
    processes = [driver.pid, *processes_below(driver.pid, "ray")]
    assert len(processes) > 3
    addresses = [address for pid in processes for address in listening(pid)]
    assert addresses
    assert {address for address in addresses if not address.startswith("127.")} == set()
    driver.send_signal(signal.SIGINT)
    _, errors = driver.communicate(timeout=60)
    assert_whole(output)
    assert not list(output.rglob(".archive_*"))
    assert driver.returncode == 130
    assert "track: error: interrupted; unfinished files were discarded\n" in errors


def listening(pid):
    """The addresses at which a process listens."""
    links = set()
    # The process may have ended.
    with contextlib.suppress(OSError):
        links = {str(path.readlink()) for path in Path(f"/proc/{pid}/fd").iterdir()}
    for name, family, size in (("tcp", socket.AF_INET, 4), ("tcp6", socket.AF_INET6, 16)):
        with Path(f"/proc/net/{name}").open() as file:
            for line in list(file)[1:]:
                _, local, _, state, *rest = line.split()
                if state == "0A" and f"socket:[{rest[5]}]" in links:
                    words = bytes.fromhex(local.split(":")[0])
                    octets = b"".join(words[i : i + 4][::-1] for i in range(0, size, 4))
                    yield socket.inet_ntop(family, octets).removeprefix("::ffff:")


@needs_ray
def test_without_a_cluster_it_says_how_to_start_one(start_track, archive, tmp_path):
    address = "127.0.0.1:1"
    process = start_track(
        "--archive", archive, "--output", tmp_path / "out", "--ray", address, *QUICK
    )
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert f"there is no Ray cluster at {address} (" in errors
    assert errors.endswith("or use --ray local to start one on this machine\n")


class LossyExecutor:
    """Runs tasks in this process, and reports for some that their worker has ended.

    Attributes:
        rounds: Names of the tasks of each round.
    """

    workers = 1

    def __init__(self, is_lost):
        self._is_lost = is_lost
        self.rounds = []

    def run(self, work, tasks):
        self.rounds.append([task.name for task in tasks])
        for number, task in enumerate(tasks):
            lost = self._is_lost(task.name, len(self.rounds))
            yield number, WorkerEnded("its worker was lost") if lost else work(task)


@pytest.fixture
def tasks(own_archive, tmp_path):
    """Three tasks in a locked folder."""
    recordings = {f"drive_{n}": own_archive / f"day_{n % 2}" / f"drive_{n}" for n in range(3)}
    with ResultsFolder(tmp_path / "out").locked() as results:
        yield make_tasks(recordings, results, options_of(*QUICK))


def test_lost_tasks_are_repeated_as_long_as_others_complete(tasks):
    # The last task completes after more rounds than are allowed without a completed task.
    order = {task.name: 3 * number + 1 for number, task in enumerate(tasks)}
    executor = LossyExecutor(lambda name, number: number < order[name])
    found = {task.name: entry for task, entry in run_tasks(tasks, executor)}
    assert len(executor.rounds) == 7
    assert {entry.exit_code for entry in found.values()} == {0}


def test_a_recording_that_ends_every_worker_is_reported_and_does_not_stop_the_others(tasks):
    executor = LossyExecutor(lambda name, number: name == "drive_1")
    found = {task.name: entry for task, entry in run_tasks(tasks, executor)}
    assert [entry.exit_code for _, entry in sorted(found.items())] == [0, 1, 0]
    assert found["drive_1"].error.endswith("drive_1: its worker was lost, 4 times in a row")
    assert executor.rounds[1:] == [["drive_1"]] * 4


def test_a_worker_of_another_version_folder_or_run_does_not_write(tasks, tmp_path):
    elsewhere = dataclasses.replace(tasks[0].results, path=tmp_path / "unshared")
    for changed, reason in (
        ({"version": "0.0.1"}, ", not 0.0.1; install the same everywhere"),
        ({"results": elsewhere}, "give a folder that all machines share"),
    ):
        others = [dataclasses.replace(task, **changed) for task in tasks]
        found = dict(run_tasks(others, LossyExecutor(lambda name, number: False)))
        assert len(found) == len(tasks)
        for entry in found.values():
            assert (entry.exit_code, reason in entry.error) == (1, True), entry.error
    former = dataclasses.replace(tasks[0].results, run="former")
    with pytest.raises(RecordingError, match="another run is writing into"):
        former.put(tmp_path, "drive_0")
    assert not (tmp_path / "unshared").exists()
    assert not list((tmp_path / "out").glob("drive_*"))


def test_the_required_memory_depends_on_the_image_size_and_the_outputs(tasks, own_archive):
    task = tasks[0]
    (own_archive / "day_0" / "drive_0.target.yaml").write_text(
        "target_box: [20, 30, 24, 24]\nimage_size: [640, 480]\n"
    )
    plain = required_memory(task)
    assert 200e6 < plain < 300e6
    full = dataclasses.replace(task, options=options_of(*QUICK, "--video", "--report"))
    assert required_memory(full) > 1.5 * plain
    # Large images are assumed where the size is unknown.
    assert required_memory(tasks[1]) > 1.5 * plain
