"""The command `track` in this process or in one of its own, and what it is run on."""

import csv
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pf_tracker_ros
from pf_tracker_ros.recordings.__main__ import main

PACKAGES = Path(pf_tracker_ros.__file__).parents[1]


@pytest.fixture
def track(capsys):
    """Runs the command in this process; returns its exit code, what it said, and its errors."""

    def run(*arguments):
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as ended:
            code = ended.code
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


@pytest.fixture
def start_track(tmp_path):
    """Starts the command as a process; what still runs after the test is killed."""
    processes = []

    def start(*arguments):
        process = subprocess.Popen(
            [sys.executable, "-m", "pf_tracker_ros.recordings", *map(str, arguments)],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(PACKAGES)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        processes.append(process)
        return process

    yield start
    for process in processes:
        process.kill()
        process.communicate()


@pytest.fixture
def rows():
    """Reads boxes.csv of a folder."""

    def read(folder):
        with (folder / "boxes.csv").open(newline="") as file:
            return list(csv.DictReader(file))

    return read


@pytest.fixture
def long_sequence(write_sequence, moving_square):
    """The moving square there and back, for a thousand frames."""
    order = np.resize(np.r_[np.arange(20), np.arange(18, 0, -1)], 1000)
    return write_sequence("walk", moving_square.images[order], moving_square.boxes[order])
