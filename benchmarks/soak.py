"""Soak test of the tracker node, with a fault before one of ten frames.

The tracker runs in its own process. It receives small frames, each after the status of the last.
Faults are malformed images, repeated or jumping stamps, and invalid targets or parameters. Pass
criteria: the process runs to the end, every message is answered, each good frame after a fault is
tracked, nothing unexpected is logged, and memory grows by at most 5 % after the first twentieth.

    python benchmarks/soak.py --frames 100000 --output benchmarks/results/soak.md
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from array import array
from collections import Counter
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point32, PointStamped, PolygonStamped
from numpy.typing import NDArray
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rich.console import Console
from rich.progress import track
from rich.table import Table
from sensor_msgs.msg import Image

from pf_tracker_ros.ros_domains import unused_domain

SIZE, SIDE = (160, 120), 24
INTERVAL = 40_000_000
TIMEOUT = 10.0
FAULT_SHARE = 0.1
GROWTH = 0.05
RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
TRACKED = ("started", "tracked")


def pictures() -> list[NDArray[np.uint8]]:
    """A checkered square that moves back and forth over noise."""
    generator = np.random.default_rng(7)
    ground = generator.integers(40, 120, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
    rows, columns = np.indices((SIDE, SIDE)) // 6
    square = np.where(((rows + columns) % 2 == 0)[..., None], (40, 40, 220), (30, 180, 240))
    images = []
    for x in [*range(20, 110, 3), *range(110, 20, -3)]:
        image = ground.copy()
        image[40 : 40 + SIDE, x : x + SIDE] = square
        images.append(image)
    return images


class SoakTest(Node):
    """Sends frames and faults to a tracker and checks its status.

    Attributes:
        faults: Kind of fault to how often it was made.
        failures: Kind of failure to how often it was seen.

    Args:
        seed: Seed of the faults.
    """

    def __init__(self, seed: int) -> None:
        super().__init__("soak")
        self.faults: Counter[str] = Counter()
        self.failures: Counter[str] = Counter()
        self._random = np.random.default_rng(seed)
        self._answers: dict[int, str] = {}
        self._stamp = 10**18
        self._pictures = pictures()
        self._images = self.create_publisher(Image, "image", RELIABLE)
        self._targets = self.create_publisher(PolygonStamped, "pf_tracker/target", 1)
        self._clicks = self.create_publisher(PointStamped, "pf_tracker/click", 1)
        self._parameters = self.create_client(
            SetParametersAtomically, "pf_tracker/set_parameters_atomically"
        )
        self.create_subscription(DiagnosticArray, "pf_tracker/status", self._on_status, RELIABLE)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self)
        self._kinds = {
            "no data": lambda: self._broken(data=array("B")),
            "short data": lambda: self._broken(data=array("B", bytes(100))),
            "no size": lambda: self._broken(width=0, height=0),
            "one pixel": lambda: self._broken(width=1, height=1),
            "huge": lambda: self._broken(width=2**32 - 1, height=2**32 - 1),
            "short step": lambda: self._broken(step=1),
            "unknown encoding": lambda: self._broken(encoding="x" * 100),
            "other encoding": lambda: self._broken(encoding="mono8"),
            "noise for a header": self._noise,
            "black": lambda: self._show(np.zeros_like(self._pictures[0]), self._next()),
            "twice": lambda: self._show(self._pictures[0], self._stamp),
            "late": lambda: self._show(self._pictures[0], self._stamp - INTERVAL // 2),
            "back in time": lambda: self._jump(-3600 * 10**9),
            "ahead in time": lambda: self._jump(3600 * 10**9),
            "no stamp": lambda: self._show(self._pictures[0], 0),
            "target nowhere": lambda: self._target([(9e9, 9e9), (9e9 + 1e4, 9.1e9)]),
            "target no number": lambda: self._target([(np.nan, 1.0), (5.0, np.inf)]),
            "target without area": lambda: self._target([(5.0, 5.0)]),
            "target long ago": lambda: self._target([(5.0, 5.0), (20.0, 20.0)], 1),
            "click no number": self._click,
            "wrong parameters": lambda: self._set(particles=-1, seed=5),
            "contradiction": lambda: self._set(**{"proposal.method": "kalman"}),
        }

    def connect(self) -> None:
        """Wait until the tracker answers."""
        deadline = time.monotonic() + 6 * TIMEOUT
        ping = Image(height=1, width=1, encoding="ping")
        ping.header.stamp.nanosec = 1
        while not (1 in self._answers and self._targets.get_subscription_count()):
            if time.monotonic() > deadline:
                raise RuntimeError("the tracker does not answer")
            self._images.publish(ping)
            self._executor.spin_once(timeout_sec=0.1)
        while not self._parameters.service_is_ready():
            self._executor.spin_once(timeout_sec=0.1)

    def start(self, index: int) -> None:
        """Draw the true box on the next frame."""
        x = [*range(20, 110, 3), *range(110, 20, -3)][index % len(self._pictures)]
        self._target([(x, 40.0), (x + SIDE, 40.0 + SIDE)])
        self._frame(index)

    def step(self, index: int) -> None:
        """Send a good frame, sometimes after a fault."""
        if self._random.random() < FAULT_SHARE:
            kind = list(self._kinds)[self._random.integers(len(self._kinds))]
            self.faults[kind] += 1
            self._kinds[kind]()
            self._frame(index, after=f"after {kind}")
        else:
            self._frame(index)

    def _frame(self, index: int, after: str = "without a fault") -> None:
        frame = self._show(self._pictures[index % len(self._pictures)], self._next())
        if frame not in TRACKED:
            self.failures[f"good frame {frame} {after}"] += 1

    def _next(self) -> int:
        self._stamp += INTERVAL
        return self._stamp

    def _jump(self, nanoseconds: int) -> None:
        self._stamp += nanoseconds

    def _message(self, image: NDArray[np.uint8], stamp: int) -> Image:
        message = Image(height=image.shape[0], width=image.shape[1], encoding="bgr8")
        message.step = 3 * image.shape[1]
        message.data = array("B", image.tobytes())
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        return message

    def _show(self, image: NDArray[np.uint8], stamp: int) -> str:
        return self._send(self._message(image, stamp))

    def _broken(self, **fields: object) -> None:
        message = self._message(self._pictures[0], self._next())
        for name, value in fields.items():
            setattr(message, name, value)
        if self._send(message) != "refused":
            self.failures["fault not refused"] += 1

    def _noise(self) -> None:
        low, high, step = (int(value) for value in self._random.integers(0, 2**32, 3))
        self._broken(width=low, height=high, step=step, is_bigendian=int(low % 256))

    def _send(self, message: Image) -> str:
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        self._answers.pop(stamp, None)
        self._images.publish(message)
        deadline = time.monotonic() + TIMEOUT
        while stamp not in self._answers:
            if time.monotonic() > deadline:
                self.failures["no answer"] += 1
                return "unanswered"
            self._executor.spin_once(timeout_sec=0.1)
        return self._answers.pop(stamp)

    def _target(self, points: list[tuple[float, float]], stamp: int = 0) -> None:
        message = PolygonStamped()
        message.header.stamp.nanosec = stamp
        message.polygon.points = [Point32(x=float(x), y=float(y)) for x, y in points]
        self._targets.publish(message)
        self._targets.wait_for_all_acked(rclpy.duration.Duration(seconds=5))

    def _click(self) -> None:
        message = PointStamped()
        message.point.x = float("nan")
        self._clicks.publish(message)
        self._clicks.wait_for_all_acked(rclpy.duration.Duration(seconds=5))

    def _set(self, **values: object) -> None:
        parameters = [
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
        ]
        request = SetParametersAtomically.Request(parameters=parameters)
        future = self._parameters.call_async(request)
        self._executor.spin_until_future_complete(future, TIMEOUT)
        if not future.done():
            self.failures["parameters without answer"] += 1
        elif future.result().result.successful:
            self.failures["wrong parameters taken"] += 1

    def _on_status(self, message: DiagnosticArray) -> None:
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        (status,) = message.status
        self._answers[stamp] = {item.key: item.value for item in status.values}["frame"]


def resident_megabytes(process: subprocess.Popen[bytes]) -> float:
    """Resident memory of a process."""
    pages = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def run_soak(frames: int, seed: int, log: Path) -> tuple[Table, bool]:
    """Run the test; returns its report and whether it passed."""
    settings = {
        "preset": "li2007",
        "particles": 30,
        "track.wrong_box_cost": 0.0,
        "image_reliability": "reliable",
    }
    overrides = [f"{name}:={value}" for name, value in settings.items()]
    command = [sys.executable, "-m", "pf_tracker_ros.node.tracker.tracker_node", "--ros-args"]
    command += [argument for override in overrides for argument in ("-p", override)]
    began = time.monotonic()
    rclpy.init()
    with log.open("wb") as output:
        process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
    try:
        life = SoakTest(seed)
        life.connect()
        life.start(0)
        memory = []
        for index in track(range(1, frames), "soak", transient=True):
            life.step(index)
            if index % max(1, frames // 20) == 0:
                memory.append(resident_megabytes(process))
        memory.append(resident_megabytes(process))
        alive = process.poll() is None
    finally:
        process.send_signal(signal.SIGINT)
        code = process.wait(30)
        rclpy.shutdown()
    text = log.read_text(errors="replace")
    unexpected = text.count("Traceback") + text.count("unexpected")
    growth = max(memory) / memory[0] - 1.0
    rows = {
        "good frames": frames,
        "faults": sum(life.faults.values()),
        "kinds of faults": len(life.faults),
        "failures": dict(life.failures) or 0,
        "unexpected errors in the log": unexpected,
        "lived to the end": alive,
        "exit code": code,
        "memory at 5 %, at the end, most, MB": ", ".join(
            f"{megabytes:.1f}" for megabytes in (memory[0], memory[-1], max(memory))
        ),
        "growth": f"{100 * growth:.1f} %",
        "minutes": f"{(time.monotonic() - began) / 60:.1f}",
    }
    table = Table(title="soak", show_header=False)
    for name, value in rows.items():
        table.add_row(name, str(value))
    held = alive and code == 0 and not life.failures and not unexpected and growth <= GROWTH
    return table, held


def main() -> int:
    """Run, print the table and optionally save it; the exit code is 1 after any failure."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--frames", type=int, default=100_000, help="good frames")
    parser.add_argument("--seed", type=int, default=0, help="of the faults")
    parser.add_argument("--output", type=Path, help="text file for the table")
    arguments = parser.parse_args()
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    with unused_domain() as domain, tempfile.TemporaryDirectory() as folder:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        table, held = run_soak(arguments.frames, arguments.seed, Path(folder) / "tracker.log")
    Console().print(table)
    if arguments.output:
        arguments.output.parent.mkdir(parents=True, exist_ok=True)
        with arguments.output.open("w") as file:
            Console(file=file, width=110).print(table)
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
