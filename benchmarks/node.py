"""The tracker node compared with a bare subscriber: lost frames, age, CPU time, memory, start.

Camera, tracker and bare subscriber are separate processes on the loopback. The camera publishes at
a constant rate. A frame is answered when a status of the tracker, or a header of the bare
subscriber, has its stamp. Both take turns, so that other load slows both. What the node
adds is the CPU time of the tracker's process without that of `Tracker.update`, which its status
tells, and without that of the bare subscriber.

    python benchmarks/node.py --seconds 10
"""

from __future__ import annotations

import argparse
import itertools
import os
import signal
import subprocess
import sys
import time
from array import array
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import arguments as options_of
import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image
from std_msgs.msg import Header
from tables import Table

from pf_tracker_ros.node.running import run
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.ros_domains import unused_domain
from pf_tracker_ros.stamps import stamp_of

SIZES = {"640x480": (640, 480), "768x576": (768, 576), "1920x1080": (1920, 1080)}
RELIABILITIES = ("reliable", "best_effort")
RATE = 30.0
START_TIMEOUT = 30.0
WARM_UP_SECONDS = 2.0
LAST_ANSWER_SECONDS = 1.0
ANSWERS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
TRACKER, BARE = "tracker", "bare subscriber"
PROFILE = Path(__file__).resolve().parents[1] / "config" / "fastdds_large_images.xml"
# glibc would give the memory of each image back and fetch it again, 2 ms a frame in a process that
# does nothing else. What the tracker keeps allocated prevents that, so it would seem to be free.
_MEMORY = {"MALLOC_TRIM_THRESHOLD_": "200000000", "MALLOC_MMAP_THRESHOLD_": "33000000"}


class BareSubscriber(Node):
    """Publishes the header of every image."""

    def __init__(self, reliability: str) -> None:
        super().__init__("bare")
        quality = QoSProfile(depth=1, reliability=ReliabilityPolicy[reliability.upper()])
        publisher = self.create_publisher(Header, "~/answer", ANSWERS)
        self.create_subscription(Image, "image", lambda m: publisher.publish(m.header), quality)


@dataclass(frozen=True)
class Figures:
    """Figures of the frames of a turn, after the warm-up."""

    published: int  # number of frames
    ages: list[float]  # seconds from publishing to the answer, of each answered frame
    cpu_a_frame: float  # CPU milliseconds of the process for each frame that was published
    update_a_frame: float  # milliseconds of the tracker's updates for each frame, by its status
    start: float  # seconds from the start of the process to its first answer
    memory: tuple[float, float]  # megabytes that the process held at the beginning and the end

    def cells(self) -> list[str]:
        """A row of the table."""
        ages = 1e3 * np.array(self.ages or [np.nan])
        return [
            str(self.published),
            f"{100 * len(self.ages) / self.published:.1f}",
            *(f"{value:.1f}" for value in np.percentile(ages, [50, 99])),
            f"{self.cpu_a_frame:.2f}",
            "{:.0f} / {:.0f}".format(*self.memory),
            f"{self.start:.2f}",
        ]


HEADINGS = ["", "frames", "answered %", "age ms, median", "99 %", "CPU ms a frame"]
HEADINGS += ["MB, first / last", "start s"]


class Camera(Node):
    """Publishes frames at a constant rate and records the time of each answer."""

    def __init__(self, reliability: str) -> None:
        super().__init__("camera")
        self.answered: dict[int, float] = {}
        self.processing: dict[int, float] = {}
        quality = QoSProfile(depth=10, reliability=ReliabilityPolicy[reliability.upper()])
        self.publisher = self.create_publisher(Image, "image", quality)
        self.create_subscription(Header, "bare/answer", self._on_answer, ANSWERS)
        self.create_subscription(DiagnosticArray, "pf_tracker/status", self._on_status, ANSWERS)

    def _on_answer(self, header: Header) -> None:
        self.answered[stamp_of(header)] = time.monotonic()

    def _on_status(self, message: DiagnosticArray) -> None:
        self._on_answer(message.header)
        values = {item.key: item.value for item in message.status[0].values}
        self.processing[stamp_of(message.header)] = 1e-3 * float(values["processing_time_ms"])


def moving_square(width: int, height: int) -> list[Image]:
    """Frames of a textured square that moves left and right over noise."""
    ground = np.random.default_rng(0).integers(60, 120, (height, width, 3), dtype=np.uint8)
    square = np.random.default_rng(1).integers(150, 255, (40, 40, 3), dtype=np.uint8)
    messages = []
    for step in [*range(30), *range(28, 0, -1)]:
        image = ground.copy()
        image[100:140, 100 + 3 * step : 140 + 3 * step] = square
        message = Image(height=height, width=width, encoding="bgr8", step=3 * width)
        message.data = array("B", image.tobytes())
        messages.append(message)
    return messages


