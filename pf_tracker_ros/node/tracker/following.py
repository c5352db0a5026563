"""What the node follows, one target or several: the part of it that differs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from numpy.typing import NDArray
from rclpy.node import Node
from std_msgs.msg import Header

from pf_tracker_ros.boxes import Box
from pf_tracker_ros.node.parameter_group import Values
from pf_tracker_ros.node.qos import Report
from pf_tracker_ros.tracking.presets import PresetInForce

StatusValues = Mapping[str, str | float | int]


class TargetStatus(NamedTuple):
    """How one of several targets is.

    Attributes:
        id: Its own.
        level: `DiagnosticStatus.OK`, `WARN` or `ERROR`.
        message: In words.
        values: What is known of it, key to value.
    """

    id: int
    level: bytes
    message: str
    values: StatusValues


@dataclass(frozen=True)
class Known:
    """What is known after the last frame that was looked at.

    Attributes:
        state: `idle`, or the state of the track; with several targets, of the one seen best.
        description: The same in words.
        values: What is known of the target, key to value; of no frame but that.
        of_frame: More of it for the status of that frame.
        requested_stamp: Stamp of the frame that a requested target waits for, None or 0 without.
        targets: One by one, where there may be several.
    """

    state: str
    description: str
    values: StatusValues
    of_frame: StatusValues
    requested_stamp: int | None = None
    targets: tuple[TargetStatus, ...] = ()


def show_nothing() -> None:
    """Of a frame that was not looked at, there is nothing to be seen."""


class Followed(NamedTuple):
    """What became of one frame.

    Attributes:
        frame: As in the status.
        errors: What was refused, a sentence each.
        jumped_back: Seconds by which time went back with it, 0 if it did not.
        show: Publishes what people look at, particles and overlay; to be called once all that
            others act on is out.
    """

    frame: str
    errors: tuple[str, ...] = ()
    jumped_back: float = 0.0
    show: Callable[[], None] = show_nothing


class Following(Protocol):
    """Follows what the node follows, and publishes it.

    It begins without a session, and is without one while a parameter is in the way.
    """

    @property
    def tunables(self) -> type:
        """The declared group of the tracker's parameters."""

    @property
    def kept(self) -> Collection[str]:
        """Full names of those that no preset decides on."""

    def usual(self, preset: str) -> Values:
        """Full name to value of each of the tracker's parameters in a preset."""

    def preset(self, values: Values) -> PresetInForce:
        """The preset, and what differs from it."""

    def check(self, values: Values) -> None:
        """Try what `configure` would do with the node's parameters; raises ValueError."""

    def configure(self, values: Values) -> None:
        """Take parameters, and a session if there is none; raises ValueError."""

    def forget(self) -> None:
        """Give the session up."""

    def advertise(self, node: Node, report: Report) -> None:
        """Take the publishers."""

    def subscribe(self, node: Node, report: Report) -> None:
        """Listen to more than images and targets."""

    def unsubscribe(self) -> None:
        """Listen no more."""

    def close(self) -> None:
        """Give the publishers back."""

    def request(self, box: Box, stamp: int) -> None:
        """Start a target that was drawn on a frame; raises ValueError."""

    def withdraw(self) -> None:
        """Forget what was requested and has not begun."""

    def stop(self) -> str:
        """Forget all targets, and tell what came of it."""

    def begin_frame(self) -> None:
        """Begin a frame of which nothing is known so far."""

    def process(self, read: Callable[[], NDArray[Any]], header: Header) -> Followed:
        """Follow into a frame, and publish what others act on; raises ValueError.

        Args:
            read: Gives the image, and raises what keeps it from that; it is not called for a frame
                that is dropped, and costs nothing when called again.
            header: Of the frame.
        """

    def pass_over(self, stamp: int) -> None:
        """Let the clock go on with a frame that is not looked at; its stamp, nanoseconds."""

    @property
    def is_ready(self) -> bool:
        """Whether there is a session."""

    @property
    def known(self) -> Known:
        """What is known."""
