"""What goes wrong: told once, kept until a status has shown it, counted by cause."""

from __future__ import annotations

import re
import time
import traceback
from collections import Counter, deque
from collections.abc import Sequence
from typing import Any

from pf_tracker_ros.decoding.image_decoding import ImageError

LOG_INTERVAL = 5.0
# What came over the wire may be quoted in an error, and be of any length.
_LONGEST_ERROR = 1000
_LONGEST_TRACEBACK = 5000
_SHOWN_ERRORS = 5
_IMAGE_CURE = (
    ": give a target on these images (~/target, ~/click), forget the one there is (~/stop), or let "
    "the camera send what it sent before; another size of the same aspect ratio would do as well"
)
_NUMBERS = re.compile(r"-?[\d.]+")
# Most refusals in the log within the interval, whatever they say.
_LOGGED_ERRORS = 20


class Reporter:
    """Collects errors for the log, the status and the diagnostics.

    Attributes:
        last_error: The latest error, empty if there was none.
        last_error_at: When it came, by `time.monotonic`.
        count: Errors so far.
        failures: Cause to number of frames that failed of it.

    Args:
        logger: Of the node.
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
        """Tell the user what was refused: in the next status, and, unless it just has, the log."""
        error = error[:_LONGEST_ERROR]
        self._remember(error)
        now = time.monotonic()
        recent = [text for moment, text in self._recent if now - moment < LOG_INTERVAL]
        if error not in recent and len(recent) < _LOGGED_ERRORS:
            self._recent.append((now, error))
            self._logger.error(error)

    def report_failure(self, error: Exception) -> None:
        """Tell the user why a frame failed; the log hears of a cause that goes on only once."""
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
            # Its end says most.
            details = traceback.format_exc()[-_LONGEST_TRACEBACK:]
        self.failures[cause] += 1
        self._remember(text)
        now = time.monotonic()
        if now - self._failed_at.get(kind, -LOG_INTERVAL) >= LOG_INTERVAL:
            self._logger.error(details)
        self._failed_at[kind] = now

    def values(self) -> dict[str, str | float]:
        """The latest error under the keys that status and diagnostics use, with its age."""
        values: dict[str, str | float] = {"last_error": self.last_error}
        if self.last_error:
            values["seconds_since_error"] = round(time.monotonic() - self.last_error_at, 3)
        return values

    def take_unshown(self) -> list[str]:
        """The errors since the last call."""
        errors = list(self._unshown)
        self._unshown.clear()
        return errors

    def _remember(self, error: str) -> None:
        self.last_error, self.last_error_at = error, time.monotonic()
        self.count += 1
        if error not in self._unshown:
            self._unshown.append(error)


class Throttle:
    """Picks what has not been said for a while, whatever the numbers in it."""

    def __init__(self) -> None:
        self._said_at: dict[str, float] = {}

    def unrepeated(self, sentences: Sequence[str]) -> tuple[str, ...]:
        """Those of the sentences that are not of the kind of one that was just picked."""
        now = time.monotonic()
        self._said_at = {
            kind: moment for kind, moment in self._said_at.items() if now - moment < LOG_INTERVAL
        }
        picked = []
        for sentence in sentences:
            kind = _NUMBERS.sub("", sentence)
            if kind not in self._said_at:
                self._said_at[kind] = now
                picked.append(sentence)
        return tuple(picked)
