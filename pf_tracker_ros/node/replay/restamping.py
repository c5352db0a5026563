"""Stamps for a recording that has no time of its own: those at which its frames are played."""

from __future__ import annotations

from collections.abc import Callable


class Restamper:
    """Moves the stamps of a source to the time at which it is played.

    The intervals between frames are those of the source at the rate at which it is played. Only
    after a pause, where the player fell behind and where the source begins again do the stamps
    follow the clock anew; they never go back.

    Args:
        now: Tells the time in nanoseconds.
    """

    def __init__(self, now: Callable[[], int]) -> None:
        self._now = now
        self._follows_clock = True
        self._gap = 0
        self._last = 0
        self._last_in_source = 0

    def follow_clock(self) -> None:
        """Give the next frame the time at which it is played, as after a pause."""
        self._follows_clock = True

    def delay_of(self, stamp: int, rate: float) -> int:
        """By how much the next frame is stamped later than in its source, in nanoseconds.

        Args:
            stamp: The frame's in its source, above 0.
            rate: Speed at which the source is played.
        """
        if 0 < self._last_in_source < stamp:
            self._gap = round((stamp - self._last_in_source) / rate)
        else:
            self._follows_clock = True
        played = self._last + self._gap
        if self._follows_clock:
            played = max(self._now(), played)
        self._follows_clock = False
        self._last_in_source, self._last = stamp, played
        return played - stamp
