"""Frames that are answered but not looked at: since when, how many, and in the log."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

# What becomes of a frame that is not looked at.
SKIPPED = ("refused", "duplicate", "late", "paused")

# One frame may come twice or broken; so many seconds of such frames are told of.
TOLD_AFTER = 1.0


@dataclass(frozen=True)
class Skipped:
    """The frames in a row, up to the last one, that were not looked at.

    Attributes:
        count: How many.
        seconds: From the first of them to the last one, by arrival, in whole milliseconds.
        cause: Of the last one: why, and what to do.
        last_stamp: Of the last frame that was looked at, nanoseconds; 0 if it had none, or if there
            was none.
    """

    count: int
    seconds: float
    cause: str
    last_stamp: int

    @property
    def is_lasting(self) -> bool:
        """Whether it has lasted for so long that people should know."""
        return self.seconds >= TOLD_AFTER

    @property
    def described(self) -> str:
        """The cause, and since when if that is long ago."""
        if not self.is_lasting:
            return self.cause
        return f"{self.cause}; no frame has been looked at for {self.seconds:.1f} s"


class SkippedFrames:
    """Follows which frames are looked at; the log has one line when that ends, one when it goes on.

    A pause is none of its business there, as whoever asked for it is told; and the log has the
    error of a frame that is refused.

    Args:
        logger: Of the node.
    """

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self.forget()

    def forget(self) -> None:
        """Begin again, as after an activation."""
        self.last: Skipped | None = None
        self._began = 0.0
        self._last_stamp = 0
        self._is_logged = False

    def look_at(self, stamp: int) -> None:
        """Take a frame that was looked at.

        Args:
            stamp: Of its header, nanoseconds.
        """
        if self.last and self._is_logged:
            self._logger.info(
                f"frames are looked at again, after {self.last.count} in "
                f"{time.monotonic() - self._began:.1f} s that were not"
            )
        self.last, self._is_logged, self._last_stamp = None, False, stamp

    def skip(self, frame: str, cause: str) -> None:
        """Take a frame that was not.

        Args:
            frame: What became of it, one of `SKIPPED`.
            cause: Why, and what to do.
        """
        now = time.monotonic()
        if self.last is None:
            self._began = now
        count = self.last.count + 1 if self.last else 1
        self.last = Skipped(count, round(now - self._began, 3), cause, self._last_stamp)
        if self.last.is_lasting and not self._is_logged and frame != "paused":
            self._is_logged = True
            if frame != "refused":
                self._logger.warning(self.last.described)
