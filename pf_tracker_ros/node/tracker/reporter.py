"""Errors: logged once, held for the next status, counted by cause."""

from __future__ import annotations

import re
import time
import traceback
from collections import Counter, deque
from collections.abc import Sequence
from typing import Any

from pf_tracker_ros.decoding.image_decoding import ImageError

LOG_INTERVAL = 5.0
# An error may quote received data of any length.
_LONGEST_ERROR = 1000
_LONGEST_TRACEBACK = 5000
_SHOWN_ERRORS = 5
_IMAGE_CURE = (
    "; start a target on these images (~/target, ~/click), stop the present one (~/stop), or "
    "restore the image format: any size of the same aspect ratio"
)
_NUMBERS = re.compile(r"-?[\d.]+")
# Most refusals logged within the interval.
_LOGGED_ERRORS = 20


class Reporter:
    """Collects errors for the log, the status and the diagnostics.

    Attributes:
        last_error: The latest error, empty without one.
        last_error_at: Its time, by `time.monotonic`.
        count: Number of errors.
        failures: Cause to number of refused frames.

    Args:
        logger: Logger of the node.
    """

    def __init__(self, logger: Any) -> None:
        self.last_error = ""
        self.last_error_at = 0.0
        self.count = 0
        self.failures: Counter[str] = Counter()
        self._logger = logger
        self._unshown: deque[str] = deque(maxlen=_SHOWN_ERRORS)
        self._failed_at: dict[str, float] = {}
        self._recent: deque[tuple[float, str]] = deque(maxlen=_LOGGED_ERRORS)

    def report(self, error: str) -> None:
        """Show a refusal in the next status, and in the log unless it was logged just before."""
        error = error[:_LONGEST_ERROR]
        self._record(error)
        now = time.monotonic()
        recent = [text for moment, text in self._recent if now - moment < LOG_INTERVAL]
        if error not in recent and len(recent) < _LOGGED_ERRORS:
            self._recent.append((now, error))
            self._logger.error(error)

    def report_failure(self, error: BaseException) -> None:
        """Show why a frame was refused in the next status; a lasting cause is logged once."""
        kind = type(error).__name__
        cause = "other"
        text = str(error)[:_LONGEST_ERROR]
        details = text
        if isinstance(error, ImageError):
            cause = error.field
            kind = f"{kind} {cause}"
        elif isinstance(error, ValueError):
            cause = "image_changed"
            text = text[: _LONGEST_ERROR - len(_IMAGE_CURE)] + _IMAGE_CURE
            details = text
        else:
            text = f"unexpected {kind}: {text}"[:_LONGEST_ERROR]
            # The end of a traceback is its most useful part.
            details = traceback.format_exc()[-_LONGEST_TRACEBACK:]
        self.failures[cause] += 1
        self._record(text)
        now = time.monotonic()
        if now - self._failed_at.get(kind, -LOG_INTERVAL) >= LOG_INTERVAL:
            self._logger.error(details)
        self._failed_at[kind] = now

    def values(self) -> dict[str, str | float]:
        """The latest error and its age, under the keys of status and diagnostics."""
        values: dict[str, str | float] = {"last_error": self.last_error}
        if self.last_error:
            values["seconds_since_error"] = round(time.monotonic() - self.last_error_at, 3)
        return values

    def take_unshown(self) -> list[str]:
        """The errors since the last call."""
        errors = list(self._unshown)
        self._unshown.clear()
        return errors

    def _record(self, error: str) -> None:
        self.last_error, self.last_error_at = error, time.monotonic()
        self.count += 1
        if error not in self._unshown:
            self._unshown.append(error)


class Throttle:
    """Drops repeated sentences; sentences that differ only in numbers are the same."""

    def __init__(self) -> None:
        self._last_at: dict[str, float] = {}

    def unrepeated(self, sentences: Sequence[str]) -> tuple[str, ...]:
        """The sentences that were not returned within the last `LOG_INTERVAL`."""
        now = time.monotonic()
        self._last_at = {
            kind: moment for kind, moment in self._last_at.items() if now - moment < LOG_INTERVAL
        }
        fresh = []
        for sentence in sentences:
            kind = _NUMBERS.sub("", sentence)
            if kind not in self._last_at:
                self._last_at[kind] = now
                fresh.append(sentence)
        return tuple(fresh)
