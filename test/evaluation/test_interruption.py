"""Evaluations that are interrupted."""

import json
import os
import signal
from pathlib import Path

import pytest
from subprocesses import is_running, processes_below, wait_until

pytestmark = pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="looks at /proc")


@pytest.fixture
def half_done(start_evaluate, short_sequence, long_sequences, tmp_path):
    """Start an evaluation and wait until the first of three sequences is done."""

    def start(jobs):
        process = start_evaluate(
            *("short", "walk", "stroll", "--seeds", "20", "--jobs", jobs, "--output", "r.json")
        )
        wait_until((tmp_path / "r.json").exists)
        return process

    return start


@pytest.mark.parametrize(
    ("jobs", "to_all", "number"),
    [
        # Each pair of them.
        (1, False, signal.SIGINT),
        (1, True, signal.SIGTERM),
        (2, False, signal.SIGTERM),
        (2, True, signal.SIGINT),
    ],
)
def test_a_signal_ends_all_processes_and_keeps_results(half_done, tmp_path, jobs, to_all, number):
    word = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}[number]
    process = half_done(jobs)
    workers = list(processes_below(process.pid, "spawn_main"))
    assert len(workers) == (0 if jobs == 1 else 2)
    (os.killpg if to_all else os.kill)(process.pid, number)
    output, errors = process.communicate(timeout=120)
    assert (output, errors) == ("", f"evaluate: {word}\n")
    assert process.returncode == 128 + number
    assert not any(map(is_running, workers))
    assert list(json.loads((tmp_path / "r.json").read_text())["sequences"]) == ["short"]
    assert {path.name for path in tmp_path.iterdir()} == {"short", "walk", "stroll", "r.json"}


def test_workers_end_when_their_parent_is_killed(half_done):
    process = half_done(2)
    workers = list(processes_below(process.pid, "spawn_main"))
    assert len(workers) == 2
    process.kill()
    wait_until(lambda: not any(map(is_running, workers)))


def test_a_killed_worker_fails_its_sequence(
    start_evaluate, short_sequence, long_sequences, tmp_path
):
    process = start_evaluate("walk", "short", "--seeds", "20", "--jobs", "2", "--output", "r.json")
    wait_until((tmp_path / "r.json").exists)
    for worker in list(processes_below(process.pid, "spawn_main")):
        os.kill(worker, signal.SIGKILL)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 1
    assert errors.startswith("evaluate: error: walk: one of 2 processes ended unexpec")
    assert list(json.loads((tmp_path / "r.json").read_text())["sequences"]) == ["short"]
