"""Nodes as processes, and their CPU time and memory."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from node_runs.moving_square import BOX

START_TIMEOUT = 30.0
TRACKER, BARE = "tracker", "bare subscriber"
# Names of the nodes.
NAMES = {TRACKER: "pf_tracker", BARE: "bare"}
PROFILE = Path(__file__).resolve().parents[2] / "config" / "fastdds_large_images.xml"
# glibc would give the memory of each image back and fetch it again, 2 ms a frame in a process that
# does nothing else. What the tracker keeps allocated prevents that, so it would seem to be free.
_MEMORY = {"MALLOC_TRIM_THRESHOLD_": "200000000", "MALLOC_MMAP_THRESHOLD_": "33000000"}


def tracker_command(*parameters: str, namespace: str = "/") -> list[str]:
    """The tracker with a target in the first frame.

    Args:
        parameters: More of them, `name:=value` each.
        namespace: Of the node.
    """
    given = [f"target_box:={list(BOX)}", *parameters]
    words = [word for parameter in given for word in ("-p", parameter)]
    module = "pf_tracker_ros.node.tracker.tracker_node"
    ros = ["--ros-args", "-r", f"__ns:={namespace}", "--log-level", "error", *words]
    return [sys.executable, "-m", module, *ros]


def bare_command(reliability: str) -> list[str]:
    """The bare subscriber, `reliable` or `best_effort`."""
    return [sys.executable, str(Path(__file__).with_name("bare_subscriber.py")), reliability]


@contextmanager
def process(command: list[str], *, large_images: bool = True) -> Iterator[subprocess.Popen[bytes]]:
    """A process, ended with SIGINT; raises RuntimeError if it ends with an error.

    Args:
        command: Of the process.
        large_images: Whether it has Fast DDS' profile for large images.
    """
    child = subprocess.Popen(command, env=os.environ | _MEMORY | profile(large_images))
    try:
        yield child
    finally:
        child.send_signal(signal.SIGINT)
        if child.wait(START_TIMEOUT) != 0:
            raise RuntimeError(f"{' '.join(command)} ended with code {child.returncode}")


def profile(large_images: bool) -> dict[str, str]:
    """The variable that gives a process Fast DDS' profile for large images, or nothing."""
    return {"FASTRTPS_DEFAULT_PROFILES_FILE": str(PROFILE)} if large_images else {}


def cpu_ms(process_id: int) -> float:
    """CPU time of a process until now, all threads, milliseconds."""
    # Linux' number for the CPU clock of another process, which counts nanoseconds where /proc
    # counts hundredths of a second.
    return 1e3 * time.clock_gettime((~process_id << 3) | 2)


def resident_megabytes(process_id: int) -> float:
    """Memory that a process holds, units of 10^6 bytes."""
    pages = int(Path(f"/proc/{process_id}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
