"""Stamps for a recording that has no time of its own: those at which its frames are played."""

from __future__ import annotations

from collections.abc import Callable


class PlayedStamps:
    """Moves the stamps of a source to the time at which it is played.

    The intervals between frames stay those of the source. Only after a pause, and where the source
    begins again, do the stamps follow the clock anew; they never go back.
    """

    def __init__(self, now: Callable[[], int]) -> None:
        """Begin with the next frame.

        Args:
            now: Tells the time in nanoseconds.
        """
        self._now = now
        self._delay: int | None = None
        self._gap = 0
        self._last = 0
        self._last_in_source = 0

    def follow_clock(self) -> None:
        """Give the next frame the time at which it is played, as after a pause."""
        self._delay = None

    def delay_of(self, stamp: int) -> int:
        """By how much the next frame is stamped later than in its source, in nanoseconds.

        Args:
            stamp: The frame's in its source, above 0.
        """
        last_in_source = self._last_in_source
        if 0 < last_in_source < stamp:
            self._gap = stamp - last_in_source
        if self._delay is None or stamp <= last_in_source:
            self._delay = max(self._now(), self._last + self._gap) - stamp
        self._last_in_source, self._last = stamp, stamp + self._delay
        return self._delay
