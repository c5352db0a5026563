"""What a browser's link bears: how many frames may be under way to it, and how detailed they are.

All of it is measured by what the page acknowledges, so that a page that draws slowly counts as a
slow link.
"""

from __future__ import annotations

import asyncio
import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from pf_tracker_ros.node.console.image_encoding import QUALITY_LEVELS, QualityLevel

# A frame is under way while the one before is being drawn; more where the way is long.
_FRAMES_UNDER_WAY = 2
_MOST_UNDER_WAY = 4
# Frames a second that are worth less detail, as far as the camera gives so many.
_WANTED_RATE = 25.0
_RATE_ENOUGH = 0.9
# Shares of the time in which something is on its way: the link is full, or has room for more.
_FULL = 0.85
_ROOM = 0.4
# A step of `QUALITY_LEVELS` makes a picture about so much smaller.
_STEP = 0.7
# Seconds between two judgments, and for how long there has to be room before a picture gets more
# detail: longer each time that this was too much within some seconds.
_INTERVAL = 0.4
_PATIENCE = 1.5
_LONGEST_PATIENCE = 40.0
_TOO_MUCH_WITHIN = 4.0
# Less detail has to bring so many times the frames. Else something other than the link limits them,
# such as a browser that has little of its machine; for so many seconds it is not tried again.
_USEFUL = 1.15
_USELESS = 20.0


@dataclass
class _Measured:
    """What has been acknowledged since some time."""

    since: float
    frames: int = 0
    dropped: int = 0
    busy: float = 0.0


class _Lowered(NamedTuple):
    """From which level less detail was given, and how many frames a second it had."""

    level: int
    rate: float


class RateController:
    """Decides when a browser gets a frame, and in which detail.

    So a slow link drops frames and detail instead of queuing frames. All times are seconds by one
    clock that never jumps.

    Args:
        now: The time.
    """

    def __init__(self, now: float) -> None:
        self._freed = asyncio.Event()
        self._taken = 0
        self._sent_at: deque[float] = deque()
        self._shown_at = now
        self._greeted_at: float | None = None
        self._round_trip = math.inf
        self._most_under_way = _FRAMES_UNDER_WAY
        self._level = 0
        self._measured = _Measured(now)
        self._roomy_since = now
        self._raised_at: float | None = None
        self._patience = _PATIENCE
        self._lowered: _Lowered | None = None
        self._useless_until = now
        self._unjudged = 0

    @property
    def quality_level(self) -> QualityLevel:
        """Of the next frame."""
        return QUALITY_LEVELS[self._level]

    def start_round_trip(self, now: float) -> None:
        """A short message is sent, which the page answers at once."""
        self._greeted_at = now

    def end_round_trip(self, now: float) -> None:
        """It has been answered, which tells how long the way is."""
        if self._greeted_at is not None:
            self._round_trip = now - self._greeted_at
            self._greeted_at = None
            frames = 1 + math.ceil(self._round_trip * _WANTED_RATE)
            self._most_under_way = min(_MOST_UNDER_WAY, max(_FRAMES_UNDER_WAY, frames))

    @property
    def can_send(self) -> bool:
        """Whether a frame may be sent."""
        return self._taken < self._most_under_way

    async def acquire(self) -> None:
        """Wait until a frame may be sent, which it then has to be."""
        while not self.can_send:
            self._freed.clear()
            await self._freed.wait()
        self._taken += 1

    def send(self, dropped: int, now: float) -> None:
        """A frame is sent.

        Args:
            dropped: How many there were between it and the last one.
            now: The time.
        """
        self._sent_at.append(now)
        self._measured.dropped += dropped

    def acknowledge(self, now: float) -> None:
        """The oldest frame under way has been drawn."""
        if not self._sent_at:
            return
        sent_at = self._sent_at.popleft()
        self._taken -= 1
        self._freed.set()
        self._round_trip = min(self._round_trip, now - sent_at)
        if self._unjudged:
            self._unjudged -= 1
            self._shown_at = now
            self._measured = _Measured(now)
            return
        measured = self._measured
        measured.frames += 1
        # The way itself is no work of the link, nor is what waits behind another frame.
        began = max(sent_at + self._round_trip, self._shown_at, measured.since)
        measured.busy += max(0.0, now - began)
        self._shown_at = now
        if now - measured.since >= _INTERVAL:
            self._judge(now)

    def _judge(self, now: float) -> None:
        measured = self._measured
        elapsed = now - measured.since
        self._measured = _Measured(now)
        load, rate = measured.busy / elapsed, measured.frames / elapsed
        wanted = min(_WANTED_RATE, (measured.frames + measured.dropped) / elapsed)
        if self._raised_at is not None and now - self._raised_at > _TOO_MUCH_WITHIN:
            # The link bears it.
            self._raised_at, self._patience = None, _PATIENCE
        if load > _FULL and rate < _RATE_ENOUGH * wanted:
            self._roomy_since = now
            self._relieve(rate, wanted, now)
            return
        self._lowered = None
        if load >= _ROOM:
            self._roomy_since = now
        elif self._level and now - self._roomy_since >= self._patience:
            self._raised_at = self._roomy_since = now
            self._change(self._level - 1)

    def _relieve(self, rate: float, wanted: float, now: float) -> None:
        """Give less detail, or take that back where it was of no use."""
        if self._lowered and rate < _USEFUL * self._lowered.rate:
            self._change(self._lowered.level)
            self._lowered = None
            self._useless_until = now + _USELESS
            return
        if now < self._useless_until or self._level == len(QUALITY_LEVELS) - 1:
            return
        if self._raised_at is not None:
            self._patience = min(_LONGEST_PATIENCE, 2.0 * self._patience)
            self._raised_at = None
        self._lowered = _Lowered(self._level, rate)
        steps = max(1, round(math.log(rate / wanted) / math.log(_STEP)))
        self._change(min(len(QUALITY_LEVELS) - 1, self._level + steps))

    def _change(self, level: int) -> None:
        self._level = level
        # What is under way is of the level before.
        self._unjudged = len(self._sent_at)
