"""A camera that publishes frames at a constant rate and records the time of each answer."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import subprocess
import time
from array import array
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PolygonStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from node_runs.moving_square import moving_square
from node_runs.processes import START_TIMEOUT, cpu_ms, profile, resident_megabytes

SIZES = {"640x480": (640, 480), "768x576": (768, 576), "1920x1080": (1920, 1080)}
# As most cameras publish.
_DEPTH = 10
WARM_UP_SECONDS = 2.0
_LAST_ANSWER_SECONDS = 1.0


@dataclass(frozen=True)
class Footage:
    """What a camera publishes, and how.

    Attributes:
        size: A key of `SIZES`.
        rate: Frames a second; 0 publishes each once the last is answered.
        seconds: For which it publishes after the warm-up.
        reliability: `reliable` or `best_effort`.
        large_images: Whether Fast DDS has its profile for large images.
        frames: Most frames after the warm-up, instead of the seconds if above 0.
    """

    size: str = "768x576"
    rate: float = 30.0
    seconds: float = 10.0
    reliability: str = "reliable"
    large_images: bool = True
    frames: int = 0


@dataclass
class ResponseTimes:
    """What one node answered after the warm-up; times in seconds.

    Attributes:
        published: When each frame was, by its stamp.
        box_received: When its box came, by the frame's stamp.
        status_received: When its status came, by the frame's stamp.
        processing: The tracker's own time for each frame, as its status tells it.
    """

    published: dict[int, float] = field(default_factory=dict)
    box_received: dict[int, float] = field(default_factory=dict)
    status_received: dict[int, float] = field(default_factory=dict)
    processing: dict[int, float] = field(default_factory=dict)

    @property
    def latencies(self) -> list[float]:
        """Milliseconds from before publishing to the box, in the order of publishing."""
        return [
            1e3 * (self.box_received[stamp] - began)
            for stamp, began in self.published.items()
            if stamp in self.box_received
        ]

    @property
    def ages_when_begun(self) -> list[float]:
        """Milliseconds from before publishing to where the tracker began with the frame."""
        return [
            1e3 * (self.status_received[stamp] - began - self.processing[stamp])
            for stamp, began in self.published.items()
            if stamp in self.status_received
        ]

    @property
    def frame_loss_rate(self) -> float:
        """Share of the frames without a box, 0 to 1."""
        return 1.0 - len(self.latencies) / max(len(self.published), 1)


class Camera(Node):
    """Publishes frames to nodes, each in a namespace of its own.

    Attributes:
        answers: Of each node.

    Args:
        footage: What to publish.
        node: Name of the nodes that answer.
        namespaces: Of each.
    """

    def __init__(self, footage: Footage, node: str, namespaces: Sequence[str] = ("",)) -> None:
        super().__init__("camera")
        quality = QoSProfile(
            depth=_DEPTH, reliability=ReliabilityPolicy[footage.reliability.upper()]
        )
        self.answers = [ResponseTimes() for _ in namespaces]
        self.images = []
        for namespace, answers in zip(namespaces, self.answers, strict=True):
            self.images.append(self.create_publisher(Image, f"{namespace}/image", quality))
            self._listen(f"{namespace}/{node}", answers)

    def _listen(self, node: str, answers: ResponseTimes) -> None:
        def on_box(box: PolygonStamped) -> None:
            answers.box_received[stamp_of(box.header)] = time.monotonic()

        def on_status(message: DiagnosticArray) -> None:
            stamp = stamp_of(message.header)
            answers.status_received[stamp] = time.monotonic()
            values = {item.key: item.value for item in message.status[0].values}
            answers.processing[stamp] = 1e-3 * float(values["processing_time_ms"])

        self.create_subscription(PolygonStamped, f"{node}/box", on_box, 1000)
        self.create_subscription(DiagnosticArray, f"{node}/status", on_status, 1000)


def stamp_of(header: Header) -> int:
    """Nanoseconds."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def messages(size: str) -> list[Image]:
    """The frames of `moving_square` as messages."""
    made = []
    for image in moving_square(*SIZES[size]):
        message = Image(height=image.shape[0], width=image.shape[1], encoding="bgr8")
        message.step = image.strides[0]
        message.data = array("B", image.tobytes())
        made.append(message)
    return made


class Sample(NamedTuple):
    """What some processes had taken before a frame.

    Attributes:
        frame: Its number, the first after the warm-up being 0.
        moment: Seconds.
        cpu: Milliseconds of each process.
        memory: Megabytes that each holds.
    """

    frame: int
    moment: float
    cpu: list[float]
    memory: list[float]


class Run(NamedTuple):
    """What came of publishing.

    Attributes:
        answers: Of each node.
        samples: Of the processes: one every so many frames, and one at the end.
    """

    answers: list[ResponseTimes]
    samples: list[Sample]

    @property
    def cpu_a_frame(self) -> list[float]:
        """Milliseconds of each process for each frame that was published."""
        first, last = self.samples[0], self.samples[-1]
        frames = last.frame - first.frame
        return [(end - start) / frames for start, end in zip(first.cpu, last.cpu, strict=True)]

    @property
    def cpu_shares(self) -> list[float]:
        """Share of one core that each process took."""
        first, last = self.samples[0], self.samples[-1]
        seconds = last.moment - first.moment
        return [
            1e-3 * (end - start) / seconds for start, end in zip(first.cpu, last.cpu, strict=True)
        ]


