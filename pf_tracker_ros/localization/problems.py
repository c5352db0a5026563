"""What is wrong with the inputs: told once in a sentence, and kept while it lasts."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable

# Seconds until a sentence that comes and goes is told again.
_INTERVAL = 60.0
_LONGEST = 1000
_NUMBERS = re.compile(r"-?[\d.]+")


class Problems:
    """The present problems by topic; sentences that differ only in numbers are the same.

    Args:
        warn: Called with a sentence that is worth a warning.
        interval: Seconds after which the same sentence is worth one again.
    """

    def __init__(self, warn: Callable[[str], object], interval: float = _INTERVAL) -> None:
        self._warn = warn
        self._interval = interval
        self._present: dict[str, str] = {}
        self._told_at: dict[tuple[str, str], float] = {}

    @property
    def sentences(self) -> tuple[str, ...]:
        """The present problems."""
        return tuple(self._present.values())

    def set(self, topic: str, sentence: str) -> None:
        """Set the problem of a topic; an empty sentence means that it has none."""
        if not sentence:
            self._present.pop(topic, None)
            return
        sentence = sentence[:_LONGEST]
        self._present[topic] = sentence
        self.tell(topic, sentence)

    def tell(self, topic: str, sentence: str) -> None:
        """Tell an event that does not last."""
        kind = topic, _NUMBERS.sub("", sentence)
        now = time.monotonic()
        if now - self._told_at.get(kind, -math.inf) >= self._interval:
            self._warn(sentence[:_LONGEST])
            self._told_at[kind] = now

    def clear(self) -> None:
        """Forget all problems, as after a deactivation."""
        self._present.clear()
        self._told_at.clear()
