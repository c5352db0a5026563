"""Schedule of a playback: due times, pause, step, seek, stop, and waiting for a status."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from pf_tracker_ros.stamps import NANOSECONDS

# Seconds; after a larger lag the schedule restarts instead of catching up.
TOLERATED_LAG = 0.1
_POLL_INTERVAL = 0.02


class PlaybackStopped(Exception):  # noqa: N818
    """The playback was stopped during a wait."""


class SeekRequested(Exception):  # noqa: N818
    """Playback continues at another item, whose index is the argument, counted from 0."""


class Playback:
    """Schedule of a playback: its thread waits here, others pause, step, seek or stop it.

    `stop` ends every wait with `PlaybackStopped`. `seek` ends a wait for an item's due time or
    status with `SeekRequested`.

    Attributes:
        has_restarted: Whether the schedule restarted with the last item, as after a pause or a lag.

    Args:
        paused: Whether to start paused.
    """

    def __init__(self, *, paused: bool = False) -> None:
        self.has_restarted = False
        self._changed = threading.Condition()
        self._paused = paused
        self._stopped = False
        self._steps = 0
        self._seek_index: int | None = None
        self._holding = False
        self._at_end = False
        self._processed_stamp: int | None = None
        self._last_due: float | None = None
        self._last_time: int | None = None
        self._last_gap = 0.04

    def stop(self) -> None:
        """End every wait, present and future."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    @property
    def paused(self) -> bool:
        """Whether the playback is paused; may be set from any thread."""
        return self._paused

    @paused.setter
    def paused(self, paused: bool) -> None:
        with self._changed:
            self._paused = paused
            self._changed.notify_all()

    @property
    def is_at_end(self) -> bool:
        """Whether the playback waits at the end of the source."""
        return self._at_end

    def step(self, count: int = 1) -> None:
        """Publish this many items during a pause, at once."""
        with self._changed:
            self._steps += count
            self._holding = False
            self._changed.notify_all()

    def drop_steps(self) -> None:
        """Cancel pending steps."""
        with self._changed:
            self._steps = 0

    def seek(self, index: int) -> None:
        """Continue at an item, counted from 0; it is published also during a pause."""
        with self._changed:
            self._seek_index = index
            self._steps = 1
            self._holding = False
            self._changed.notify_all()

    def wait_until_held(self, timeout: float) -> bool:
        """Wait until the playback stands still: at a pause without steps, or at the end.

        Args:
            timeout: Seconds.

        Returns:
            Whether it stands still.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._holding or self._stopped, timeout)
            return self._holding

    def wait_at_end(self) -> None:
        """Wait at the end of the source, paused.

        Raises:
            SeekRequested: `seek` was called.
            PlaybackStopped: `stop` was called.
        """
        with self._changed:
            self._paused, self._steps, self._at_end = True, 0, True
            try:
                while True:
                    self._raise_request()
                    self._hold()
            finally:
                self._at_end = False

    def begin_pass(self) -> None:
        """Start the source again; its first item is due one frame interval after the last."""
        self._last_time = None

    def restart_schedule(self) -> None:
        """Set the due time of the current item to now, after it was delayed."""
        if self._last_due is not None:
            self._last_due = time.monotonic()

    def wait_until_due(self, item_time: int, rate: Callable[[], float] | None) -> float:
        """Wait until an item may be published.

        Args:
            item_time: Source time of the item in nanoseconds.
            rate: Returns the speed relative to source time, called again after each change of
                state; None makes the item due at once.

        Returns:
            Lag of the item in seconds if it exceeds the tolerance, else 0.

        Raises:
            SeekRequested: `seek` was called.
            PlaybackStopped: `stop` was called.
        """
        if self._last_time is not None:
            self._last_gap = max(0, item_time - self._last_time) / NANOSECONDS
        lag, self.has_restarted = 0.0, False
        with self._changed:
            while True:
                self._raise_request()
                if self._paused:
                    self._last_due = None
                    if self._steps:
                        self.has_restarted = True
                        self._steps -= 1
                        break
                    self._hold()
                    continue
                self._steps = 0
                now = time.monotonic()
                if rate is None or self._last_due is None:
                    self.has_restarted = True
                    self._last_due = now
                    break
                due = self._last_due + self._last_gap / rate()
                if now >= due:
                    lag = now - due if now - due > TOLERATED_LAG else 0.0
                    self.has_restarted = lag > 0.0
                    self._last_due = now if lag else due
                    break
                # Short waits, so that a change of rate takes effect within a long gap.
                self._changed.wait(min(due - now, 0.1))
        self._last_time = item_time
        return lag

    def mark_processed(self, stamp: int) -> None:
        """Report that the item with this stamp has been processed."""
        with self._changed:
            self._processed_stamp = stamp
            self._changed.notify_all()

    def clear_processed(self) -> None:
        """Discard the last report, before the next item is published."""
        with self._changed:
            self._processed_stamp = None

    def wait_until_processed(self, stamp: int, timeout: float) -> bool:
        """Wait until the item with this stamp has been processed.

        Args:
            stamp: Stamp of the item.
            timeout: Seconds.

        Returns:
            Whether it has been processed.

        Raises:
            SeekRequested: `seek` was called.
            PlaybackStopped: `stop` was called.
        """
        with self._changed:
            is_processed = self._changed.wait_for(
                lambda: (
                    self._stopped or self._seek_index is not None or self._processed_stamp == stamp
                ),
                timeout,
            )
            self._raise_request()
        return is_processed

    def _hold(self) -> None:
        """Wait for a change while the playback stands still."""
        self._holding = True
        self._changed.notify_all()
        try:
            self._changed.wait()
        finally:
            self._holding = False

    def _raise_request(self) -> None:
        if self._stopped:
            raise PlaybackStopped
        if self._seek_index is not None:
            index, self._seek_index = self._seek_index, None
            # The schedule restarts at the new item.
            self._last_due = None
            raise SeekRequested(index)

    def wait_for(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Wait for a condition by polling.

        Args:
            condition: Called about fifty times a second.
            timeout: Seconds.

        Returns:
            Whether the condition holds.

        Raises:
            PlaybackStopped: `stop` was called.
        """
        deadline = time.monotonic() + timeout
        while not condition():
            with self._changed:
                if self._stopped:
                    raise PlaybackStopped
                self._changed.wait(_POLL_INTERVAL)
            if time.monotonic() > deadline:
                return condition()
        return True
