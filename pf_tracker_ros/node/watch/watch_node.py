"""Prints what tracker and localizer publish, a line for each target."""

from __future__ import annotations

import functools
import math
import os
import sys
import time
from collections.abc import Iterator, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from pf_tracker_ros.node.qos import LATCHED_QOS
from pf_tracker_ros.node.running import run
from pf_tracker_ros.stamps import NANOSECONDS, stamp_of

_TRACKER, _LOCALIZER = "pf_tracker/status", "localizer/status"
# Seconds until a missing tracker is reported, and again.
_SILENCE = 5.0
_NO_TARGET = "no target"
# Messages of a target without a reason for its state.
_FINE = ("tracking", "located")


class WatchNode(Node):
    """Prints a line for each target of tracker and localizer.

    A target's line is printed when its state changes, and else `rate` times a second. The node ends
    with the reader of its output, such as `head`.

    Args:
        rate: Lines a second for each target; 0 prints every frame.
        once: Whether to end after the first frame with a target.
        **options: Of `rclpy.node.Node`.
    """

    def __init__(self, *, rate: float = 2.0, once: bool = False, **options: Any) -> None:
        super().__init__("watch", **options)
        self._rate = rate
        self._once = once
        # State and time of the last line, by topic and target.
        self._last: dict[tuple[str, str], tuple[str, float]] = {}
        self._has_status = False
        for topic in (_TRACKER, _LOCALIZER):
            self.create_subscription(
                DiagnosticArray, topic, functools.partial(self._on_status, topic), LATCHED_QOS
            )
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_SILENCE, self._report_silence, clock=clock)

    def _on_status(self, topic: str, message: DiagnosticArray) -> None:
        now = time.monotonic()
        self._has_status = True
        seconds = stamp_of(message.header) / NANOSECONDS
        has_target = False
        for target, state, text in lines(message):
            last_state, last_time = self._last.get((topic, target), ("", -math.inf))
            is_due = self._rate == 0.0 or now - last_time >= 1.0 / self._rate
            if state != last_state or is_due:
                self._last[topic, target] = state, now
                try:
                    print(f"{seconds:.3f}  {text}", flush=True)
                except BrokenPipeError:
                    self._end_without_reader()
                    return
            has_target |= target != _NO_TARGET
        if self._once and has_target:
            self.context.try_shutdown()

    def _end_without_reader(self) -> None:
        # Python flushes its buffer at exit, and would raise again.
        null_device = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null_device, sys.stdout.fileno())
        os.close(null_device)
        self.context.try_shutdown()

    def _report_silence(self) -> None:
        if not self._has_status:
            topic = self.resolve_topic_name(_TRACKER)
            logger = self.get_logger()  # type: ignore[no-untyped-call]
            logger.warning(
                f"no status on {topic}: start a tracker, or remap {_TRACKER} to the status of yours"
            )


def lines(message: DiagnosticArray) -> Iterator[tuple[str, str, str]]:
    """Name, state and line of each target of a status of the tracker or the localizer."""
    own, *targets = message.status or [DiagnosticStatus()]
    if not targets:
        state = _values(own).get("state", "")
        yield _NO_TARGET, state, f"{_NO_TARGET}: {own.message}"
    for target in targets:
        values = _values(target)
        name = f"target {values.get('id', '?')} {values.get('label', '')}".rstrip()
        state = values.get("state", "")
        head = f"{name}  {state} {_number(values, 'confidence', 2)}"
        place = _place(values)
        reason = target.message if not place or target.message not in _FINE else ""
        yield name, state, f"{head}  {'; '.join(filter(None, (place, reason)))}"


def _place(values: Mapping[str, str]) -> str:
    """The box or the position of a target, empty without one."""
    if "box_x" in values:
        corner = ", ".join(_number(values, f"box_{name}", 1) for name in ("x", "y"))
        size = " x ".join(_number(values, f"box_{name}", 1) for name in ("width", "height"))
        return f"box {size} px, top left at {corner}"
    if "x" in values:
        place = ", ".join(_number(values, name, 2) for name in ("x", "y"))
        velocity = ", ".join(_number(values, f"velocity_{name}", 2) for name in ("x", "y"))
        return f"at {place} m, {velocity} m/s"
    return ""


def _number(values: Mapping[str, str], key: str, digits: int) -> str:
    try:
        return f"{float(values[key]):.{digits}f}"
    except (KeyError, ValueError):
        return "?"


def _values(status: DiagnosticStatus) -> dict[str, str]:
    return {item.key: item.value for item in status.values}


def main(arguments: list[str] | None = None, *, rate: float = 2.0, once: bool = False) -> None:
    """Print until SIGINT or SIGTERM.

    Args:
        arguments: The command line with the program's name, by default that of the process.
        rate: As for `WatchNode`.
        once: As for `WatchNode`.
    """
    run(lambda: WatchNode(rate=rate, once=once), arguments)