@contextmanager
def process(command: Sequence[str]) -> Iterator[int]:
    """A process of this interpreter, ended by SIGINT; its id."""
    child = subprocess.Popen([sys.executable, *command], env=os.environ | _MEMORY)
    try:
        yield child.pid
    finally:
        child.send_signal(signal.SIGINT)
        child.wait(START_TIMEOUT)


def cpu_seconds(process_id: int) -> float:
    """CPU time of a process until now, all threads."""
    # Linux' number for the CPU clock of another process, which counts nanoseconds where /proc
    # counts hundredths of a second.
    return time.clock_gettime((~process_id << 3) | 2)


def megabytes(process_id: int) -> float:
    """Memory that a process holds, units of 10^6 bytes."""
    pages = int(Path(f"/proc/{process_id}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def play(camera: Camera, frames: list[Image], seconds: float, process_id: int) -> Figures:
    """Publish to a process that has just been started, for some seconds after the warm-up."""
    executor = SingleThreadedExecutor()
    executor.add_node(camera)

    def spin(until: Callable[[], object], deadline: float) -> None:
        while not until() and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=max(0.0, min(0.1, deadline - time.monotonic())))

    endless = itertools.cycle(frames)

    def publish() -> int:
        message, stamp = next(endless), time.time_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        camera.publisher.publish(message)
        return stamp

    began = due = time.monotonic()
    while not camera.answered:
        if due - began > START_TIMEOUT:
            raise RuntimeError(f"no answer within {START_TIMEOUT:g} s")
        publish()
        due += 1.0 / RATE
        spin(lambda: camera.answered, due)
    start = min(camera.answered.values()) - began
    published: dict[int, float] = {}
    began = due = time.monotonic()
    while due - began <= WARM_UP_SECONDS + seconds:
        spin(lambda: False, due)
        moment = time.monotonic()
        if due - began >= WARM_UP_SECONDS and not published:
            cpu, memory = cpu_seconds(process_id), megabytes(process_id)
        stamp = publish()
        if due - began >= WARM_UP_SECONDS:
            published[stamp] = moment
        due += 1.0 / RATE
    spin(lambda: published.keys() <= camera.answered.keys(), time.monotonic() + LAST_ANSWER_SECONDS)
    executor.shutdown()
    ages = [camera.answered[s] - at for s, at in published.items() if s in camera.answered]
    update = sum(camera.processing.get(stamp, 0.0) for stamp in published)
    return Figures(
        len(published),
        ages,
        1e3 * (cpu_seconds(process_id) - cpu) / len(published),
        1e3 * update / len(published),
        start,
        (memory, megabytes(process_id)),
    )


def measure(size: str, reliability: str, options: argparse.Namespace) -> Table:
    """A table of both subscribers for an image size and a kind of camera."""
    frames = moving_square(*SIZES[size])
    commands = {
        TRACKER: [
            *("-m", "pf_tracker_ros.node.tracker.tracker_node", "--ros-args"),
            *("-p", "target_box:=[100.0, 100.0, 40.0, 40.0]", "--log-level", "error"),
            *("-p", f"realtime_priority:={options.realtime_priority}"),
        ],
        BARE: [__file__, "--bare", reliability],
    }
    found = {}
    for title, command in commands.items():
        rclpy.init()
        camera = Camera(reliability)
        with process(command) as process_id:
            found[title] = play(camera, frames, options.seconds, process_id)
        camera.destroy_node()
        rclpy.shutdown()
    rows = [[title, *figures.cells()] for title, figures in found.items()]
    tracker = found[TRACKER]
    added = tracker.cpu_a_frame - tracker.update_a_frame - found[BARE].cpu_a_frame
    title = f"{size} at {RATE:g} Hz from a {reliability} camera"
    title += ", profile for large images" * options.large_images
    title += f", real-time priority {options.realtime_priority}" * bool(options.realtime_priority)
    title += f"; the node adds {added:.2f} ms"
    return Table(title, HEADINGS, rows)


def main() -> None:
    """Measure and print the tables."""
    parser = options_of.parser(__doc__)
    at_least = options_of.at_least
    parser.add_argument("--seconds", type=at_least(1), default=10, help="of each turn [10]")
    parser.add_argument(
        "--realtime-priority",
        type=at_least(0),
        default=NodeParameters.realtime_priority,
        help="of the tracker, where permitted",
    )
    parser.add_argument(
        "--large-images", action="store_true", help="with the Fast DDS profile for large images"
    )
    parser.add_argument("--bare", choices=RELIABILITIES, help="run as the bare subscriber")
    arguments = parser.parse_args()
    if arguments.bare:
        run(lambda: BareSubscriber(arguments.bare), [])
        return
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    if arguments.large_images:
        os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(PROFILE)
    with unused_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        for camera in itertools.product(SIZES, RELIABILITIES):
            measure(*camera, arguments).show()


if __name__ == "__main__":
    main()
