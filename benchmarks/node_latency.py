"""From publishing a frame to receiving its box: the tracker node beside a bare subscriber.

Publisher, tracker and bare subscriber are processes of their own, on the loopback. The bare
subscriber answers each image with a polygon at once, so its figure is what ROS takes for a frame of
this size; the rest is the tracker. The two take turns in one run, so that a busy machine slows
both. Frames go out at 30 a second, but none before the last one is answered: a frame without an
answer within a second counts as lost. By default Fast DDS is set up for large images, as the launch
files can do it; `--plain` leaves it as it is.

    python benchmarks/node_latency.py --output benchmarks/results/node_latency.md
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
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from domain_coordinator import domain_id
from geometry_msgs.msg import Point32, PolygonStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scenes import UmbrellaScene
from sensor_msgs.msg import Image

from pf_tracker_ros.node.running import run

RATE = 30.0
PARTICLES = 60
TIMEOUT = 1.0
START_TIMEOUT = 30.0
WARM_UP = 30
SCENE_FRAMES = 80
RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
PROFILE = Path(__file__).resolve().parents[1] / "config" / "fastdds_large_images.xml"
# glibc would give the memory of each image back and fetch it again, 2 ms a frame in a process that
# does nothing else. What the tracker keeps allocated prevents that, so it would seem to be free.
MEMORY = {"MALLOC_TRIM_THRESHOLD_": "200000000", "MALLOC_MMAP_THRESHOLD_": "33000000"}
BARE, TRACKER = "bare subscriber", f"tracker, N = {PARTICLES}"


class BareSubscriber(Node):
    """Answers every image with a polygon."""

    def __init__(self) -> None:
        super().__init__("bare")
        self._publisher = self.create_publisher(PolygonStamped, "~/box", RELIABLE)
        self.create_subscription(Image, "image", self._on_image, RELIABLE)

    def _on_image(self, image: Image) -> None:
        answer = PolygonStamped(header=image.header)
        answer.polygon.points = [Point32()] * 4
        self._publisher.publish(answer)


@dataclass
class Figures:
    """What was measured of one answering node; times in milliseconds.

    Attributes:
        latencies: From before publishing to the box's callback, one for each answered frame.
        processing: The tracker's own time for the frame, as its status tells it.
        lost: Frames without an answer.
        late: Frames answered after the next one was due.
    """

    latencies: list[float] = field(default_factory=list)
    processing: list[float] = field(default_factory=list)
    lost: int = 0
    late: int = 0


class Camera(Node):
    """Publishes frames and receives boxes.

    Args:
        answering_node: Name of the node whose boxes and status it receives.
    """

    def __init__(self, answering_node: str) -> None:
        super().__init__("camera")
        self.answered: dict[int, float] = {}
        self.processing: list[float] = []
        self.publisher = self.create_publisher(Image, "image", RELIABLE)
        self.create_subscription(PolygonStamped, f"{answering_node}/box", self._on_box, RELIABLE)
        self.create_subscription(
            DiagnosticArray, f"{answering_node}/status", self._on_status, RELIABLE
        )

    def _on_box(self, box: PolygonStamped) -> None:
        self.answered[box.header.stamp.sec * 10**9 + box.header.stamp.nanosec] = time.monotonic()

    def _on_status(self, message: DiagnosticArray) -> None:
        values = {item.key: item.value for item in message.status[0].values}
        self.processing.append(float(values["processing_time_ms"]))


def messages(scene: UmbrellaScene) -> list[Image]:
    """The first frames of a scene as messages, forth and back, so that the last suits the first."""
    images = [scene.render(index) for index in range(SCENE_FRAMES)]
    forth = [
        Image(
            height=image.shape[0],
            width=image.shape[1],
            encoding="bgr8",
            step=3 * image.shape[1],
            data=array("B", image.tobytes()),
        )
        for image in images
    ]
    return forth + forth[-2:0:-1]


@contextmanager
def process(*command: str) -> Iterator[None]:
    """A process of this interpreter, ended with SIGINT; raises RuntimeError if that fails."""
    child = subprocess.Popen([sys.executable, *command], env=os.environ | MEMORY)
    try:
        yield
    finally:
        child.send_signal(signal.SIGINT)
        if child.wait(START_TIMEOUT) != 0:
            raise RuntimeError(f"{' '.join(command)} ended with code {child.returncode}")


def measure(camera: Camera, frames: list[Image], count: int, title: str, figures: Figures) -> None:
    """Publish `count` frames after some to warm up, and add to the figures."""
    executor = SingleThreadedExecutor()
    executor.add_node(camera)

    def spin_until(condition_end: float, stamp: int | None = None) -> bool:
        while time.monotonic() < condition_end:
            if stamp in camera.answered:
                return True
            executor.spin_once(timeout_sec=max(0.0, condition_end - time.monotonic()))
        return stamp in camera.answered

    deadline = time.monotonic() + START_TIMEOUT
    while not camera.publisher.get_subscription_count():
        if time.monotonic() > deadline:
            raise RuntimeError(f"the {title} has not subscribed within {START_TIMEOUT:g} s")
        spin_until(time.monotonic() + 0.1)
    cycle = itertools.cycle(frames)
    due = time.monotonic() + 1.0
    for number in track(range(-WARM_UP, count), title, transient=True):
        spin_until(due)
        message = next(cycle)
        stamp = time.time_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        published = time.monotonic()
        camera.publisher.publish(message)
        answered = spin_until(published + TIMEOUT, stamp)
        due += 1.0 / RATE
        if number >= 0 and not answered:
            figures.lost += 1
        elif number >= 0:
            figures.latencies.append(1e3 * (camera.answered[stamp] - published))
            figures.late += camera.answered[stamp] > due
        due = max(due, time.monotonic())
    figures.processing += camera.processing[WARM_UP:]
    executor.shutdown()


def table(results: dict[str, Figures]) -> Table:
    """The figures of both, the tracker's own time (median), and what it adds."""
    result = Table(title=f"768x576 bgr8 at {RATE:g} fps: ms from publishing a frame to its box")
    for heading in ("", "frames", "lost", "late", "median", "99 %", "max", "own"):
        result.add_column(heading, justify="right")
    for title, figures in results.items():
        own = f"{np.median(figures.processing):.2f}" if figures.processing else ""
        median, high = np.percentile(figures.latencies, [50, 99])
        result.add_row(
            title,
            str(len(figures.latencies) + figures.lost),
            str(figures.lost),
            str(figures.late),
            f"{median:.2f}",
            f"{high:.2f}",
            f"{max(figures.latencies):.2f}",
            own,
        )
    added = np.subtract(
        *(np.percentile(results[title].latencies, [50, 99]) for title in (TRACKER, BARE))
    )
    result.add_row("difference", "", "", "", f"{added[0]:.2f}", f"{added[1]:.2f}", "", "")
    return result


