"""The command `track` in this process or in one of its own, and what it is run on."""

import csv
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import pf_tracker_ros
from pf_tracker_ros.recordings.__main__ import main

QUICK = ("--preset", "li2007", "--parameter", "particles=20")
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


@pytest.fixture
def archive(write_sequence, moving_square, tmp_path):
    """Ten recordings and three that are broken, each in another way; the folder."""
    folder = tmp_path / "archive"
    for number in range(10):
        parent = folder / f"day_{number % 2}"
        write_sequence(f"drive_{number}", moving_square.images, moving_square.boxes, parent)
    target = "target_box: [20, 30, 24, 24]"
    images = write_sequence("pictures", moving_square.images, moving_square.boxes, folder)
    (images / "img").rename(folder / "shots")
    shutil.rmtree(images)
    (folder / "shots.target.yaml").write_text(target.replace("20, 30", "900, 30"))
    (folder / "noise.mp4").write_bytes(b"\x00no video")
    (folder / "noise.target.yaml").write_text(target)
    broken = write_sequence("broken", moving_square.images, moving_square.boxes, folder)
    (broken / "img" / "0013.png").write_bytes(b"no picture")
    return folder


@pytest.fixture
def serial(archive, track, tmp_path):
    """What one process finds in the archive; the folder, and what was said."""
    output = tmp_path / "serial"
    return output, track("--archive", archive, "--output", output, *QUICK)


class Watch:
    """Looks at an archive's output folder, and at the processes that write into it."""

    @classmethod
    def boxes(cls, output):
        """Name of a recording to the bytes of its boxes, of all that is not hidden."""
        found = {path.relative_to(output): path for path in output.rglob("boxes.csv")}
        return {
            str(name.parent): path.read_bytes()
            for name, path in found.items()
            if not any(part.startswith(".") for part in name.parts)
        }

    @classmethod
    def assert_whole(cls, output):
        """All that is not hidden is whole."""
        for name, content in cls.boxes(output).items():
            assert (output / name / "done.json").is_file()
            assert content.count(b"\n") == 21

    @classmethod
    def wait_for_results(cls, output, count):
        """Until so many recordings are done."""
        cls._wait(lambda: len(list(output.glob("day_?/drive_*/done.json"))) >= count)

    @classmethod
    def kill_worker(cls, driver, name):
        """Kill a process below the driver that has a name in its command line."""
        found = []
        cls._wait(lambda: found.extend(cls.below(driver.pid, name)) or found)
        os.kill(found[0], signal.SIGKILL)

    @classmethod
    def below(cls, pid, name):
        """The processes below one, at any depth, with a name in their command line."""
        for child in _read(pid, f"task/{pid}/children").split():
            yield from cls.below(int(child), name)
            if name in _read(child, "cmdline"):
                yield int(child)

    @staticmethod
    def _wait(condition):
        deadline = time.monotonic() + 120
        while not condition():
            assert time.monotonic() < deadline
            time.sleep(0.005)


@pytest.fixture
def watch():
    """Looks at what an archive's processes do."""
    return Watch()


def _read(pid, name):
    try:
        return Path(f"/proc/{pid}/{name}").read_text()
    except OSError:
        return ""
