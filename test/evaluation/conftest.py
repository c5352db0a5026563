"""The command `evaluate` in its own process, and sequences for it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from common import run_command

import pf_tracker_ros
from pf_tracker_ros.evaluation.__main__ import main

PACKAGES = Path(pf_tracker_ros.__file__).parents[1]


@pytest.fixture
def evaluate(tmp_path, monkeypatch, capsys):
    """Runs the command in this process, in the test's folder; its exit code, output and errors."""
    # With it, Rich takes any output for a terminal.
    monkeypatch.delenv("FORCE_COLOR", raising=False)

    def run(*arguments):
        monkeypatch.chdir(tmp_path)
        return run_command(main, arguments, capsys)

    return run


@pytest.fixture
def start_evaluate(tmp_path):
    """Start the command in the test's folder; it is killed after the test."""
    processes = []

    def start(*arguments, stdout=subprocess.PIPE, **environment):
        process = subprocess.Popen(
            [sys.executable, "-m", "pf_tracker_ros.evaluation", *map(str, arguments)],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(PACKAGES), **environment},
            stdout=stdout,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        processes.append(process)
        return process

    yield start
    for process in processes:
        process.kill()
        process.communicate()


@pytest.fixture
def short_sequence(write_sequence, moving_square):
    """Five frames of the moving square."""
    return write_sequence("short", moving_square.images[:5], moving_square.boxes[:5])


@pytest.fixture(scope="session")
def long_sequence(write_sequence_in, moving_square, tmp_path_factory):
    """A sequence of the moving square, a hundred times as long as the short one."""
    there_and_back = np.r_[np.arange(20), np.arange(18, 0, -1)]
    order = np.resize(there_and_back, 500)
    images, boxes = moving_square.images[order], moving_square.boxes[order]
    return write_sequence_in(tmp_path_factory.mktemp("shared"), "walk", images, boxes)


@pytest.fixture
def long_sequences(long_sequence, tmp_path):
    """Two such sequences of the names walk and stroll, not to change."""
    for name in ("walk", "stroll"):
        folder = shutil.copytree(long_sequence, tmp_path / name, copy_function=os.link)
        (folder / "meta.json").unlink()
