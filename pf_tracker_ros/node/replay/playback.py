"""When the next item of a recording is due, with pausing, stopping and waiting for an answer."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from pf_tracker_ros.stamps import NANOSECONDS

# An item this late is not caught up with; the ones after it keep their distance to it.
TOLERATED_LAG = 0.1
_POLL_INTERVAL = 0.02


class PlaybackStopped(Exception):  # noqa: N818
    """The playback was stopped while it waited."""


class SeekRequested(Exception):  # noqa: N818
    """The playback is to go on from another item, whose index is the argument, counted from 0."""


class Playback:
    """The clock of a playback: a thread waits in it, others pause, step, seek, stop or answer.

    Every wait ends early with `PlaybackStopped` once `stop` is called. Waiting for an item, or for the
    answer to one, ends early with `SeekRequested` once `seek` is called.

    Args:
        paused: Whether to begin paused.
    """

    def __init__(self, *, paused: bool = False) -> None:
        self._changed = threading.Condition()
        self._paused = paused
        self._stopped = False
        self._steps = 0
        self._sought: int | None = None
        self._holding = False
        self._at_end = False
        self._answer: int | None = None
        self._last_due: float | None = None
        self._last_time: int | None = None
        self._last_gap = 0.04

    def stop(self) -> None:
        """End every wait, this one and those to come."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    @property
    def paused(self) -> bool:
        """Whether items are held back; may be set from any thread."""
        return self._paused

    @paused.setter
    def paused(self, paused: bool) -> None:
        with self._changed:
            self._paused = paused
            self._changed.notify_all()

    @property
    def is_at_end(self) -> bool:
        """Whether it waits at the end of the source."""
        return self._at_end

    def step(self, count: int = 1) -> None:
        """Let so many items pass a pause, at once."""
        with self._changed:
            self._steps += count
            self._holding = False
            self._changed.notify_all()

    def drop_steps(self) -> None:
        """Let no more items pass a pause than have."""
        with self._changed:
            self._steps = 0

    def seek(self, index: int) -> None:
        """Go on from an item, counted from 0; a pause lets that one pass."""
        with self._changed:
            self._sought = index
            self._steps = 1
            self._holding = False
            self._changed.notify_all()

    def wait_until_held(self, timeout: float) -> bool:
        """Wait until a pause holds an item back, or the source is at its end.

        Args:
            timeout: Longest wait in seconds.

        Returns:
            Whether it does, with no steps left.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._holding or self._stopped, timeout)
            return self._holding

    def wait_at_end(self) -> None:
        """Wait at the end of the source, paused.

        Raises:
            SeekRequested: The playback is to go on from an item.
            PlaybackStopped: The playback was stopped.
        """
        with self._changed:
            self._paused, self._steps, self._at_end = True, 0, True
            try:
                while True:
                    self._raise_what_was_asked()
                    self._hold()
            finally:
                self._at_end = False

    def begin_pass(self) -> None:
        """Begin the source again: its first item is due one frame after its last."""
        self._last_time = None

    def restart_schedule(self) -> None:
        """Count the item that was waited for last as due only now: what held it back is over."""
        if self._last_due is not None:
            self._last_due = time.monotonic()

    def wait_until_due(self, item_time: int, rate: Callable[[], float] | None) -> float:
        """Wait until an item may be published.

        Args:
            item_time: Source time of the item in nanoseconds.
            rate: Tells the speed relative to source time, asked again after each change of
                state; None makes the item due at once.

        Returns:
            By how many seconds the item is late beyond what is tolerated, else 0.

        Raises:
            SeekRequested: The playback is to go on from an item.
            PlaybackStopped: The playback was stopped.
        """
        if self._last_time is not None:
            self._last_gap = max(0, item_time - self._last_time) / NANOSECONDS
        lag = 0.0
        with self._changed:
            while True:
                self._raise_what_was_asked()
                if self._paused:
                    self._last_due = None
                    if self._steps:
                        self._steps -= 1
                        break
                    self._hold()
                    continue
                self._steps = 0
                now = time.monotonic()
                if rate is None or self._last_due is None:
                    self._last_due = now
                    break
                due = self._last_due + self._last_gap / rate()
                if now >= due:
                    lag = now - due if now - due > TOLERATED_LAG else 0.0
                    self._last_due = now if lag else due
                    break
                # Short waits, so that a change of rate is noticed within a long gap.
                self._changed.wait(min(due - now, 0.1))
        self._last_time = item_time
        return lag

    def mark_processed(self, stamp: int) -> None:
        """Tell that the item with this stamp has been dealt with."""
        with self._changed:
            self._answer = stamp
            self._changed.notify_all()

    def clear_processed(self) -> None:
        """Take no earlier answer for one to the next item."""
        with self._changed:
            self._answer = None

    def wait_until_processed(self, stamp: int, timeout: float) -> bool:
        """Wait until the item with this stamp has been dealt with.

        Args:
            stamp: Stamp of the item.
            timeout: Longest wait in seconds.

        Returns:
            Whether it has.

        Raises:
            SeekRequested: The playback is to go on from an item.
            PlaybackStopped: The playback was stopped.
        """
        with self._changed:
            answered = self._changed.wait_for(
                lambda: self._stopped or self._sought is not None or self._answer == stamp, timeout
            )
            self._raise_what_was_asked()
        return answered

    def _hold(self) -> None:
        """Wait for a change while an item is held back."""
        self._holding = True
        self._changed.notify_all()
        try:
            self._changed.wait()
        finally:
            self._holding = False

    def _raise_what_was_asked(self) -> None:
        if self._stopped:
            raise PlaybackStopped
        if self._sought is not None:
            index, self._sought = self._sought, None
            # What was waited for is not what comes.
            self._last_due = None
            raise SeekRequested(index)

    def wait_for(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Wait for something that can only be polled.

        Args:
            condition: Asked about fifty times a second.
            timeout: Longest wait in seconds.

        Returns:
            Whether the condition came true.

        Raises:
            PlaybackStopped: The playback was stopped.
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
