"""Frame loss and latency of the tracker node, compared with a bare subscriber.

Camera, tracker and bare subscriber are separate processes on the loopback. The camera publishes at
a constant rate. A frame is answered when a status of the tracker, or a header of the bare
subscriber, has its stamp. Both alternate in one run, so that other load slows both.

    python benchmarks/frame_loss.py --output benchmarks/results/frame_loss.md
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
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rclpy
from arguments import at_least
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image
from std_msgs.msg import Header
from tables import Table

from pf_tracker_ros.node.running import run
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.ros_domains import unused_domain

SIZES = {"640x480": (640, 480), "768x576": (768, 576), "1920x1080": (1920, 1080)}
RELIABILITIES = ("reliable", "best_effort")
START_TIMEOUT = 30.0
WARM_UP_SECONDS = 2.0
LAST_ANSWER_SECONDS = 1.0
ANSWERS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
TRACKER, BARE = "tracker", "bare subscriber"


def image_qos(reliability: str) -> QoSProfile:
    """The usual QoS profile of cameras, with a reliability."""
    return QoSProfile(depth=10, reliability=ReliabilityPolicy[reliability.upper()])


class BareSubscriber(Node):
    """Publishes the header of every image.

    Args:
        reliability: Of its subscription, one of `RELIABILITIES`.
    """

    def __init__(self, reliability: str) -> None:
        super().__init__("bare")
        quality = QoSProfile(depth=1, reliability=ReliabilityPolicy[reliability.upper()])
        publisher = self.create_publisher(Header, "~/answer", ANSWERS)
        self.create_subscription(Image, "image", lambda m: publisher.publish(m.header), quality)


@dataclass
class Figures:
    """Figures of the frames of some turns.

    Attributes:
        published: Their number.
        ages: Seconds from publishing to the answer, one for each frame that was answered.
    """

    published: int = 0
    ages: list[float] = field(default_factory=list)


class Camera(Node):
    """Publishes frames at a constant rate and records the time of each answer.

    Args:
        reliability: Of the images, one of `RELIABILITIES`.
    """

    def __init__(self, reliability: str) -> None:
        super().__init__("camera")
        self.answered: dict[int, float] = {}
        self.publisher = self.create_publisher(Image, "image", image_qos(reliability))
        self.create_subscription(Header, "bare/answer", self._on_answer, ANSWERS)
        self.create_subscription(
            DiagnosticArray, "pf_tracker/status", lambda m: self._on_answer(m.header), ANSWERS
        )

    def _on_answer(self, header: Header) -> None:
        self.answered[header.stamp.sec * 10**9 + header.stamp.nanosec] = time.monotonic()


def moving_noise(width: int, height: int) -> list[Image]:
    """Frames of a textured square that moves left and right over noise."""
    generator = np.random.default_rng(0)
    return moving_over(generator.integers(60, 120, (height, width, 3), dtype=np.uint8))


def moving_over(ground: NDArray[np.uint8]) -> list[Image]:
    """Frames of a textured square that moves left and right over a (height, width, 3) image."""
    height, width = ground.shape[:2]
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
def process(*command: str) -> Iterator[None]:
    """A process of this interpreter, ended by SIGINT."""
    child = subprocess.Popen([sys.executable, *command])
    try:
        yield
    finally:
        child.send_signal(signal.SIGINT)
        child.wait(START_TIMEOUT)


def play(camera: Camera, frames: list[Image], rate: float, seconds: float) -> Figures:
    """Publish for some seconds; returns the figures after the warm-up."""
    executor = SingleThreadedExecutor()
    executor.add_node(camera)

    def spin(until: Callable[[], bool], deadline: float) -> None:
        while not until() and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=max(0.0, min(0.1, deadline - time.monotonic())))

    spin(lambda: camera.publisher.get_subscription_count() > 0, time.monotonic() + START_TIMEOUT)
    if not camera.publisher.get_subscription_count():
        raise RuntimeError(f"nobody has subscribed within {START_TIMEOUT:g} s")
    published: dict[int, float] = {}
    began = due = time.monotonic()
    for message in itertools.cycle(frames):
        spin(lambda: False, due)
        if due - began > WARM_UP_SECONDS + seconds:
            break
        stamp = time.time_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        if due - began >= WARM_UP_SECONDS:
            published[stamp] = time.monotonic()
        camera.publisher.publish(message)
        due += 1.0 / rate
    spin(lambda: published.keys() <= camera.answered.keys(), time.monotonic() + LAST_ANSWER_SECONDS)
    executor.shutdown()
    ages = [camera.answered[s] - began for s, began in published.items() if s in camera.answered]
    return Figures(len(published), ages)


def measure(
    size: str, reliability: str, rate: float, *, seconds: float, rounds: int, priority: int
) -> Table:
    """A table of both subscribers for an image size and a kind of camera."""
    frames = moving_noise(*SIZES[size])
    commands = {
        TRACKER: [
            *("-m", "pf_tracker_ros.node.tracker.tracker_node", "--ros-args"),
            *("-p", "target_box:=[100.0, 100.0, 40.0, 40.0]", "--log-level", "error"),
            *("-p", f"realtime_priority:={priority}"),
        ],
        BARE: [__file__, "--bare", reliability],
    }
    results = {title: Figures() for title in commands}
    for _, (title, command) in itertools.product(range(rounds), commands.items()):
        rclpy.init()
        with process(*command):
            camera = Camera(reliability)
            turn = play(camera, frames, rate, seconds)
            camera.destroy_node()
        rclpy.shutdown()
        results[title].published += turn.published
        results[title].ages += turn.ages
    rows = []
    for title, figures in results.items():
        third = max(1, len(figures.ages) // 3)
        ages = 1e3 * np.array(figures.ages or [np.nan])
        rows.append(
            [
                title,
                str(figures.published),
                f"{100 * len(figures.ages) / figures.published:.1f}",
                *(f"{value:.1f}" for value in np.percentile(ages, [50, 99])),
                f"{np.median(ages[:third]):.1f} / {np.median(ages[-third:]):.1f}",
            ]
        )
    headings = ["", "frames", "answered %", "age ms, median", "99 %", "first / last third"]
    return Table(f"{size} at {rate:g} Hz from a {reliability} camera", headings, [rows])


def main() -> int:
    """Measure, print the tables and optionally save them."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--seconds", type=at_least(1), default=10, help="of each turn")
    parser.add_argument("--rounds", type=at_least(1), default=1, help="turns of each subscriber")
    parser.add_argument("--rate", type=at_least(1), default=30, help="frames per second")
    parser.add_argument("--size", action="append", choices=[*SIZES], help="may be repeated")
    parser.add_argument(
        "--realtime-priority",
        type=at_least(0),
        default=NodeParameters.realtime_priority,
        help="of the tracker, where permitted",
    )
    parser.add_argument("--output", type=Path, help="Markdown file for the tables")
    parser.add_argument("--bare", choices=RELIABILITIES, help="run as the bare subscriber")
    arguments = parser.parse_args()
    if arguments.bare:
        run(lambda: BareSubscriber(arguments.bare), [])
        return 0
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    lines = []
    with unused_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        for size, reliability in itertools.product(arguments.size or SIZES, RELIABILITIES):
            table = measure(
                *(size, reliability, arguments.rate),
                seconds=arguments.seconds,
                rounds=arguments.rounds,
                priority=arguments.realtime_priority,
            )
            table.show()
            lines += [f"**{table.title}**", "", *table.markdown(), ""]
    if arguments.output:
        arguments.output.parent.mkdir(parents=True, exist_ok=True)
        arguments.output.write_text("\n".join(lines), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
