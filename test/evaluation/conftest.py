"""The command `evaluate` in its own process, and sequences for it."""

import os
import shutil
from functools import partial

import pytest
from common import run_command

from pf_tracker_ros.evaluation.__main__ import main


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
def start_evaluate(start_module):
    """Start the command in the test's folder; it is killed after the test."""
    return partial(start_module, "evaluation")


@pytest.fixture
def write_short(write_sequence, moving_square):
    """Writes the first frames of the moving square."""

    def write(name, count=5, **options):
        return write_sequence(
            name, moving_square.images[:count], moving_square.boxes[:count], **options
        )

    return write


@pytest.fixture
def short_sequence(write_short):
    """Five frames of the moving square."""
    return write_short("short")


@pytest.fixture(scope="session")
def long_sequence(write_sequence_in, walk, tmp_path_factory):
    return write_sequence_in(tmp_path_factory.mktemp("shared"), "walk", *walk(500))


@pytest.fixture
def long_sequences(long_sequence, tmp_path):
    """Two sequences a hundred times as long as the short one, walk and stroll; not to change."""
    for name in ("walk", "stroll"):
        folder = shutil.copytree(long_sequence, tmp_path / name, copy_function=os.link)
        (folder / "meta.json").unlink()