def play(
    footage: Footage,
    node: str,
    namespaces: Sequence[str] = ("",),
    watched: Sequence[int] = (),
    every: int = 100,
) -> Run:
    """Publish from a process of its own, and tell what each node answered.

    Args:
        footage: What to publish.
        node: Name of the nodes that answer.
        namespaces: Of each.
        watched: Ids of processes that samples are taken of.
        every: Frames from one of these to the next.
    """
    return _in_a_process(_play, footage, node, namespaces, watched, every)


def seconds_to_first_answer(footage: Footage, node: str, command: Sequence[str]) -> float:
    """Seconds from the start of a process to its node's first answer to a running camera."""
    return _in_a_process(_first_answer, footage, node, command)


def _in_a_process(call: Callable[..., Any], *arguments: Any) -> Any:
    # Fast DDS reads its profile once a process.
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(call, *arguments).result()


def _play(
    footage: Footage, node: str, namespaces: Sequence[str], watched: Sequence[int], every: int
) -> Run:
    with _Player(footage, node, namespaces) as player:
        return player.play(watched, every)


def _first_answer(footage: Footage, node: str, command: Sequence[str]) -> float:
    with _Player(footage, node, ("",)) as player:
        return player.await_first_answer(command)


class _Player:
    """Publishes a footage while it is entered."""

    def __init__(self, footage: Footage, node: str, namespaces: Sequence[str]) -> None:
        os.environ |= profile(footage.large_images)
        rclpy.init()
        self._footage = footage
        self._camera = Camera(footage, node, namespaces)
        # Boxes and statuses that come between two frames, and some more.
        self._answers_a_frame = 4 * len(namespaces)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._camera)
        self._messages = itertools.cycle(messages(footage.size))

    def __enter__(self) -> _Player:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._camera.destroy_node()
        rclpy.shutdown()

    def play(self, watched: Sequence[int], every: int) -> Run:
        """See `play`."""
        footage, samples = self._footage, []

        def sample(frame: int) -> None:
            cpu, memory = map(cpu_ms, watched), map(resident_megabytes, watched)
            samples.append(Sample(frame, time.monotonic(), [*cpu], [*memory]))

        deadline = time.monotonic() + START_TIMEOUT
        self._spin(self._is_heard, deadline)
        if not self._is_heard():
            raise RuntimeError(f"nobody has subscribed within {START_TIMEOUT:g} s")
        began = due = time.monotonic()
        number = 0
        while True:
            self._spin(lambda: False, due)
            if footage.rate and time.monotonic() > due + 1.0 / footage.rate:
                # Behind: what has been answered is taken all the same, and no frame made up for.
                for _ in range(self._answers_a_frame):
                    self._executor.spin_once(timeout_sec=0.0)
                due = time.monotonic()
            counts = due - began >= WARM_UP_SECONDS
            is_last = due - began > WARM_UP_SECONDS + footage.seconds
            if number >= footage.frames if footage.frames else is_last:
                break
            if counts and number % every == 0:
                sample(number)
            number += counts
            stamp = self._publish(counts)
            if footage.rate:
                due += 1.0 / footage.rate
            else:
                self._spin(self._told(stamp), time.monotonic() + 1.0)
                due = time.monotonic()
        self._spin(self._is_all_answered, time.monotonic() + _LAST_ANSWER_SECONDS)
        sample(number)
        return Run(self._camera.answers, samples)

    def await_first_answer(self, command: Sequence[str]) -> float:
        """See `seconds_to_first_answer`."""
        (answers,) = self._camera.answers
        # Whoever comes finds a camera that runs.
        for _ in range(_DEPTH):
            self._publish(counts=False)
            self._spin(lambda: False, time.monotonic() + 1.0 / self._footage.rate)
        began = due = time.monotonic()
        with subprocess.Popen([*command]) as child:
            while not answers.box_received and time.monotonic() - began < START_TIMEOUT:
                self._publish(counts=False)
                due += 1.0 / self._footage.rate
                self._spin(lambda: bool(answers.box_received), due)
            child.terminate()
            try:
                child.wait(START_TIMEOUT)
            except subprocess.TimeoutExpired:
                child.kill()
        if not answers.box_received:
            raise RuntimeError(f"no answer within {START_TIMEOUT:g} s")
        return min(answers.box_received.values()) - began

    def _publish(self, counts: bool) -> int:
        stamp, message = time.time_ns(), next(self._messages)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        for publisher, answers in zip(self._camera.images, self._camera.answers, strict=True):
            if counts:
                answers.published[stamp] = time.monotonic()
            publisher.publish(message)
        return stamp

    def _is_heard(self) -> bool:
        return all(publisher.get_subscription_count() for publisher in self._camera.images)

    def _told(self, stamp: int) -> Callable[[], bool]:
        return lambda: all(
            stamp in one.status_received or stamp in one.box_received
            for one in self._camera.answers
        )

    def _is_all_answered(self) -> bool:
        return all(one.published.keys() <= one.box_received.keys() for one in self._camera.answers)

    def _spin(self, until: Callable[[], bool], deadline: float) -> None:
        while not until() and time.monotonic() < deadline:
            wait = min(0.1, deadline - time.monotonic())
            self._executor.spin_once(timeout_sec=max(0.0, wait))


def percentiles(values: Iterable[float], *wanted: float) -> list[float]:
    """Of some values; not a number where there is none."""
    return [float(value) for value in np.percentile(np.array([*values] or [np.nan]), wanted)]
