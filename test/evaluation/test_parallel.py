"""Parallel tasks in worker processes."""

import multiprocessing
import time
from contextlib import closing

from common import run_python

from pf_tracker_ros.evaluation.parallel import WorkerEnded, run_parallel


def test_every_task_runs_once():
    assert sorted(run_parallel(abs, [-5, 6, -7, 8], 2)) == [(0, 5), (1, 6), (2, 7), (3, 8)]
    assert list(run_parallel(abs, [], 2)) == []


def test_a_worker_that_ends_fails_only_its_task():
    tasks = ["1 + 1", "__import__('os')._exit(5)", "2 + 2", "__import__('os').abort()", "3 + 3"]
    answers = dict(run_parallel(eval, tasks, 2))
    ended = {
        1: WorkerEnded("its process ended with code 5"),
        3: WorkerEnded("its process was ended by signal 6"),
    }
    assert answers == {0: 2, 2: 4, 4: 6, **ended}


def test_closing_kills_busy_workers():
    with closing(run_parallel(time.sleep, [0, 10_000, 10_000, 10_000], 2)) as done:
        assert next(done) == (0, None)
        assert len(multiprocessing.active_children()) == 2
    assert multiprocessing.active_children() == []


def test_sigint_and_sigterm_do_not_reach_workers():
    """In a new interpreter, as the first process that it starts is a special case."""
    program = """
from pf_tracker_ros.evaluation.parallel import run_parallel
look = "sorted(one.name for one in __import__('signal').pthread_sigmask(0, ()))"
answers = dict(run_parallel(eval, [look] * 3, 2))
assert answers == dict.fromkeys(range(3), ["SIGINT", "SIGTERM"]), answers
"""
    run_python(program, check=True)
