"""Stamps for recordings without time stamps: the time at which a frame is published."""

from __future__ import annotations

from collections.abc import Callable


class Restamper:
    """Shifts the stamps of a source to the time of publication.

    The intervals are those of the source at its playback rate. After a pause, a lag or a restart of
    the source the stamps synchronize with the clock again. They never decrease.

    Args:
        now: Returns the time in nanoseconds.
    """

    def __init__(self, now: Callable[[], int]) -> None:
        self._now = now
        self._follows_clock = True
        self._gap = 0
        self._last = 0
        self._last_in_source = 0

    def follow_clock(self) -> None:
        """Stamp the next frame with the clock's time, as after a pause."""
        self._follows_clock = True

    def delay_of(self, stamp: int, rate: float) -> int:
        """Shift of the next frame's stamp in nanoseconds.

        Args:
            stamp: The frame's stamp in the source, above 0.
            rate: Playback rate.
        """
        if 0 < self._last_in_source < stamp:
            self._gap = round((stamp - self._last_in_source) / rate)
        else:
            self._follows_clock = True
        shifted = self._last + self._gap
        if self._follows_clock:
            shifted = max(self._now(), shifted)
        self._follows_clock = False
        self._last_in_source, self._last = stamp, shifted
        return shifted - stamp
