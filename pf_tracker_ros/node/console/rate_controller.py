"""Congestion control for one browser: the number of frames in flight, and their quality.

All measurements come from the acknowledgments of the page, so a page that draws slowly counts as a
slow link:

1. The round-trip time of the welcome sets how many frames may be in flight.
2. Every 0.4 s the load of the link and the frame rate are measured.
3. A full link with too few frames gets a lower quality. If that brings no more frames, the link is
   not the limit, and the quality goes back.
4. At the lowest usable quality, a full link gets fewer frames.
5. A link with spare capacity gets a higher quality, after a wait that doubles each time the higher
   quality was too much.
"""

from __future__ import annotations

import asyncio
import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from pf_tracker_ros.node.console.image_encoding import QUALITY_LEVELS, QualityLevel

# Frames in flight: one while the previous is drawn, more with a long round trip.
_MIN_IN_FLIGHT = 2
_MAX_IN_FLIGHT = 4
# Target frame rate, Hz, as far as the camera has it; below this share of it quality is reduced.
_TARGET_RATE = 25.0
_SUFFICIENT_RATE = 0.9
# Load, as the share of time with data in flight, of a full link and of one with spare capacity.
_FULL_LOAD = 0.85
_SPARE_LOAD = 0.4
# A step of `QUALITY_LEVELS` makes a picture smaller by about this factor.
_STEP = 0.7
# Seconds between two updates, and of spare capacity before quality is raised. The latter doubles,
# up to a maximum, each time that the link was full again within some seconds.
_INTERVAL = 0.4
_RAISE_DELAY = 1.5
_MAX_RAISE_DELAY = 40.0
_FULL_WITHIN = 4.0
# Less quality has to raise the frame rate by this factor. Otherwise something else limits it, such
# as a busy browser, and quality is not reduced again for so many seconds.
_MIN_GAIN = 1.15
_NO_GAIN_PAUSE = 20.0


@dataclass
class _Measurement:
    """Counts since a time; `busy` is the time with data in flight, seconds."""

    since: float
    frames: int = 0
    dropped: int = 0
    busy: float = 0.0


class _Reduction(NamedTuple):
    """The level before a reduction of quality, and its frame rate, Hz."""

    level: int
    rate: float


class RateController:
    """Decides when a browser gets a frame, and in which quality.

    So a slow link drops frames and quality instead of queuing frames. All times are seconds by a
    monotonic clock.

    Attributes:
        level_count: Number of quality levels that may be used, from the best on.

    Args:
        now: The time.
    """

    def __init__(self, now: float) -> None:
        self._freed = asyncio.Event()
        self._in_flight = 0
        self._sent_at: deque[float] = deque()
        self._acknowledged_at = now
        self._round_trip_began: float | None = None
        self._round_trip = math.inf
        self._max_in_flight = _MIN_IN_FLIGHT
        self.level_count = len(QUALITY_LEVELS)
        self._level = 0
        self._measurement = _Measurement(now)
        self._spare_since = now
        self._raised_at: float | None = None
        self._raise_delay = _RAISE_DELAY
        self._last_reduction: _Reduction | None = None
        self._no_gain_until = now
        self._uncounted = 0

    @property
    def quality_level(self) -> QualityLevel:
        """Of the next frame."""
        return QUALITY_LEVELS[min(self._level, self._last_level)]

    @property
    def _last_level(self) -> int:
        return self.level_count - 1

    def start_round_trip(self, now: float) -> None:
        """Note that a message is sent which the page acknowledges at once."""
        self._round_trip_began = now

    def end_round_trip(self, now: float) -> None:
        """Process the acknowledgment, which measures the round-trip time."""
        if self._round_trip_began is not None:
            self._round_trip = now - self._round_trip_began
            self._round_trip_began = None
            frames = 1 + math.ceil(self._round_trip * _TARGET_RATE)
            self._max_in_flight = min(_MAX_IN_FLIGHT, max(_MIN_IN_FLIGHT, frames))

    @property
    def can_send(self) -> bool:
        """Whether a frame may be sent."""
        return self._in_flight < self._max_in_flight

    async def acquire(self) -> None:
        """Wait until a frame may be sent, and reserve its place; `send` has to follow."""
        while not self.can_send:
            self._freed.clear()
            await self._freed.wait()
        self._in_flight += 1

    def send(self, dropped: int, now: float) -> None:
        """Note that a frame is sent.

        Args:
            dropped: Number of frames dropped between it and the last one.
            now: The time.
        """
        self._sent_at.append(now)
        self._measurement.dropped += dropped

    def acknowledge(self, now: float) -> None:
        """Process the acknowledgment of the oldest frame in flight."""
        if not self._sent_at:
            return
        sent_at = self._sent_at.popleft()
        self._in_flight -= 1
        self._freed.set()
        self._round_trip = min(self._round_trip, now - sent_at)
        if self._uncounted:
            self._uncounted -= 1
            self._acknowledged_at = now
            self._measurement = _Measurement(now)
            return
        measurement = self._measurement
        measurement.frames += 1
        # Neither the round trip nor the wait behind another frame is load.
        began = max(sent_at + self._round_trip, self._acknowledged_at, measurement.since)
        measurement.busy += max(0.0, now - began)
        self._acknowledged_at = now
        if now - measurement.since >= _INTERVAL:
            self._update(now)

    def _update(self, now: float) -> None:
        measurement = self._measurement
        elapsed = now - measurement.since
        self._measurement = _Measurement(now)
        load, rate = measurement.busy / elapsed, measurement.frames / elapsed
        target = min(_TARGET_RATE, (measurement.frames + measurement.dropped) / elapsed)
        if self._raised_at is not None and now - self._raised_at > _FULL_WITHIN:
            # The link carries the raised quality.
            self._raised_at, self._raise_delay = None, _RAISE_DELAY
        if load > _FULL_LOAD and rate < _SUFFICIENT_RATE * target:
            self._spare_since = now
            self._reduce(rate, target, now)
            return
        self._last_reduction = None
        if load >= _SPARE_LOAD:
            self._spare_since = now
        elif self._level and now - self._spare_since >= self._raise_delay:
            self._raised_at = self._spare_since = now
            self._set_level(self._level - 1)

    def _reduce(self, rate: float, target: float, now: float) -> None:
        """Reduce the quality, or restore it where the last reduction brought too little."""
        if self._last_reduction and rate < _MIN_GAIN * self._last_reduction.rate:
            self._set_level(self._last_reduction.level)
            self._last_reduction = None
            self._no_gain_until = now + _NO_GAIN_PAUSE
            return
        if now < self._no_gain_until or self._level >= self._last_level:
            return
        if self._raised_at is not None:
            self._raise_delay = min(_MAX_RAISE_DELAY, 2.0 * self._raise_delay)
            self._raised_at = None
        self._last_reduction = _Reduction(self._level, rate)
        steps = max(1, round(math.log(rate / target) / math.log(_STEP)))
        self._set_level(min(self._last_level, self._level + steps))

    def _set_level(self, level: int) -> None:
        self._level = level
        # Frames in flight have the previous level.
        self._uncounted = len(self._sent_at)