def measure_both(count: int, rounds: int) -> dict[str, Figures]:
    """Let the two take turns."""
    scene = UmbrellaScene(seed=0)
    frames = messages(scene)
    box = [float(value) for value in scene.target_boxes[0]]
    settings = {
        "preset": "li2007",
        "particles": PARTICLES,
        "image_reliability": "reliable",
        "target_box": box,
        "track.occluded_below": 0.0,
    }
    overrides = [f"{name}:={value}" for name, value in settings.items()]
    arguments = [argument for override in overrides for argument in ("-p", override)]
    commands = {
        BARE: [__file__, "--bare"],
        TRACKER: ["-m", "pf_tracker_ros.node.tracker.tracker_node", "--ros-args", *arguments],
    }
    results = {title: Figures() for title in commands}
    for _ in range(rounds):
        for title, command in commands.items():
            rclpy.init()
            with process(*command):
                camera = Camera("bare" if title == BARE else "pf_tracker")
                measure(camera, frames, count, title, results[title])
                camera.destroy_node()
            rclpy.shutdown()
    return results


def main() -> int:
    """Measure, print the table and, if asked to, save it."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--frames", type=int, default=300, help="frames in each turn")
    parser.add_argument("--rounds", type=int, default=2, help="turns of each")
    parser.add_argument("--output", type=Path, help="text file for the table")
    parser.add_argument("--plain", action="store_true", help="without the profile for large images")
    parser.add_argument("--bare", action="store_true", help="be the bare subscriber")
    arguments = parser.parse_args()
    if arguments.bare:
        run(BareSubscriber, [])
        return 0
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    if not arguments.plain:
        os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(PROFILE)
    with domain_id() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        results = measure_both(arguments.frames, arguments.rounds)
    Console().print(table(results))
    if arguments.output:
        arguments.output.parent.mkdir(parents=True, exist_ok=True)
        with arguments.output.open("w") as file:
            Console(file=file, width=110).print(table(results))
    return 0


if __name__ == "__main__":
    sys.exit(main())
