"""An archive on a Ray cluster: its cost, and its results while workers and driver are killed.

The recordings are generated streets, every fourteenth of them broken. They are tracked:

1. serially;
2. by two workers of a local Ray cluster, for comparison of the time;
3. by two workers while one is killed (-9) every few seconds, and the driver at random times. The
   driver is restarted until it is done. After each kill and at the end, the results must be
   complete and equal to those of the serial run.

    python benchmarks/archive.py --recordings 40 --kills 20
"""

from __future__ import annotations

import argparse
import itertools
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import arguments as options_of
import cv2
import numpy as np
from arguments import at_least
from numpy.typing import NDArray
from scenes import ClutteredStreet
from scenes.clutter import FRAME_INTERVAL, HEIGHT, WIDTH

BROKEN_EVERY = 14
SCENE_FRAMES = 150
WORKER_KILLED_EVERY = 5.0
TRACK = (sys.executable, "-m", "pf_tracker_ros.recordings")


def main() -> None:
    """Run all three and print the results."""
    options = arguments()
    generator = random.Random(options.seed)
    with tempfile.TemporaryDirectory(prefix="archive_", dir=options.scratch) as folder:
        archive = Path(folder) / "archive"
        broken = write_recordings(archive, options.recordings, options.frames)
        print(f"{options.recordings} recordings, {broken} of them broken")
        serial = seconds_of(start(archive, Path(folder) / "serial"))
        print(f"serial: {serial:.1f} s")
        ray = ("--ray", "local", "--jobs", "2")
        parallel = seconds_of(start(archive, Path(folder) / "ray", *ray))
        print(f"two Ray workers: {parallel:.1f} s, {parallel / serial:.2f} of the serial run")
        expected = results(Path(folder) / "serial")
        assert len(expected) == options.recordings - broken
        assert results(Path(folder) / "ray") == expected
        print("the same files, byte by byte")
        output = Path(folder) / "killed"
        workers = 0
        for number in range(options.kills):
            driver = start(archive, output, *ray)
            workers += kill_workers(driver, generator, generator.uniform(1.0, parallel / 3))
            driver.kill()
            driver.wait()
            done = assert_part(results(output), expected)
            print(f"kill {number + 1}: {done} of {len(expected)} done, all whole")
            if done == len(expected):
                # Again from the start, so that every kill interrupts something.
                shutil.rmtree(output)
        driver = start(archive, output, *ray)
        workers += kill_workers(driver, generator, 20.0 * parallel)
        assert driver.wait() == 1
        assert results(output) == expected
        assert not list(output.rglob(".track_*"))
        print(
            f"{options.kills} drivers and {workers} workers killed: "
            "the same files, byte by byte, and no others"
        )


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = options_of.parser(__doc__)
    parser.add_argument("--recordings", type=at_least(2), default=40, metavar="N", help="[40]")
    parser.add_argument(
        "--frames", type=at_least(10), default=500, metavar="N", help="of each recording [500]"
    )
    parser.add_argument(
        "--kills", type=at_least(0), default=20, metavar="N", help="of the driver [20]"
    )
    parser.add_argument("--seed", type=at_least(0), default=0, help="of the kills' times [0]")
    parser.add_argument("--scratch", metavar="DIR", help="parent of the working folder")
    return parser.parse_args()


def write_recordings(archive: Path, count: int, frames: int) -> int:
    """Write videos with their target files; returns how many are broken."""
    archive.mkdir()
    broken = 0
    for number in range(count):
        scene = ClutteredStreet(number, {"clutter": 0.3, "frames": min(frames, SCENE_FRAMES)})
        path = archive / f"street_{number:02d}.mp4"
        codec = cv2.VideoWriter.fourcc(*"mp4v")
        video = cv2.VideoWriter(str(path), codec, 1.0 / FRAME_INTERVAL, (WIDTH, HEIGHT))
        for image in itertools.islice(there_and_back(scene), frames):
            video.write(image)
        video.release()
        path.with_suffix(".target.yaml").write_text(
            f"target_box: {scene.target_boxes[0].tolist()}\nimage_size: [{WIDTH}, {HEIGHT}]\n"
        )
        if number % BROKEN_EVERY == BROKEN_EVERY // 2:
            path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
            broken += 1
    return broken


def there_and_back(scene: ClutteredStreet) -> Iterator[NDArray[np.uint8]]:
    """A scene's frames, then the same backwards, and so on."""
    frames = list(scene.frames())
    return itertools.cycle(frames + frames[-2:0:-1])


def start(archive: Path, output: Path, *further: str) -> subprocess.Popen[bytes]:
    """Start the driver."""
    command = (*TRACK, "--archive", str(archive), "--output", str(output), *further)
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def seconds_of(driver: subprocess.Popen[bytes]) -> float:
    """Wait for a driver; returns its duration."""
    began = time.monotonic()
    code = driver.wait()
    assert code == 1, f"exit code {code}; 1 is that of an archive with broken recordings"
    return time.monotonic() - began


def results(output: Path) -> dict[str, bytes]:
    """Name to content of the results, without hidden files and the manifest."""
    return {
        str(path.relative_to(output)): path.read_bytes()
        for path in output.glob("*/boxes.csv")
        if not path.parent.name.startswith(".")
    }


def assert_part(found: dict[str, bytes], expected: dict[str, bytes]) -> int:
    """Assert that all present files are as expected; returns their number."""
    for name, content in found.items():
        assert content == expected[name], f"{name} differs"
    return len(found)


def kill_workers(driver: subprocess.Popen[bytes], generator: random.Random, seconds: float) -> int:
    """Kill a worker every few seconds until a time or the driver's end; returns the number."""
    killed, until = 0, time.monotonic() + seconds
    due = time.monotonic() + WORKER_KILLED_EVERY
    while driver.poll() is None and time.monotonic() < until:
        time.sleep(0.05)
        if time.monotonic() > due:
            due += WORKER_KILLED_EVERY
            found = list(at_work(driver.pid))
            killed += bool(found) and kill(generator.choice(found))
    return killed


def at_work(pid: int) -> Iterator[int]:
    """Descendant Ray workers of a process that have a task."""
    for child in children(pid):
        if read(child, "cmdline").startswith("ray::do_task"):
            yield child
        yield from at_work(child)


def children(pid: int) -> list[int]:
    """Child processes of a process."""
    return [int(child) for child in read(pid, f"task/{pid}/children").split()]


def read(pid: int, name: str) -> str:
    """A file of a process in /proc; empty if the process has ended."""
    try:
        return Path(f"/proc/{pid}/{name}").read_text()
    except OSError:
        return ""


def kill(pid: int) -> bool:
    """Kill a process; returns whether it was still running."""
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True


if __name__ == "__main__":
    main()
