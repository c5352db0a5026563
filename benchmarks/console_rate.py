"""Frame rate and latency of the console's page for a camera at 30 Hz, and its cost for the tracker.

Camera, tracker, console and a headless Chromium are separate processes on the loopback. The same
tracker is measured in six settings, in another order in each round:

1. without a console;
2. without a console, with a bare subscriber of the images, the lower bound of any display;
3. with a console;
4. with a client that receives the console's images like a page on another machine;
5. with a browser on this machine that shows the page;
6. with a browser behind a relay of 5 Mbit/s.

Each figure is the median over the rounds. The added processing time and age of the status are
percentiles over all frames of a setting, with 95 % intervals (bootstrap over the rounds). A frame
counts as shown when the animation frame after its drawing begins; its age counts from the stamp,
the time of publication. The images have the spectrum of natural images, so that their JPEG costs
are realistic.

    python benchmarks/console_rate.py --rounds 5 --seconds 10
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import rclpy
from arguments import at_least
from console_runs.scene import camera_like
from console_runs.watchers import page_of, receiver, relay
from diagnostic_msgs.msg import DiagnosticArray
from frame_loss import SIZES, START_TIMEOUT, Camera, moving_over, play
from node_runs.processes import bare_command, cpu_ms, process
from numpy.typing import NDArray
from playwright.sync_api import sync_playwright

from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.ros_domains import unused_domain

PORT = 8647
RELAY_PORT = 8648
RATE = 30.0
# Bootstrap samples of the rounds.
DRAWS = 2000
NO_CONSOLE, BARE, NO_BROWSER, ELSEWHERE, BROWSER, SLOW = (
    "no console",
    "no console, a bare subscriber",
    "no browser",
    "a browser elsewhere",
    "a browser",
    "a browser at 5 Mbit/s",
)
WAYS = (NO_CONSOLE, BARE, NO_BROWSER, ELSEWHERE, BROWSER, SLOW)
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-background-networking"]
Values = NDArray[np.float64]


class Row(NamedTuple):
    """Figures of a turn; times in milliseconds, NaN if not measured.

    Attributes:
        answered: Share of the frames with a status, percent.
        processing: Processing time of a frame, median.
        processing_99: Its 99th percentile.
        age: Age of the status, median.
        age_99: Its 99th percentile.
        tracker: CPU time of the tracker's process per frame.
        console: CPU time of the console's process per frame.
        shown: Frames per second on the page.
        shown_age: Time from stamp to screen, median.
        shown_age_99: Its 99th percentile.
    """

    answered: float
    processing: float
    processing_99: float
    age: float
    age_99: float
    tracker: float
    console: float
    shown: float = np.nan
    shown_age: float = np.nan
    shown_age_99: float = np.nan


class Turn(NamedTuple):
    """One turn.

    Attributes:
        row: Its figures.
        times: Processing time of each frame, milliseconds.
        ages: Age of each status, milliseconds.
    """

    row: Row
    times: Values
    ages: Values


class TimedCamera(Camera):
    """A camera that also records the processing times.

    Attributes:
        times: Milliseconds of each frame.
    """

    def __init__(self) -> None:
        super().__init__("reliable")
        self.times: list[float] = []
        self.create_subscription(DiagnosticArray, "pf_tracker/status", self._on_status, 1000)

    def _on_status(self, message: DiagnosticArray) -> None:
        values = {item.key: item.value for item in message.status[0].values}
        self.times.append(float(values["processing_time_ms"]))


@contextmanager
def node(module: str, *parameters: str) -> Iterator[int]:
    """A node of this package as a process, ended by SIGINT; yields its process id."""
    given = [word for parameter in parameters for word in ("-p", parameter)]
    command = [sys.executable, "-m", f"pf_tracker_ros.node.{module}", "--ros-args", *given]
    child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield child.pid
    finally:
        child.send_signal(signal.SIGINT)
        child.wait(START_TIMEOUT)


def wait_for_server() -> None:
    """Wait until the console serves its page, as its start is no cost of a frame."""
    deadline = time.monotonic() + START_TIMEOUT
    while True:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", PORT), 1.0):
            return
        if time.monotonic() > deadline:
            raise RuntimeError(f"the console does not serve within {START_TIMEOUT:g} s")
        time.sleep(0.1)


@contextmanager
def console_node(priority: str) -> Iterator[int]:
    """A console that serves its page; yields its process id."""
    with node("console.console_node", f"port:={PORT}", priority) as console:
        wait_for_server()
        yield console


def turn_of(
    way: str, frames: list[Any], seconds: float, tracker: int, browser: Any, *, priority: str
) -> Turn:
    """One turn of a setting, including its start; other arguments as for `measure`."""
    if way == NO_CONSOLE:
        return measure(frames, seconds, tracker)
    if way == BARE:
        with process(bare_command("reliable"), large_images=False):
            return measure(frames, seconds, tracker)
    with console_node(priority) as console:
        if way == NO_BROWSER:
            return measure(frames, seconds, tracker, console)
        if way == ELSEWHERE:
            with receiver(PORT):
                return measure(frames, seconds, tracker, console)
        with page_of(browser, PORT if way == BROWSER else RELAY_PORT) as page:
            return measure(frames, seconds, tracker, console, page)


def measure(
    frames: list[Any], seconds: float, tracker: int, console: int | None = None, page: Any = None
) -> Turn:
    """Measure one turn.

    Args:
        frames: Images of the camera.
        seconds: Duration.
        tracker: Process id of the tracker.
        console: Process id of the console, None without one.
        page: The open page, None without one.
    """
    camera = TimedCamera()
    processes = [tracker] if console is None else [tracker, console]
    before = [cpu_ms(process) for process in processes]
    figures = play(camera, frames, RATE, seconds)
    camera.destroy_node()  # type: ignore[no-untyped-call]
    costs = [
        (cpu_ms(process) - was) / len(camera.times)
        for process, was in zip(processes, before, strict=True)
    ]
    times = np.array(camera.times[len(camera.times) // 5 :])
    ages = 1e3 * np.array(figures.ages)
    row = Row(
        100.0 * len(figures.ages) / figures.published,
        *_middle_and_99(times),
        *_middle_and_99(ages),
        costs[0],
        costs[1] if console else np.nan,
    )
    if page is None:
        return Turn(row, times, ages)
    shown = np.array(page.evaluate("() => window.ages"), np.float64).reshape(-1, 2)
    shown = shown[shown[:, 0] > shown[-1, 0] - 1e3 * seconds]
    rate = (len(shown) - 1) / (shown[-1, 0] - shown[0, 0]) * 1e3
    middle, most = _middle_and_99(shown[:, 1])
    return Turn(row._replace(shown=rate, shown_age=middle, shown_age_99=most), times, ages)


def _middle_and_99(values: NDArray[np.float64]) -> tuple[float, float]:
    middle, most = np.percentile(values, [50, 99])
    return float(middle), float(most)


def _added(way: Sequence[Values], without: Sequence[Values]) -> Values:
    """(2,) increase of median and 99th percentile over the frames of all turns."""
    return np.subtract(*(_middle_and_99(np.concatenate(turns)) for turns in (way, without)))


def _added_cells(way: Sequence[Values], without: Sequence[Values]) -> list[str]:
    """`_added` with its 95 % interval."""
    random = np.random.default_rng(0)
    samples = [
        _added([way[round_] for round_ in rounds], [without[round_] for round_ in rounds])
        for rounds in random.integers(len(way), size=(DRAWS, len(way)))
    ]
    columns = zip(_added(way, without), *np.percentile(samples, [2.5, 97.5], axis=0), strict=True)
    return [f"{added:+.2f} [{low:+.2f}, {high:+.2f}]" for added, low, high in columns]


def print_table(turns: dict[str, list[Turn]]) -> None:
    """Print the medians, and the increase of each setting over that without a console."""
    rows = {name: [turn.row for turn in way] for name, way in turns.items()}
    columns = "answered | processing (ms) | answer's age (ms) | tracker's CPU a frame (ms) | "
    columns += "console's CPU a frame (ms) | shown a second | age shown (ms)"
    print(f"| median / 99 % | {columns} |\n{8 * '|---'}|")
    for name, way in rows.items():
        middle = Row(*np.median(np.array(way), axis=0))
        cells = [
            f"{middle.answered:.1f} %",
            f"{middle.processing:.1f} / {middle.processing_99:.1f}",
            f"{middle.age:.0f} / {middle.age_99:.0f}",
            f"{middle.tracker:.1f}",
            f"{middle.console:.1f}",
            f"{middle.shown:.1f}",
            f"{middle.shown_age:.0f} / {middle.shown_age_99:.0f}",
        ]
        print(f"| {name} | {' | '.join('-' if 'nan' in cell else cell for cell in cells)} |")
    print("\nWhat each adds to no console, in milliseconds, [95 %]:\n")
    print("| | processing, median | 99 % | answer's age, median | 99 % |\n|---|---|---|---|---|")
    for name in WAYS[1:]:
        cells = [
            cell
            for of in ("times", "ages")
            for cell in _added_cells(
                *([getattr(turn, of) for turn in turns[way]] for way in (name, NO_CONSOLE))
            )
        ]
        print(f"| {name} | {' | '.join(cells)} |")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print a table.

    Args:
        arguments: Command line without program name; None for the process'.
    """
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("--seconds", type=at_least(1), default=10, help="of each turn")
    parser.add_argument("--rounds", type=at_least(1), default=5, help="turns of each kind")
    parser.add_argument(
        "--realtime-priority",
        type=at_least(0),
        default=NodeParameters.realtime_priority,
        help="of tracker and console, which have none where the system does not permit it",
    )
    parser.add_argument("--size", choices=SIZES, default="768x576")
    given = parser.parse_args(arguments)
    chromium = shutil.which("chromium") or parser.error("needs Chromium: apt install chromium")
    frames = moving_over(camera_like(*SIZES[given.size]))
    turns: dict[str, list[Turn]] = defaultdict(list)
    with unused_domain() as domain, contextlib.ExitStack() as stack:
        os.environ |= {
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        box = "target_box:=[100.0, 100.0, 40.0, 40.0]"
        priority = f"realtime_priority:={given.realtime_priority}"
        tracker = stack.enter_context(
            node("tracker.tracker_node", box, "time_jump:=keep", priority)
        )
        rclpy.init()
        stack.callback(rclpy.try_shutdown)
        driver = stack.enter_context(sync_playwright())
        browser = driver.chromium.launch(executable_path=chromium, args=FLAGS)
        stack.enter_context(relay(RELAY_PORT, PORT))
        order = random.Random(0)
        for _ in range(given.rounds):
            for way in order.sample(WAYS, len(WAYS)):
                turns[way].append(
                    turn_of(way, frames, given.seconds, tracker, browser, priority=priority)
                )
        browser.close()
    print_table({way: turns[way] for way in WAYS})


if __name__ == "__main__":
    main()
